"""What more views, persons, pixels and frames cost: milliseconds of processor time a frame, and memory."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.trial import default_cycle
from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.foundation.resources import model_path
from tracker.images.plate import Plate
from tracker.results.recording import RunContext
from tracker.results.recording.csv_table import CsvTable
from tracker.results.recording.journal import Journal
from tracker.results.recording.run_json import RunJson
from tracker.synthesis.simulation.movements import poses_of
from tracker.synthesis.simulation.room import background_plates
from tracker.synthesis.simulation.sequence import Recipe, Simulation
from tracker.tracking.initialization import Stages
from tracker.tracking.sequence import track
from tracker.tracking.start import Start

_RENDERED = 12
"""Frames that are rendered; longer recordings play them forwards and backwards."""


@dataclass(frozen=True)
class Size:
    """A recording."""

    views: int = 4
    persons: int = 1
    size: tuple[int, int] = (720, 576)
    frames: int = _RENDERED


SIZES = (
    Size(),
    Size(views=8),
    Size(views=16),
    Size(persons=2),
    Size(persons=5),
    Size(size=(1920, 1080)),
    Size(size=(3840, 2160)),
    Size(size=(320, 240), frames=2000),
)
"""The first one is what the others are compared with."""

_QUICK = Size(size=(240, 192), frames=2), Size(size=(240, 192), frames=2, views=5, persons=2)
"""To see that it runs."""


@dataclass(frozen=True)
class Cost:
    """What tracking a recording took; the first frame is left out."""

    ms: Array
    """(T - 1,) processor time of each frame, all threads, without rendering."""

    grown_mib: float
    """Memory after the last frame over that after a tenth of them."""

    peak_mib: float
    lost: int
    """Frames and persons not found."""


class KnownStarts:
    """Starts everybody at the true pose."""

    def __init__(self, poses: tuple[Array, ...]) -> None:
        self._poses = poses

    def check(self, scene: Scene, plates: tuple[Plate | None, ...]) -> str:
        """Nothing can be wrong."""
        return "known poses"

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """See `tracker.tracking.initialization.Initialization.start`."""
        return Start(self._poses)


def compare(console: Console, quick: bool) -> None:
    """Prints a row for each size."""
    table = Table(title="sizes: from images in memory to tables on disk, no plates", title_justify="left")
    for column in (
        "views",
        "persons",
        "px",
        "frames",
        "ms/frame",
        "ratio",
        "last/first quarter",
        "MiB",
        "+MiB",
        "lost",
    ):
        table.add_column(column, justify="right")
    first = None
    for size in _QUICK if quick else SIZES:
        # a process of its own tells its own memory
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            cost = pool.submit(cost_of, size).result()
        usual = float(np.median(cost.ms))
        first = first or usual
        quarter = max(1, len(cost.ms) // 4)
        drift = float(np.median(cost.ms[-quarter:]) / np.median(cost.ms[:quarter]))
        shape = f"{size.size[0]}x{size.size[1]}"
        numbers = (
            f"{usual:.0f}",
            f"{usual / first:.1f}",
            f"{drift:.2f}",
            f"{cost.peak_mib:.0f}",
            f"{cost.grown_mib:+.0f}",
        )
        table.add_row(str(size.views), str(size.persons), shape, str(size.frames), *numbers, str(cost.lost))
    console.print(table)


def cost_of(size: Size) -> Cost:
    """Tracks a simulated recording of a size."""
    simulation = _simulation(size)
    rendered = list(itertools.islice(simulation.frames(), _RENDERED))
    starts = tuple(poses[0] for poses in simulation.poses)
    cycle = replace(default_cycle(starts[0], (None,) * size.views), initialization=KnownStarts(starts))
    times, memory, lost = [], [], 0
    with tempfile.TemporaryDirectory() as folder:
        context = RunContext("sizes", Path(folder), simulation.scene, 25.0, 0.04, size.frames)
        recorders = [recording.begin(context) for recording in (CsvTable(), RunJson(), Journal())]
        begin = time.process_time()
        for step in track(_played(rendered, size.frames), simulation.scene, cycle):
            for recorder in recorders:
                recorder.write(step)
            lost += sum(estimate.lost for estimate in step.estimates)
            times.append(time.process_time() - begin)
            memory.append(_resident_mib())
            begin = time.process_time()
        for recorder in recorders:
            recorder.finish()
    grown = memory[-1] - memory[len(memory) // 10]
    return Cost(1000 * np.array(times[1:]), grown, max(memory), lost)


def _played(rendered: list[Frame], n_frames: int) -> Iterator[Frame]:
    there_and_back = itertools.cycle([*rendered, *rendered[-2:0:-1]])
    for k, frame in enumerate(itertools.islice(there_and_back, n_frames)):
        yield replace(frame, index=k, time_s=k / 25)


def _simulation(size: Size) -> Simulation:
    """Cameras on a circle within the room, persons beside each other."""
    recipe = Recipe("arm_swing", seconds=_RENDERED / 25, size=size.size, persons=size.persons)
    angles = 2 * np.pi * (np.arange(size.views) + 0.4) / size.views
    target, focal = np.array([0.0, 0.0, 0.95]), 850.0 * size.size[0] / 720
    rig = Rig(
        tuple(
            Camera.looking_at(f"view{k}", size.size, focal, (4.4 * np.cos(a), 4.0 * np.sin(a), 2.3), target)
            for k, a in enumerate(angles)
        )
    )
    body = load_body(model_path(recipe.model))
    places = [(1.3 * (k - (size.persons - 1) / 2), 0.5 * (-1) ** k * (size.persons > 2)) for k in range(size.persons)]
    poses = tuple(poses_of(recipe.movement, body, recipe.times, 40.0 * k, place) for k, place in enumerate(places))
    persons = tuple(Person(f"person{k + 1}", body, one[0]) for k, one in enumerate(poses))
    plates = tuple(Plate(picture) for picture in background_plates(rig, recipe.seed))
    return Simulation(recipe, Scene(persons, rig), poses, plates)


def _resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
