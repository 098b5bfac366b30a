"""Recordings in step, as they are and with delays that are made: what the look at their first frames finds of them."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.recorded import Recorded, recorded
from tracker.bodies.scene import Scene
from tracker.foundation.configuration.tables import build
from tracker.images.inspection import Survey, survey

Made = Callable[[int, int], int | None]
"""What image of its own a view shows in a frame, of how many there are; None for none."""


def _dropped(frame: int, n_images: int) -> int:
    """From half of the recording on each image comes one early: the one there was dropped."""
    return frame + (frame >= n_images // 2)


WHOLE: dict[str, Made] = {
    "2 frames": lambda frame, _: frame - 2,
    "-7 frames": lambda frame, _: frame + 7,
    "33 frames": lambda frame, _: frame - 33,
    "one dropped": _dropped,
}
_LONG, _RATE = 1000, 1.001
"""Frames of a recording played forwards and backwards, and the rate of a view's clock in it."""

TRUE = {"2 frames": 2, "-7 frames": -7, "33 frames": 33}
"""By how many frames the view is late."""

_NEAR_FRAMES = 12
"""Of a place of a change."""

_HALF_FRAMES = 0.2
"""By which a delay of half a frame may be told wrong."""


def compare(console: Console, only: str) -> None:
    """Prints what is found of every recording, each view late in turn, with plates and without.

    Args:
        console: where to.
        only: a part of the names of recordings.
    """
    root = Path(os.environ["BODYTRACK_DATA"])
    table = Table(title="by views: found / nothing said / a frame beside / wrong")
    for name in ("recording", "plates", "in step", "tied", *WHOLE, "half a frame", "rate 1.001"):
        table.add_column(name)
    for one in recorded(root)[0]:
        if only.lower() in one.name.lower():
            for plates in (True, False) if one.plates else (False,):
                table.add_row(one.name, "yes" if plates else "no", *_row(one, plates))
    console.print(table)


def _row(one: Recorded, plates: bool) -> Iterator[str]:
    settings: dict[str, Any] = one.reading | (one.plates if plates else {"background": "none"})
    expanded = {k: os.path.expandvars(v) if isinstance(v, str) else v for k, v in settings.items()}
    sequence = build("reading", expanded, one.name, Path.cwd()).open()
    seen = survey(sequence.frames(), Scene((), sequence.rig), sequence.plates)
    delays = seen.delays
    yield "nothing" if not (delays.late.any() or delays.part.any()) else f"{delays.late[:, 0]} {delays.part}"
    tied = [v for v, told in enumerate(delays.told) if told]
    yield f"{len(tied)} of {len(seen.rig)}"
    for name, made in WHOLE.items():
        yield _counted(Counter(_judged(_made(seen, v, made), v, name) for v in range(len(seen.rig))))
    yield _counted(Counter(_half(seen, v) for v in range(len(seen.rig))))
    yield _counted(Counter(_other_rate(seen, v) for v in range(len(seen.rig))))


def _counted(found: Counter[str]) -> str:
    return " / ".join(str(found[name]) for name in ("found", "nothing", "beside", "wrong"))


def _made(seen: Survey, view: int, made: Made) -> Survey:
    """The same with a view that shows other images of its own."""
    n_frames, rows = len(seen.foregrounds), []
    for t, masks in enumerate(seen.foregrounds):
        own = made(t, n_frames)
        shown = seen.foregrounds[own][view] if own is not None and 0 <= own < n_frames else None
        rows.append((*masks[:view], shown, *masks[view + 1 :]))
    return replace(seen, foregrounds=tuple(rows))


def _judged(seen: Survey, view: int, name: str) -> str:
    late = seen.delays.late
    if not late.any():
        return "nothing"
    true = TRUE.get(name)
    # of two that are tied to each other alone, either is late against the other
    beside = late[view] - next(late[v] for v in range(len(late)) if v != view and seen.delays.told[v])
    changes = [k + 1 for k in range(len(beside) - 1) if beside[k + 1] != beside[k]]
    if true is None:
        steps = [int(beside[k] - beside[k - 1]) for k in changes]
        at = len(beside) // 2
        return "found" if steps == [-1] and abs(changes[0] - at) <= _NEAR_FRAMES else "beside"
    if changes or abs(beside[0] - true) > 1:
        return "wrong"
    return "found" if beside[0] == true else "beside"


def _half(seen: Survey, view: int) -> str:
    """At half the rate, with every other image of a view."""
    rows = seen.foregrounds
    pairs = zip(rows[::2], rows[1::2], strict=False)
    shown = tuple(tuple((odd if v == view else even)[v] for v in range(len(seen.rig))) for even, odd in pairs)
    part = replace(seen, foregrounds=shown).delays.part
    if not part.any():
        return "nothing"
    beside = part[view] - next(part[v] for v in range(len(part)) if v != view)
    return "found" if abs(beside + 0.5) <= _HALF_FRAMES else "beside" if abs(beside + 0.5) <= 1 else "wrong"


def _other_rate(seen: Survey, view: int) -> str:
    """Forwards and backwards again and again, a view a little quicker: it is a frame early by the end."""
    n_frames, rows = len(seen.foregrounds), []
    for t in range(_LONG):
        own, others = (_there_and_back(round(time), n_frames) for time in (_RATE * t, t))
        rows.append(tuple(seen.foregrounds[own if v == view else others][v] for v in range(len(seen.rig))))
    late = replace(seen, foregrounds=tuple(rows)).delays.late
    if not late.any():
        return "nothing"
    beside = late[view] - late[0 if view else 1]
    off = max(abs(int(beside[t]) + (_RATE - 1) * t) for t in range(_LONG))
    return "found" if off <= 1 and beside[0] == 0 and beside[-1] == -1 else "beside" if off <= 1 else "wrong"


def _there_and_back(frame: int, n_frames: int) -> int:
    k = frame % (2 * n_frames - 2)
    return k if k < n_frames else 2 * n_frames - 2 - k
