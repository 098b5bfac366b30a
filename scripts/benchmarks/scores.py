"""The rows of a file of scores: what was run, and how far each person was off."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from tracker.foundation.files import replacing


@dataclass(frozen=True)
class Score:
    """One person of one run; a row of the table."""

    recording: str
    person: str
    model: str
    acquired: bool
    plates: bool
    settings: str
    start: int
    stop: int
    code: str
    commit: str
    failed: str = ""
    """Why there is nothing below."""

    n_frames: int = 0
    lost: int = 0
    mean_mm: float = np.nan
    removed_mm: float = np.nan
    """With constant offsets removed."""

    turned_mm: float = np.nan
    """With offsets removed that are constant in the axes of the trunk."""

    under_100: float = np.nan
    """Share of all frames with a pose less than 100 mm off on average."""

    elbows_deg: float = np.nan
    elbows_removed_deg: float = np.nan
    knees_deg: float = np.nan
    knees_removed_deg: float = np.nan
    elbows_over_sigma: float = np.nan
    """Raw errors over the standard deviations that the run tells, RMS over both sides."""

    knees_over_sigma: float = np.nan
    joints_over_sigma: float = np.nan
    wrong: int = 0
    """Frames not lost and 100 mm off on average."""

    wrong_flagged: int = 0
    limb_off: int = 0
    """Frames not lost with a joint 150 mm off."""

    limb_off_flagged: int = 0
    """Those in which such a joint is flagged."""

    false_flags: int = 0
    """Frames not lost with a joint flagged, but none 150 mm and a mean of less than 100 mm off."""

    confidence: float = np.nan
    """How sure the person's first start pose was."""

    start_mm: float = np.nan
    """How far the joints are off in the frame of that start, as it was tracked; mean. Unknown where it is lost."""

    start_farthest_mm: float = np.nan
    """The same of the farthest joint."""

    cpu_s: float = np.nan
    """Processor time of the whole run, its start with it."""

    frame_s: float = np.nan
    """The same of a frame, the median without the first one; unknown where frames are written in windows."""

    slow_frame_s: float = np.nan
    """The same that nine of ten frames stay under."""

    exchanged: str = ""
    """Name of the person whose place this one has."""

    @property
    def is_lost_throughout(self) -> bool:
        """Whether no frame has a pose, and so nothing an error."""
        return 0 < self.n_frames == self.lost

    @property
    def key(self) -> tuple[str, ...]:
        """What is not run again with the same code."""
        names = ("recording", "model", "acquired", "plates", "settings", "start", "stop", "code")
        return tuple(str(getattr(self, name)) for name in names)


def by_person(scores: Sequence[Score]) -> dict[tuple[str, str], list[Score]]:
    """(Recording, person) -> rows, in their order; a run that failed is of all who are known of its recording."""
    persons: dict[str, set[str]] = {}
    for one in scores:
        persons.setdefault(one.recording, set()).update({one.person} - {""})
    return {
        (recording, person): [one for one in scores if one.recording == recording and one.person in ("", person)]
        for recording, names in persons.items()
        for person in sorted(names or {""})
    }


def newest(scores: Sequence[Score]) -> list[Score]:
    """The rows of the code that each run was made with last."""
    last = {one.key[:-1]: one.code for one in scores}
    return [one for one in scores if one.code == last[one.key[:-1]]]


def read_scores(table: Path) -> list[Score]:
    """The rows of a file of scores; none if it is not there. Columns that it was written without are unknown."""
    if not table.is_file():
        return []
    with table.open(newline="", encoding="utf-8") as file:
        return [_from_cells(cells) for cells in csv.DictReader(file)]


def add_scores(table: Path, scores: Sequence[Score]) -> None:
    """Adds rows to a file of scores; one with other columns, of an earlier version, is written anew with these."""
    columns = [field.name for field in fields(Score)]
    if _columns(table) == columns:
        with table.open("a", newline="", encoding="utf-8") as file:
            csv.DictWriter(file, columns).writerows(asdict(one) for one in scores)
        return
    rows = [*read_scores(table), *scores]
    with replacing(table) as unfinished, unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(asdict(one) for one in rows)


def _columns(table: Path) -> list[str]:
    if not table.is_file():
        return []
    with table.open(newline="", encoding="utf-8") as file:
        return next(csv.reader(file), [])


def _from_cells(cells: dict[str, str]) -> Score:
    kinds = {field.name: str(field.type) for field in fields(Score) if field.name in cells}
    readers: dict[str, Callable[[str], Any]] = {"str": str, "int": int, "float": float, "bool": "True".__eq__}
    return Score(**{name: readers[kind](cells[name]) for name, kind in kinds.items()})
