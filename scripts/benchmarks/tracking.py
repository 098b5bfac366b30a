"""Milliseconds a frame by stage, from H.264 files to poses, beside the floor of decoding and edge detection."""

from __future__ import annotations

import os
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
from rich.console import Console
from rich.table import Table

from benchmarks.trial import Outcome, default_cycle, tracked
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Image
from tracker.images.reading.video import VideoReading
from tracker.synthesis.simulation.sequence import Recipe, simulate, write_sequence

# VGA and PAL.
SIZES = ((640, 480), (720, 576))
STAGES = ("waiting", "prediction", "synthesis", "observation", "estimation", "search", "refinement", "initialization")
"""The order in which stages are shown; others that the tracking tells follow."""


@dataclass(frozen=True)
class Recorded:
    """A simulated recording as video files."""

    folder: Path
    scene: Scene
    truth: Array
    """(T, dof) rad and m."""

    def reading(self, stride: int) -> VideoReading:
        """Every so many frames of the files."""
        background = str(self.folder / "background" / "{view}.png")
        path, rig = str(self.folder / "{view}.mp4"), self.folder / "rig.toml"
        return VideoReading(path=path, rig=rig, background=background, stride=stride)


@dataclass(frozen=True)
class Floor:
    """What no tracking on edges can do without: frames decoded, made grey and searched for edges; ms a frame."""

    decode_ms: float
    """Decoding alone."""

    wall_ms: float
    cpu_ms: float


@dataclass(frozen=True)
class Row:
    """One measured pass through the videos."""

    size: tuple[int, int]
    stride: int
    cores: int
    plates: bool
    outcome: Outcome
    floor: Floor

    @property
    def stages_ms(self) -> dict[str, float]:
        """Mean of each stage over all frames but the first, which is bootstrapped."""
        spent = Counter[str]()
        for seconds in self.outcome.stages[1:]:
            spent.update(seconds)
        return {stage: 1000 * value / (len(self.outcome.stages) - 1) for stage, value in spent.items()}

    @property
    def total_ms(self) -> float:
        """Wall time of a frame, with the wait for its images."""
        return 1000 * float(self.outcome.wall_s[1:].mean())

    @property
    def cpu_ms(self) -> float:
        """Processor time of a frame, of all threads."""
        return 1000 * float(self.outcome.cpu_s[1:].mean())


def compare(console: Console, n_frames: int, quick: bool) -> None:
    """Prints rows for each size: one core without and with plates, two cores, then lower frame rates."""
    sizes, n_frames = (((320, 240),), 6) if quick else (SIZES, n_frames)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for size in sizes:
            with console.status(f"writing videos, {size[0]}x{size[1]}"):
                recorded = _recorded(Path(folder, f"{size[0]}x{size[1]}"), size, n_frames)
            with console.status("compiling, warming up"):
                _pass(recorded, 1, 2, True, stop=3)
            for stride, cores, plates in ((1, 1, False), (1, 1, True), (1, 2, True), (2, 2, True), (5, 2, True)):
                with console.status(f"{size[0]}x{size[1]}, {25 / stride:g} fps, {cores} cores"), _pinned(cores):
                    outcome = _pass(recorded, stride, cores, plates)
                    rows.append(Row(size, stride, cores, plates, outcome, _floor(recorded, stride, cores)))
    console.print(_stage_table(rows))
    console.print(_whole_table(rows))
    console.print(
        "floor: decoding and cv2.Canny of the four grey images alone, same files, least of three passes; decoding runs "
        "ahead on threads of its own, and with two cores a look at the next images: only the waiting is part of all; "
        "cpu: processor time of all threads; the first frame, which starts at the true pose, is not timed",
        style="dim",
    )


def _recorded(folder: Path, size: tuple[int, int], n_frames: int) -> Recorded:
    recipe = Recipe("walking_on_the_spot", seconds=n_frames / 25, size=size)
    write_sequence(recipe, folder)
    simulation = simulate(recipe)
    return Recorded(folder, simulation.scene, simulation.poses[0])


