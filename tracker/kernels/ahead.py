"""Ahead-of-time compilation of the kernels; numba keeps the machine code on disk."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from tracker.kernels.calls import Call
from tracker.kernels.compilation import forget_others
from tracker.progress import Progress, silent

Group = Literal["tracking", "matching", "calibration"]
"""What kernels are for; a run compiles those that it needs."""

GROUPS: tuple[Group, ...] = "tracking", "matching", "calibration"


# all of them are in the extension
_CALLS: dict[Group, Callable[[], list[Call]]] = dict.fromkeys(GROUPS, list)


def all_cached(group: Group = "tracking") -> bool:
    """Whether machine code of every kernel of a group lies on disk."""
    return all(
        any(Path(kernel.stats.cache_path).glob(f"{kernel.__module__.rpartition('.')[2]}.{kernel.__name__}-*.nbi"))
        for kernel, _ in _CALLS[group]()
    )


def warm_up(progress: Progress = silent, group: Group = "tracking") -> None:
    """Compiles or loads every kernel of a group, by calls on empty data of the types the package uses.

    Args:
        progress: told the kernel in work.
        group: what the kernels are for.
    """
    calls = _CALLS[group]()
    for k, (kernel, arguments) in enumerate(calls):
        progress("compiling kernels once", k, len(calls), kernel.__name__.replace("_", " "))
        kernel(*arguments)
    progress("compiling kernels once", len(calls), len(calls))


def forget_outdated() -> int:
    """Deletes machine code made of other sources than those of today; returns the bytes freed."""
    return forget_others(name for name in sys.modules if name.startswith(f"{__package__}."))
