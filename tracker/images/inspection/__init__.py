"""A look at a recording before its first frame: what was given to a run that can hardly be right, in one line each.

A wrong rig, exchanged videos or views out of step give poses that look like poses. What the first frames show of it is
cheap to find: small foregrounds, their middles and tops followed through some seconds in all views.
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
    """A component that looks for one kind of wrong input; it says nothing where it cannot tell."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """What can hardly be right.

        Args:
            seen: what the first frames show.

        Yields:
            One line each: what was found, what was expected, and what to do.
        """
        ...


def changes(seen: Survey, view: int) -> dict[int, int]:
    """From which frame on a view is how many images late, the first entry from the beginning on; empty for never."""
    late = seen.delays.late[view]
    if not late.any():
        return {}
    begins = [0, *(k + 1 for k in range(len(late) - 1) if late[k + 1] != late[k])]
    return {(seen.first + k * seen.stride if k else 0): int(late[k]) * seen.stride for k in begins}


def findings(seen: Survey) -> tuple[str, ...]:
    """What any component of this folder finds, in the order of their names."""
    return tuple(line for use in available("inspection") for line in find("inspection", use)().findings(seen))
