"""The journal of a run: one exact line a frame, from which an interrupted run resumes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from tracker.account import Account
from tracker.arrays import Array
from tracker.components import component
from tracker.errors import SequenceError
from tracker.estimate import Estimate, Status
from tracker.files import write_whole
from tracker.recording import RunContext
from tracker.trajectory import Replay, Step

FILE = "steps.jsonl"
_LISTS = "per_view_px", "per_part_px", "visible_px", "explained_px", "missed_px"


@component
class Journal:
    """`steps.jsonl`: every number of every estimate, exact to the last bit."""

    def begin(self, run: RunContext) -> JournalRecorder:
        """Opens the journal; the lines of an interrupted run stay, but for a torn last one."""
        path = run.folder / FILE
        if run.resumed:
            lines = path.read_text(encoding="utf-8").splitlines()[: len(run.resumed)]
            write_whole(path, "".join(f"{line}\n" for line in lines))
        return JournalRecorder(path, run.resumed)


class JournalRecorder:
    """The open journal."""

    def __init__(self, path: Path, present: frozenset[int]) -> None:
        self._path, self._present = path, present
        self._file: TextIO = path.open("a" if present else "w", encoding="utf-8")

    def write(self, step: Step) -> None:
        """Adds one line for a frame that is not in it yet."""
        if step.frame.index in self._present:
            return
        line = {
            "frame": step.frame.index,
            "time_s": step.frame.time_s,
            "seconds": step.seconds,
            "overlap": None if step.overlap is None else step.overlap.tolist(),
            "untrusted": {str(v): fault for v, fault in step.untrusted.items()},
            "estimates": [_to_json(estimate) for estimate in step.estimates],
        }
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()

    def finish(self) -> tuple[Path, ...]:
        """Closes the journal."""
        self._file.close()
        return (self._path,)


def read_journal(folder: Path) -> list[Replay]:
    """The frames of an interrupted run; a last line torn by a kill is left out.

    Args:
        folder: result folder.

    Raises:
        SequenceError: no journal there, or a line before the last is damaged.
    """
    path = folder / FILE
    if not path.is_file():
        raise SequenceError(f"{path}: no journal to resume from; run without --resume")
    lines = path.read_text(encoding="utf-8").splitlines()
    replays = []
    for n, line in enumerate(lines, start=1):
        try:
            replays.append(_replay(json.loads(line)))
        except (json.JSONDecodeError, KeyError, AttributeError, TypeError, ValueError) as error:
            if n < len(lines):
                raise SequenceError(f"{path}: line {n} is damaged ({error}); run without --resume") from error
    return replays


def _to_json(estimate: Estimate) -> dict[str, Any]:
    return {
        "q": estimate.q.tolist(),
        "covariance": estimate.covariance.tolist(),
        "account": {
            "distance_px": estimate.account.distance_px,
            **{name: getattr(estimate.account, name).tolist() for name in _LISTS},
        },
        "penalty_px": estimate.penalty_px,
        "evaluations": estimate.evaluations,
        "search_s": estimate.search_s,
        "status": str(estimate.status),
        "doubtful": estimate.doubtful,
        "ambiguous": list(estimate.ambiguous),
    }


def _replay(entry: dict[str, Any]) -> Replay:
    overlap = entry["overlap"]
    return Replay(
        index=int(entry["frame"]),
        time_s=float(entry["time_s"]),
        estimates=tuple(_estimate(values) for values in entry["estimates"]),
        seconds={str(stage): float(value) for stage, value in entry["seconds"].items()},
        overlap=None if overlap is None else _array(overlap),
        untrusted={int(v): str(fault) for v, fault in entry["untrusted"].items()},
    )


def _estimate(values: dict[str, Any]) -> Estimate:
    return Estimate(
        q=_array(values["q"]),
        covariance=_array(values["covariance"]),
        account=Account(
            distance_px=float(values["account"]["distance_px"]),
            **{name: _array(values["account"][name]) for name in _LISTS},
        ),
        penalty_px=float(values["penalty_px"]),
        evaluations=int(values["evaluations"]),
        search_s=float(values["search_s"]),
        status=Status(values["status"]),
        doubtful=bool(values["doubtful"]),
        ambiguous=tuple(str(group) for group in values["ambiguous"]),
    )


def _array(values: list[Any]) -> Array:
    return np.array(values, dtype=np.float64)
