"""The journal of a run: one exact line a frame, from which an interrupted run resumes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from tracker.bodies.scene import Scene
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import SequenceError
from tracker.foundation.files import GrowingFile
from tracker.results.recording import RunContext
from tracker.results.recording._journal_line import as_kept, line_of, replay_of
from tracker.tracking.trajectory import Replay, Step

__all__ = ["Expected", "Journal", "OpenJournal", "as_kept", "line_of", "open_journal"]

FILE = "steps.jsonl"
_LONGEST = 2**20
"""Largest number of bytes of a line: a hundred persons."""


@component
class Journal:
    """`steps.jsonl`: all data that a resumed run needs, exact to the last bit; 2 KB a frame and person.

    Arrays are little-endian float64 in base 85, as Python's `base64.b85decode` reads them; `variances` are bfloat16,
    `correlations` are partial ones in small steps, compressed (zlib): see `tracker.results.recording._journal_line`.
    `account` is compressed, too: distances of the views, then four numbers a part, as in `measures.account.Account`;
    `not_shown` and `hidden` list view and part. `as_tracked` has the poses from which tracking goes on, if the
    estimates were brought to another moment.
    """

    def begin(self, run: RunContext) -> JournalRecorder:
        """Opens the journal; the lines of an interrupted run stay, except damaged ones at the end."""
        path = run.folder / FILE
        if run.resumed:
            with path.open("r+b") as file:
                kept = itertools.islice(_lines(file), len(run.resumed))
                file.truncate(sum(len(line) for _, line in kept))
        return JournalRecorder(path, run.resumed)


class JournalRecorder:
    """The open journal."""

    def __init__(self, path: Path, present: frozenset[int]) -> None:
        self._present, self._file = present, GrowingFile(path, append=bool(present))

    def write(self, step: Step) -> None:
        """Adds one line for a new frame; a provisional frame is left to the resumed run."""
        if step.frame.index not in self._present and not step.provisional:
            self._file.add(line_of(step))

    def finish(self) -> tuple[Path, ...]:
        """Names the journal."""
        return (self._file.take_place(),)


@dataclass(frozen=True)
class OpenJournal(Mapping[int, Replay]):
    """The frames of a run; each is read on demand, so memory does not grow with them."""

    path: Path
    n_bytes: int
    """Length of the good lines."""

    fault: str
    """Why the rest cannot be used; empty without a rest."""

    _begins: dict[int, int] = field(default_factory=dict)
    """Frame -> begin of its line."""

    def __getitem__(self, frame: int) -> Replay:
        """One frame."""
        with self.path.open("rb") as file:
            file.seek(self._begins[frame])
            return replay_of(file.readline(_LONGEST))

    def __iter__(self) -> Iterator[int]:
        """Frame numbers in order."""
        return iter(self._begins)

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._begins)


@dataclass(frozen=True)
class Expected:
    """Expected content of a run's journal."""

    dofs: tuple[int, ...]
    """Parameters of each person."""

    n_parts: tuple[int, ...]
    n_joints: tuple[int, ...]
    """Landmarks of each person."""

    n_views: int
    start: int | None = None
    """First frame; None for any."""

    stride: int = 1

    @staticmethod
    def of(scene: Scene, start: int | None = None, stride: int = 1) -> Expected:
        """Content that a run of a scene writes."""
        bodies = [person.body for person in scene.persons]
        dofs, n_parts = tuple(body.dof for body in bodies), tuple(len(body.parts) for body in bodies)
        n_joints = tuple(len(body.landmarks) for body in bodies)
        return Expected(dofs, n_parts, n_joints, len(scene.rig), start, stride)

    def fault(self, replay: Replay, before: int | None) -> str:
        """Why a line cannot be of this run; empty if it can.

        Args:
            replay: content of the line.
            before: frame of the line before it.
        """
        after = self.start if before is None else before + self.stride
        if self.start is not None and replay.index != after:
            return f"frame {replay.index} where frame {after} is expected"
        if tuple(len(estimate.q) for estimate in replay.estimates) != self.dofs:
            return "poses of other models"
        for estimate, n_parts, n_joints in zip(replay.estimates, self.n_parts, self.n_joints, strict=True):
            account, sigmas_m = estimate.account, estimate.joint_sigmas_m
            if len(account.per_view_px) != self.n_views or len(account.per_part_px) != n_parts:
                return "other views or parts"
            if sigmas_m is not None and len(sigmas_m) != n_joints:
                return "sigmas of other joints"
        if replay.overlap is not None and len(replay.overlap) != self.n_views:
            return "other views"
        return ""


def open_journal(folder: Path, expected: Expected | None = None, name: str = FILE) -> OpenJournal:
    """The journal of an interrupted run, with every line checked.

    Args:
        folder: result folder.
        expected: content; None for any.
        name: of the file.

    Returns:
        The frames up to the first line that is torn, damaged or of another run.

    Raises:
        SequenceError: there is no journal, or not even its first line can be used.
    """
    path = folder / name
    if not path.is_file():
        # the configuration is kept a moment before the journal is begun: a kill in between leaves this
        raise SequenceError(
            f"{folder}: no {name} in it: the run was stopped before it computed anything, or kept no journal: remove "
            "it, and run without --resume"
        )
    begins: dict[int, int] = {}
    before, end, fault = None, 0, ""
    try:
        with path.open("rb") as file:
            for begin, line in _lines(file):
                replay, fault = _checked(line, expected, before)
                if replay is None:
                    break
                begins[replay.index], before, end = begin, replay.index, begin + len(line)
    except OSError as error:
        raise SequenceError(f"{path}: cannot read the journal: {error.strerror}") from error
    if fault:
        fault = f"line {len(begins) + 1} is damaged or of another run: {fault}"
    if fault and not begins and b"\n" in line:
        raise SequenceError(f"{path}: {fault}; run without --resume")
    return OpenJournal(path, end, fault, begins)


def _lines(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Lines with their begins; a line that is too long is cut."""
    begin = 0
    while line := file.readline(_LONGEST):
        yield begin, line
        begin += len(line)


def _checked(line: bytes, expected: Expected | None, before: int | None) -> tuple[Replay | None, str]:
    """Content of a line, or why it cannot be used."""
    if not line.endswith(b"\n"):
        return None, "it is torn"
    try:
        replay = replay_of(line)
    except SequenceError as error:
        return None, str(error)
    except (KeyError, AttributeError, TypeError, ValueError, OverflowError, RecursionError) as error:
        return None, f"not a line of a journal ({type(error).__name__}: {str(error)[:80]})"
    if before is not None and replay.index <= before:
        return None, f"frame {replay.index} after frame {before}"
    fault = "" if expected is None else expected.fault(replay, before)
    return (None, fault) if fault else (replay, "")
