"""Keypoints that a detector finds in a recording, written as OpenPose writes them; existing files stay."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tracker.bodies.keypoint_layouts.one_json import persons_in
from tracker.bodies.keypoint_layouts.orders import LAYOUTS
from tracker.bodies.keypoint_layouts.views import USUAL
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array, Image
from tracker.foundation.configuration.tables import build
from tracker.foundation.errors import ConfigError, SequenceError
from tracker.foundation.files import write_json, write_whole
from tracker.foundation.progress import Progress, silent
from tracker.foundation.source_files import json_of
from tracker.images.detection import Detection, Finder
from tracker.images.film import film_writer, write_picture
from tracker.images.reading import Reading
from tracker.images.reading import Sequence as Recording
from tracker.running.jobs import fingerprints, read_own

_HEIGHT_PX = 288
"""Height of a view in a picture of all views."""

# BGR: a limb whose sides a detector has exchanged is seen by its colour.
_LEFT, _RIGHT, _MIDDLE = (220, 120, 60), (40, 140, 255), (220, 220, 220)

_LIMBS = (
    *(("shoulder", "elbow"), ("elbow", "wrist"), ("shoulder", "hip"), ("hip", "knee"), ("knee", "ankle")),
    *(("ankle", "heel"), ("ankle", "toe"), ("eye", "ear")),
)
_BONES = (
    *((f"{side}_{one}", f"{side}_{other}") for side in ("left", "right") for one, other in _LIMBS),
    *(("left_shoulder", "right_shoulder"), ("left_hip", "right_hip")),
)


def drawn(frame: Frame, persons: list[list[Array]], names: tuple[str, ...]) -> Image:
    """All views of a frame side by side, left limbs blue, right ones orange; less sure keypoints are paler.

    Args:
        frame: the images; a missing one is black.
        persons: for each view (K, 3) pixel and confidence of each person.
        names: of the K keypoints.
    """
    cells = [_view(image, own, names) for image, own in zip(frame.images, persons, strict=True)]
    picture = np.hstack(cells)
    cv2.putText(
        picture, f"frame {frame.index}", (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA
    )
    return np.ascontiguousarray(picture[:, : picture.shape[1] // 2 * 2])


def _view(image: Image | None, persons: list[Array], names: tuple[str, ...]) -> Image:
    if image is None:
        return np.zeros((_HEIGHT_PX, _HEIGHT_PX, 3), dtype=np.uint8)
    scale = _HEIGHT_PX / image.shape[0]
    size = round(scale * image.shape[1]), _HEIGHT_PX
    small: Image = np.ascontiguousarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
    for person in persons:
        at = {name: mark for name, mark in zip(names, person, strict=True) if name and np.isfinite(mark).all()}
        for one, other in _BONES:
            if one in at and other in at:
                sure = min(at[one][2], at[other][2])
                start, end = (_whole((at[end][:2] + 0.5) * scale - 0.5) for end in (one, other))
                colour = _colour(one if one[:4] == other[:4] else "", sure)
                cv2.line(small, start, end, colour, 2, cv2.LINE_AA)
        for name, mark in at.items():
            cv2.circle(small, _whole((mark[:2] + 0.5) * scale - 0.5), 2, _colour(name, mark[2]), -1, cv2.LINE_AA)
    return small


def _colour(name: str, sure: float) -> tuple[float, ...]:
    full = _LEFT if name.startswith("left") else _RIGHT if name.startswith("right") else _MIDDLE
    return tuple(float(128 + (value - 128) * min(max(sure, 0.2), 1.0)) for value in full)


def _whole(place: Array) -> tuple[int, int]:
    x, y = np.clip(np.round(place), -10_000, 10_000).astype(int).tolist()
    return x, y


def pages(pictures: list[Image]) -> Image:
    """Pictures one below the other; a view that one of them lacks stays black there."""
    width = max(picture.shape[1] for picture in pictures)
    rows = [np.pad(one, ((0, 0), (0, width - one.shape[1]), (0, 0))) for one in pictures]
    whole: Image = np.vstack(rows)
    return whole


_NOTE = "detected.json"
"""File beside the views' folders: names the detector and the recording."""

_N_SHOWN = 6
"""Number of frames in the picture of the keypoints, spread over the recording."""

_NO_IMAGES = ("rig", "background", "masks", "occluders")
"""Settings of a reading that name files of no importance for keypoints."""


