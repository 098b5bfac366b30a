"""Inspection of a recording before its first frame: probable faults of a run's input, in one line each.

A wrong rig, exchanged videos or views out of step give poses that look like poses. The first frames show them
cheaply: by small foregrounds, whose middles and tops are followed through some seconds in all views.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

from tracker.foundation.configuration.components import available, find
from tracker.images.inspection._arrival import first_in_view
from tracker.images.inspection._survey import Survey, other_colours, survey

__all__ = ["Inspection", "Survey", "changes", "findings", "first_in_view", "other_colours", "survey"]


@runtime_checkable
class Inspection(Protocol):
    """A component that finds one kind of wrong input; it is silent if it cannot decide."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """Probable faults.

        Args:
            seen: data of the first frames.

        Yields:
            One line each: what was found, what was expected, and what to do.
        """
        ...


def changes(seen: Survey, view: int) -> dict[int, int]:
    """First frames and delays of a view, in images; the first entry holds from the beginning on; empty for none."""
    late = seen.delays.late[view]
    if not late.any():
        return {}
    begins = [0, *(k + 1 for k in range(len(late) - 1) if late[k + 1] != late[k])]
    return {(seen.first + k * seen.stride if k else 0): int(late[k]) * seen.stride for k in begins}


def findings(seen: Survey) -> tuple[str, ...]:
    """Findings of all components of this folder, in the order of their names."""
    return tuple(line for use in available("inspection") for line in find("inspection", use)().findings(seen))
