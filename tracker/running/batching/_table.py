"""What is told of the recordings of a batch, and its table; what an earlier batch has finished."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from tracker.foundation.files import write_whole
from tracker.results.smoothed_result import FOLDER as SMOOTHED

State = Literal["done", "interrupted", "failed", "waiting"]
TABLE = "batch.csv"
"""In the folder of the batch."""

_COLUMNS = "name", "state", "frames", "lost", "doubtful", "with_ambiguous_limbs", "seconds", "folder", "fault"


@dataclass(frozen=True)
class Summary:
    """How one recording went."""

    name: str
    folder: Path
    state: State
    n_frames: int = 0
    n_lost: int = 0
    n_doubtful: int = 0
    n_ambiguous: int = 0
    """Frames in which some limb may be elsewhere."""

    seconds: float = 0.0
    fault: str = ""
    """Why it failed, in one line."""


def earlier_rows(path: Path) -> dict[str, dict[str, str]]:
    """The rows of an earlier batch's table by their names; none where it cannot be read."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return {row["name"]: row for row in csv.DictReader(file)}
    except (OSError, ValueError, KeyError, csv.Error):
        return {}


def finished(name: str, folder: Path, row: dict[str, str], asked: Mapping[str, Any]) -> Summary | None:
    """The summary of a complete run; None for any other, as of one whose end is extended.

    Args:
        name: of the recording.
        folder: of the run.
        row: what an earlier table says of it: run.json counts persons rather than frames, and knows no seconds.
        asked: its resolved configuration as it is now.
    """
    try:
        told = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        summary = told["summary"]
        if not told["complete"] or told["config"]["reading"].get("stop") != asked["reading"].get("stop"):
            return None
        if "smoothing" in asked and not (folder / SMOOTHED / "run.json").is_file():  # it is made last
            return None
        if row.get("state") == "done" and row.get("frames") == str(summary["frames"]):
            n_lost, n_doubtful, n_ambiguous = (int(row[column]) for column in _COLUMNS[3:6])
            return Summary(
                name, folder, "done", summary["frames"], n_lost, n_doubtful, n_ambiguous, float(row["seconds"])
            )
        counts, n_ambiguous = Counter(summary.get("by_status", {})), summary.get("frames_with_ambiguous_limbs", 0)
        return Summary(name, folder, "done", summary["frames"], counts["lost"], counts["doubtful"], n_ambiguous)
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
        return None


def write_table(path: Path, summaries: Iterable[Summary]) -> None:
    """Replaces the table as a whole, by names."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(_COLUMNS)
    for one in sorted(summaries, key=lambda summary: summary.name):
        counts = one.n_frames, one.n_lost, one.n_doubtful, one.n_ambiguous
        writer.writerow([one.name, one.state, *counts, f"{one.seconds:.1f}", one.folder, one.fault])
    write_whole(path, text.getvalue())
