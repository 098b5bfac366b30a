"""What changes that mean nothing change: the same stretch begun a frame off, in other orders, as JPEG, in a mirror."""

from __future__ import annotations

import csv
import os
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.checkout import Code
from benchmarks.recorded import Recorded, recorded
from benchmarks.recording_run import Asked, scored
from benchmarks.recordings import known
from benchmarks.scores import Score, add_scores
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig, save_rig
from tracker.foundation.arrays import Image
from tracker.images.reading.images import intact_image

_FIRST, _N_FRAMES = 20, 40
"""The stretch."""


@dataclass(frozen=True)
class Change:
    """A change that means nothing."""

    name: str
    frames: int = 0
    """By how many the stretch begins later."""

    made: Callable[[Recorded, Path], Recorded] = lambda one, folder: one
    """The recording after it, from an empty folder for its files."""


def _views_backwards(one: Recorded, folder: Path) -> Recorded:
    names = [path.stem for path in one.videos()]
    return replace(one, reading={**one.reading, "views": names[::-1]})


def _persons_backwards(one: Recorded, folder: Path) -> Recorded:
    return replace(one, statures_m=dict(reversed(one.statures_m.items())))


def _jpeg(quality: int) -> Callable[[Recorded, Path], Recorded]:
    def made(one: Recorded, folder: Path) -> Recorded:
        return _written(one, folder, "jpg", lambda image: image, [cv2.IMWRITE_JPEG_QUALITY, quality])

    return made