@dataclass(frozen=True)
class Detected:
    """Outcome of a detection."""

    pattern: str
    """Pattern of the folders, with `{view}`."""

    n_images: int
    n_new: int
    """Images searched this time."""

    somebody: dict[str, float]
    """For each view the share of its images with a person."""

    seconds: float
    files: tuple[Path, ...]
    """Pictures with keypoints."""


def detect(
    reading: Reading,
    detection: Detection,
    pattern: str,
    film: bool = False,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Detected:
    """Finds keypoints in all images of a recording that have none yet, and writes a file an image.

    Args:
        reading: the recording; its images are searched as recorded.
        detection: the detector.
        pattern: of the folders to write, with `{view}`.
        film: also write a film of all images with their keypoints.
        overwrite: find all anew.
        progress: gets the images searched.

    Raises:
        ConfigError: there are files of another detector or recording, or the detector is not installed.
        SequenceError: the recording cannot be read.
    """
    begin = time.perf_counter()
    sequence = _as_recorded(reading).open()
    views = _View.of(sequence, pattern)
    find, note = detection.open(), _note(reading, detection, sequence)
    _begin(views, pattern, note, overwrite)
    beside = Path(pattern).parent
    shown, counted, pictures = _shown(sequence.n_frames), _Counted(views), []
    files = [beside / "detected.jpg", *([beside / "detected.mp4"] if film else [])]
    with film_writer(files[-1], sequence.fps, preset="ultrafast") if film else contextlib.nullcontext() as add:
        for k, frame in enumerate(sequence.frames()):
            counted.add([view.found(frame, v, find) for v, view in enumerate(views)])
            rate = f"{counted.n_new / (time.perf_counter() - begin):.1f} images/s" if counted.n_new else ""
            progress("detecting", k + 1, sequence.n_frames, rate)
            if add is None and k not in shown:
                continue
            persons = [view.persons(frame, v) for v, view in enumerate(views)]
            picture = drawn(frame, persons, LAYOUTS[detection.layout])
            pictures += [picture] if k in shown else []
            if add is not None:
                add(picture)
    write_picture(files[0], pages(pictures))
    took = time.perf_counter() - begin
    return Detected(pattern, counted.n_images, counted.n_new, counted.shares(), took, tuple(files))


@dataclass(frozen=True)
class Wanted:
    """A detection as a configuration and a command line describe it."""

    reading: Reading
    detection: Detection
    pattern: str
    named: bool
    """Whether the configuration names these folders already."""


def wanted(config: Path, use: str, output: str | None = None, overrides: Sequence[str] = ()) -> Wanted:
    """The detection for the recording of a run.

    Args:
        config: of the run; only its recording and `keypoints` count.
        use: the detector.
        output: folders to write, with `{view}`; None for those in the configuration, else `USUAL` beside it.
        overrides: `section.key=value`; those of the section `detection` are for the detector.

    Raises:
        ConfigError: names section and key.
    """
    table, folder = read_own("track", config, overrides), config.resolve().parent
    if not isinstance(table.get("reading"), dict):
        raise ConfigError(f"{config}: no section [reading], which names the recording")
    reading = build("reading", table["reading"], f"{config.name} [reading]", folder)
    detector = build("detection", {"use": use, **table.get("detection", {})}, "--set detection", folder)
    files = table.get("keypoints")
    there = files.get("path") if isinstance(files, dict) else None
    named = None if there is None else str(folder / str(there))
    pattern = named or str(folder / USUAL)
    return Wanted(reading, detector, output or pattern, named is not None and output in (None, named))


@dataclass(frozen=True)
class _View:
    """Folder of the keypoints of a view."""

    name: str
    folder: Path

    @staticmethod
    def of(sequence: Recording, pattern: str) -> list[_View]:
        """Folders of the keypoints of a recording.

        Raises:
            ConfigError: the pattern does not give each view a folder.
        """
        if "{view}" not in Path(pattern).name or Path(pattern).suffix:
            raise ConfigError(f'"{pattern}": expected a folder for each view, e.g. {USUAL}: detectors write folders')
        return [_View(name, Path(pattern.replace("{view}", name))) for name in sequence.rig.names]

    def path(self, frame: Frame, v: int) -> Path:
        """The file of a frame's image, with the image's number."""
        return self.folder / f"{self.name}_{frame.first_number + frame.position(v):06d}.json"

    def found(self, frame: Frame, v: int, find: Finder) -> tuple[bool, int]:
        """Whether the image was searched now, and its number of persons; -1 without an image."""
        if frame.position(v) < 0 or v in frame.missing:
            return False, -1
        path = self.path(frame, v)
        if path.exists():
            return False, len(persons_in(path))
        image = frame.images[v]
        assert image is not None
        persons = find(image)
        write_whole(path, _text(persons))
        return True, len(persons)

    def persons(self, frame: Frame, v: int) -> list[Array]:
        """(K, 3) of each person in an image."""
        path = self.path(frame, v)
        return persons_in(path) if frame.position(v) >= 0 and path.exists() else []


class _Counted:
    """Counts the images searched, and those with a person."""

    def __init__(self, views: list[_View]) -> None:
        self.n_images = self.n_new = 0
        self._seen = {view.name: [0, 0] for view in views}

    def add(self, found: list[tuple[bool, int]]) -> None:
        """Counts the images of a frame."""
        for seen, (new, n_persons) in zip(self._seen.values(), found, strict=True):
            seen[0] += n_persons >= 0
            seen[1] += n_persons > 0
            self.n_images += n_persons >= 0
            self.n_new += new

    def shares(self) -> dict[str, float]:
        """For each view the share of images with a person."""
        return {name: there / max(n, 1) for name, (n, there) in self._seen.items()}


def _as_recorded(reading: Reading) -> Reading:
    """The reading of images as recorded: keypoints are in their pixels."""
    plain = {"downscale": 1, "gain": 1.0, "smoothing_px": 0.0, "masks": None, "background": "none", "occluders": None}
    plain |= {"align_background": False}
    settings: Any = reading
    changed: Reading = replace(settings, **{key: value for key, value in plain.items() if hasattr(reading, key)})
    return changed


def _note(reading: Reading, detection: Detection, sequence: Recording) -> dict[str, Any]:
    settings: Any = reading
    names = {field.name for field in dataclasses.fields(settings)}
    images = replace(settings, **{key: None for key in _NO_IMAGES if key in names})
    return {
        "detector": detection.about(),
        "layout": detection.layout,
        "images": fingerprints(images, sequence.rig.names),
    }


def _begin(views: list[_View], pattern: str, note: dict[str, Any], overwrite: bool) -> None:
    """Makes the folders, or checks that the same detector wrote their files for the same images."""
    path = Path(pattern).parent / _NOTE
    there = [view for view in views if view.folder.is_dir() and any(view.folder.iterdir())]
    earlier = json_of(path, SequenceError) if path.exists() else None
    if overwrite:
        for file in (file for view in views for file in view.folder.glob(f"{view.name}_[0-9]*.json")):
            file.unlink()
    elif there and not isinstance(earlier, dict):
        raise ConfigError(
            f"{there[0].folder}: holds files of another program: choose another --output, or --overwrite replaces them"
        )
    elif there and isinstance(earlier, dict):
        _check_same(earlier, note, path)
        note["images"] = {**earlier.get("images", {}), **note["images"]}
    for view in views:
        view.folder.mkdir(parents=True, exist_ok=True)
    write_json(path, note)


def _check_same(earlier: dict[str, Any], note: dict[str, Any], path: Path) -> None:
    """Refuses keypoints of another detector, and of videos that have changed since."""
    anew = "choose another --output, or --overwrite finds all anew"
    if earlier.get("detector") != note["detector"]:
        raise ConfigError(
            f"{path}: keypoints there are by {earlier.get('detector')}, not by {note['detector']}: {anew}"
        )
    images = earlier.get("images")
    for file, fingerprint in note["images"].items():
        if isinstance(images, dict) and images.get(file, fingerprint) != fingerprint:
            raise ConfigError(f"{path}: {file} is another file than when its keypoints were found: {anew}")


def _text(persons: Array) -> str:
    """A file in OpenPose's form; a keypoint that was not found is 0, 0, 0."""
    rounded = np.round(np.where(np.isfinite(persons).all(axis=-1, keepdims=True), persons, 0.0), 3)
    people = [{"person_id": [-1], "pose_keypoints_2d": person.ravel().tolist()} for person in rounded]
    return json.dumps({"version": 1.3, "people": people}) + "\n"


def _shown(n_frames: int) -> set[int]:
    """Numbers of the frames in the picture."""
    return set(np.linspace(0, max(n_frames - 1, 0), min(_N_SHOWN, n_frames)).round().astype(int).tolist())


def told(found: Detected) -> Iterator[str]:
    """The outcome, in a line for each view."""
    yield (
        f"{found.n_images} images, {found.n_new} of them searched in {found.seconds:.0f} s"
        + (", the others were done before" if found.n_new < found.n_images else "")
    )
    for view, share in found.somebody.items():
        yield f"{view}: a person found in {share:.0%} of the images"
