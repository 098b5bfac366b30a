"""CPU seconds of whole runs with defaults, over those of decoding the same images and one Canny of each."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import cv2
import tomli_w
from rich.console import Console
from rich.table import Table

from benchmarks import booked_run
from benchmarks.checkout import Code
from benchmarks.recorded import Recorded, recorded
from tracker.foundation.errors import SequenceError
from tracker.synthesis.simulation.sequence import Recipe, write_sequence

_SPLIT = ("importing", "opening", "start", "body, tracked", "body, fit", "body, things", "pass")
_WRITING = ("writing", "writing, end")
_CANNY = 60, 120
"""Thresholds: as many edges as the tracking is offered."""


@dataclass(frozen=True)
class Row:
    """One run."""

    name: str
    plates: bool
    n_frames: int
    seconds: dict[str, float]
    """CPU seconds by stage, of all threads and processes."""

    peak_gib: float
    floor_s: float
    """CPU seconds of decoding and edges, mean of before and after the run."""

    wall_s: float

    @property
    def cpu_s(self) -> float:
        """CPU seconds of everything."""
        return sum(self.seconds.values())


@dataclass(frozen=True)
class Film:
    """A recording as files."""

    recording: Recorded
    n_frames: int

    def floor_s(self) -> float:
        """CPU seconds of decoding its frames and one Canny of each image, on one thread."""
        n_threads = cv2.getNumThreads()
        cv2.setNumThreads(1)
        begin = time.process_time()
        for path in self.recording.videos():
            with av.open(str(path)) as container:
                stream = container.streams.video[0]
                stream.thread_count = 1
                for frame, _ in zip(container.decode(stream), range(self.n_frames), strict=False):
                    cv2.Canny(frame.to_ndarray(format="gray"), *_CANNY)
        spent = time.process_time() - begin
        cv2.setNumThreads(n_threads)
        return spent

    def there_and_back(self, n_frames: int, folder: Path) -> Film:
        """The same recording shown forwards and backwards until it has so many frames, in files of its own."""
        folder.mkdir()
        for path in self.recording.videos():
            with av.open(str(path)) as container:
                rate = container.streams.video[0].average_rate or Fraction(25)
                images = [frame.to_ndarray(format="yuv420p") for frame in container.decode(video=0)][: self.n_frames]
            way = [*range(len(images)), *range(len(images) - 2, 0, -1)]
            with av.open(str(folder / path.name), "w") as container:
                stream = container.add_stream("libx264", rate=rate, options={"crf": "14", "preset": "veryfast"})
                stream.height, stream.width = images[0].shape[0] * 2 // 3, images[0].shape[1]
                stream.pix_fmt = "yuv420p"
                for k in range(n_frames):
                    frame = av.VideoFrame.from_ndarray(images[way[k % len(way)]], format="yuv420p")
                    container.mux(stream.encode(frame))
                container.mux(stream.encode(None))
        suffix = self.recording.videos()[0].suffix
        reading = {**self.recording.reading, "path": str(folder / f"{{view}}{suffix}")}
        name = f"{self.recording.name}, encoded anew"
        told = {**self.recording.__dict__, "name": name, "reading": reading, "n_frames": n_frames}
        return Film(Recorded(**told), n_frames)

    def run(self, code: Code, plates: bool, folder: Path, quick: bool) -> Row:
        """A whole run with defaults.

        Raises:
            SequenceError: it failed.
        """
        folder.mkdir()
        reading = {**self.recording.reading, **(self.recording.plates if plates else {}), "stop": self.n_frames}
        fixed = {"shape": "model"} if quick else {}
        persons = [{"name": k, "model": "human", "stature_m": m, **fixed} for k, m in self.recording.statures_m.items()]
        config = {"name": self.recording.name, "persons": persons, "reading": reading}
        if quick:
            config |= {"recordings": {"report": False, "plots": False}, "evidence": "contours"}
            config |= {"initialization": {"use": "pca", "hypotheses": 1, "turn_step_deg": 90.0}}
            config |= {"estimation": {"use": "twist_icp"}, "loss": {"rehearse": 0}}
        (folder / "config.toml").write_text(tomli_w.dumps(config), encoding="utf-8")
        before_s, begin = self.floor_s(), time.perf_counter()
        failed = code.run(["run", "config.toml", "--output", "result"], folder, "benchmarks.booked_run")
        wall_s = time.perf_counter() - begin
        if failed:
            raise SequenceError(f"{self.recording.name}: {failed}")
        booked = json.loads((folder / booked_run.FILE).read_text(encoding="utf-8"))
        floor_s = (before_s + self.floor_s()) / 2
        return Row(self.recording.name, plates, self.n_frames, booked["seconds"], booked["peak_gib"], floor_s, wall_s)


def compare(console: Console, root: Path | None, only: str, python_path: Path, quick: bool) -> None:
    """Prints a row a run: with plates, without, and with plates encoded anew, once longer by frames that show the same.

    Args:
        console: where to.
        root: the folder of recordings; None for a simulated one.
        only: the recording's name.
        python_path: the checkout that is run.
        quick: only to see that it runs.
    """
    code, rows = Code(python_path.resolve()), list[Row]()
    with tempfile.TemporaryDirectory(prefix="bodytrack-") as kept:
        folder = Path(kept)
        film = _simulated(folder / "simulated", 5) if quick or root is None else _film(root, only)
        runs = [(film, True), *([] if quick else [(film, False)])]
        if not quick:
            # both by one encoder: frames of the recording's own may cost more or less to decode than these
            encoded = [film.there_and_back(n * film.n_frames, folder / f"films{n}") for n in (1, 4)]
            runs += [(one, True) for one in encoded]
        for k, (one, plates) in enumerate(runs):
            with _told(console, f"{one.recording.name}, {one.n_frames} frames{'' if plates else ', no plates'}"):
                rows.append(one.run(code, plates, folder / f"run{k}", quick))
    console.print(_table(rows))
    if not quick:
        short, longer = rows[-2:]
        more = longer.n_frames - short.n_frames
        frame_ms = 1000 * (longer.cpu_s - short.cpu_s) / more
        floor_ms = 1000 * (longer.floor_s - short.floor_s) / more
        console.print(
            f"one more frame: {frame_ms:.0f} ms of CPU, {frame_ms / floor_ms:.1f} times its floor of {floor_ms:.1f} ms"
        )
    console.print(
        "CPU seconds of all threads; floor: decoding the same files and one cv2.Canny of each image, in this run; what "
        "threads do beside the main one is booked to the stage that the main one is in",
        style="dim",
    )


@contextmanager
def _told(console: Console, what: str) -> Iterator[None]:
    with console.status(what):
        yield


def _film(root: Path, only: str) -> Film:
    found = next((one for one in recorded(root)[0] if one.name == only), None)
    if found is None:
        raise SequenceError(f'no recording "{only}" with a truth in {root}')
    return Film(found, min(found.n_frames, 100))


def _simulated(folder: Path, n_frames: int) -> Film:
    write_sequence(Recipe("walking_on_the_spot", seconds=n_frames / 25, size=(320, 240)), folder)
    reading = {"use": "video", "path": str(folder / "{view}.mp4"), "rig": str(folder / "rig.toml")}
    plates = {"background": str(folder / "background" / "{view}.png")}
    return Film(
        Recorded("simulated", folder / "truth_joints.csv", reading, plates, {"one": 1.75}, {}, n_frames), n_frames
    )


def _table(rows: list[Row]) -> Table:
    table = Table(title="CPU seconds of whole runs")
    for column in ("recording", "frames", "plates", *_SPLIT, "writing", "all", "floor", "times", "cores", "peak GiB"):
        table.add_column(column, justify="left" if column == "recording" else "right")
    for row in rows:
        split = [f"{row.seconds.get(stage, 0.0):.1f}" for stage in _SPLIT]
        split.append(f"{sum(row.seconds.get(stage, 0.0) for stage in _WRITING):.1f}")
        table.add_row(
            row.name,
            str(row.n_frames),
            "yes" if row.plates else "no",
            *split,
            f"{row.cpu_s:.1f}",
            f"{row.floor_s:.2f}",
            f"{row.cpu_s / row.floor_s:.1f}",
            f"{row.cpu_s / row.wall_s:.2f}",
            f"{row.peak_gib:.2f}",
        )
    return table