def _mirrored(one: Recorded, folder: Path) -> Recorded:
    """Left for right: images, plates, cameras and truth, beyond the plane y = 0."""
    made = _written(one, folder, "png", flipped, [])
    rig = load_rig(Path(str(one.reading["rig"])))
    save_rig(Rig(tuple(mirrored_camera(camera) for camera in rig.cameras)), folder / "rig.toml")
    for path in one.videos():
        plate = Path(str(one.plates["background"]).replace("{view}", path.stem))
        cv2.imwrite(str(folder / f"{path.stem}_plate.png"), flipped(intact_image(plate)))
    with one.truth.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row.update(joint=other_side(row["joint"]), y=str(-float(row["y"])))
    with (folder / "truth.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, rows[0])
        table.writeheader()
        table.writerows(rows)
    reading = {**made.reading, "rig": str(folder / "rig.toml")}
    plates = {"background": str(folder / "{view}_plate.png")}
    return replace(made, reading=reading, plates=plates, truth=folder / "truth.csv")


CHANGES = (
    Change("as it is"),
    Change("a frame before", -1),
    Change("a frame later", 1),
    Change("views backwards", made=_views_backwards),
    Change("persons backwards", made=_persons_backwards),
    Change("JPEG 95", made=_jpeg(95)),
    Change("JPEG 94", made=_jpeg(94)),
    Change("mirrored", made=_mirrored),
)
"""What should change nothing, the recording as it is first."""


def flipped(image: Image) -> Image:
    """The image in a mirror."""
    return np.ascontiguousarray(image[:, ::-1])


def mirrored_camera(camera: Camera) -> Camera:
    """The camera that takes the flipped images of a world mirrored in the plane y = 0."""
    matrix, distortion = camera.matrix.copy(), camera.distortion.copy()
    matrix[0, 2] = camera.size[0] - 1 - matrix[0, 2]
    matrix[0, 1], distortion[3] = -matrix[0, 1], -distortion[3]
    motion = np.diag([-1.0, 1, 1, 1]) @ camera.camera_from_world @ np.diag([1.0, -1, 1, 1])
    return replace(camera, matrix=matrix, distortion=distortion, camera_from_world=motion)


def other_side(name: str) -> str:
    """The name of the other side's joint or angle: `left_hip` and `right_hip`, or `l_hip` and `r_hip`."""
    sides = {"left": "right", "right": "left", "l_": "r_", "r_": "l_"}
    return re.sub(r"left|right|^[lr]_", lambda found: sides[found[0]], name)


def compare(console: Console, only: str, plates: bool, checkout: Path, output: Path, quick: bool = False) -> None:
    """Prints a row a recording and person, and what is largest less what is least.

    Args:
        console: where to.
        only: part of the names of recordings.
        plates: whether the runs know plates.
        checkout: whose package is run.
        output: keeps each run's folder and `scores.csv`.
        quick: four frames: only to see that it runs.
    """
    if "BODYTRACK_DATA" not in os.environ:
        console.print("BODYTRACK_DATA is not set: no recordings to track")
        return
    code, rows = Code(checkout.resolve()), dict[tuple[str, str], list[Score]]()
    output.mkdir(parents=True, exist_ok=True)
    n_frames = 4 if quick else _N_FRAMES
    for one in recorded(Path(os.environ["BODYTRACK_DATA"]).resolve())[0]:
        if only.lower() not in one.name.lower():
            continue
        for change in CHANGES:
            if change.made is _persons_backwards and len(one.statures_m) < 2:
                continue
            if not one.plates and (plates or change.made is _mirrored):
                continue
            with console.status(f"{one.name}, {change.name}"):
                scores = _scores(one, change, plates, n_frames, code, output)
            for score in scores:
                rows.setdefault((one.name, score.person), []).append(replace(score, recording=change.name))
    console.print(_table(rows, code))


def _scores(one: Recorded, change: Change, plates: bool, n_frames: int, code: Code, output: Path) -> list[Score]:
    folder = output / "made" / f"{one.name}_{change.name.replace(' ', '_')}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    first = _FIRST + change.frames
    made = replace(change.made(one, folder.resolve()), name=folder.name)
    asked = Asked("human", False, plates, (), first, min(first + n_frames, one.n_frames))
    found = known(output / "scores.csv", made, asked, code)
    if not found:
        found = scored(made, asked, code, output.resolve())
        add_scores(output / "scores.csv", found)
    shutil.rmtree(folder)
    return list(found)


def _written(
    one: Recorded, folder: Path, suffix: str, change: Callable[[Image], Image], options: list[int]
) -> Recorded:
    """The recording with its images, changed, as files."""
    rate = 25.0
    for path in one.videos():
        film = cv2.VideoCapture(str(path))
        rate = film.get(cv2.CAP_PROP_FPS)
        for n, image in enumerate(_images(film, _FIRST + _N_FRAMES)):
            cv2.imwrite(str(folder / f"{path.stem}_{n:03d}.{suffix}"), change(image), options)
    reading = {**one.reading, "use": "images", "path": str(folder / f"{{view}}_{{frame}}.{suffix}"), "fps": rate}
    return replace(one, reading=reading)


def _images(film: cv2.VideoCapture, most: int) -> Iterator[Image]:
    for _ in range(most):
        there, image = film.read()
        if not there:
            return
        yield image


def _table(rows: dict[tuple[str, str], list[Score]], code: Code) -> Table:
    told = "mm (offsets removed), frames falsely in doubt, off, silent of these"
    table = Table(title=f"changes that mean nothing, commit {code.commit}: {told}", title_justify="left")
    table.add_column("recording", no_wrap=True)
    for change in CHANGES:
        table.add_column(change.name)
    table.add_column("spread")
    for (recording, person), scores in rows.items():
        by_change = {score.recording: _told(score) for score in scores}
        spreads = [np.ptp([getattr(score, field) for score in scores]) for field in ("mean_mm", "removed_mm")]
        cells = [by_change.get(change.name, "-") for change in CHANGES]
        table.add_row(f"{recording} {person}", *cells, f"{spreads[0]:.1f} ({spreads[1]:.1f})")
    return table


def _told(score: Score) -> str:
    if score.failed:
        return score.failed
    silent = score.limb_off - score.limb_off_flagged
    return f"{score.mean_mm:.1f} ({score.removed_mm:.1f}), {score.false_flags}, {score.limb_off}, {silent}"