@contextmanager
def _pinned(n_cores: int) -> Iterator[None]:
    """Holds this process on so many processor cores, where the system can; new threads stay with it."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    everything = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(everything)[:n_cores])
    try:
        yield
    finally:
        os.sched_setaffinity(0, everything)


def _pass(recorded: Recorded, stride: int, cores: int, plates: bool, stop: int | None = None) -> Outcome:
    """Tracks the videos from the true first pose on."""
    cv2.setNumThreads(1)
    sequence = recorded.reading(stride).open()
    truth = recorded.truth[::stride]
    known = sequence.plates if plates else (None,) * len(sequence.plates)
    cycle = default_cycle(truth[0], known, cores)
    frames = (frame for _, frame in zip(range(stop or len(truth)), sequence.frames(), strict=False))
    return tracked(frames, recorded.scene, truth, cycle)


def _floor(recorded: Recorded, stride: int, cores: int, repeats: int = 3) -> Floor:
    """Least times of several passes through the videos."""
    cv2.setNumThreads(cores)
    decoding = [_looked_at(recorded, stride, lambda image: None)[0] for _ in range(repeats)]
    wall, cpu = zip(*(_looked_at(recorded, stride, _edges) for _ in range(repeats)), strict=True)
    return Floor(min(decoding), min(wall), min(cpu))


def _looked_at(recorded: Recorded, stride: int, look: Callable[[Image], object]) -> tuple[float, float]:
    """Wall and processor time of a frame decoded and looked at, ms."""
    sequence = recorded.reading(stride).open()
    begin = time.perf_counter(), time.process_time()
    for frame in sequence.frames():
        for image in frame.images:
            assert image is not None
            look(image)
    spent = time.perf_counter() - begin[0], time.process_time() - begin[1]
    return 1000 * spent[0] / sequence.n_frames, 1000 * spent[1] / sequence.n_frames


def _edges(image: Image) -> Image:
    edges: Image = cv2.Canny(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), 50, 100)
    return edges


def _stage_table(rows: list[Row]) -> Table:
    found = {stage for row in rows for stage in row.stages_ms}
    stages = [stage for stage in STAGES if stage in found] + sorted(found - set(STAGES))
    table = _table("stages, ms a frame", (*stages, "other", "all"))
    for row in rows:
        spent = row.stages_ms
        times = [*(spent.get(stage, 0.0) for stage in stages), row.total_ms - sum(spent.values()), row.total_ms]
        table.add_row(*_label(row), *(f"{value:.1f}" for value in times), end_section=row.stride == 5)
    return table


def _whole_table(rows: list[Row]) -> Table:
    times = "decode alone", "floor", "all", "ratio", "floor cpu", "cpu", "ratio cpu", "frames/s"
    accuracy = "lost", "joints mean mm", "joints 95 % mm", "hinge RMS deg"
    table = _table("four views from H.264 files, ms a frame", (*times, *accuracy))
    for row in rows:
        floor = row.floor
        table.add_row(
            *_label(row),
            *(f"{value:.1f}" for value in (floor.decode_ms, floor.wall_ms, row.total_ms)),
            f"{row.total_ms / floor.wall_ms:.1f}x",
            *(f"{value:.1f}" for value in (floor.cpu_ms, row.cpu_ms)),
            f"{row.cpu_ms / floor.cpu_ms:.1f}x",
            f"{1000 / row.total_ms:.1f}",
            str(int(row.outcome.lost.sum())),
            *row.outcome.error_cells(),
            end_section=row.stride == 5,
        )
    return table


def _table(title: str, columns: tuple[str, ...]) -> Table:
    table = Table(title=title, title_justify="left")
    for column in ("size", "fps", "cores", "plates", *columns):
        table.add_column(column, justify="right")
    return table


def _label(row: Row) -> tuple[str, ...]:
    return f"{row.size[0]}x{row.size[1]}", f"{25 / row.stride:g}", str(row.cores), "yes" if row.plates else "no"
