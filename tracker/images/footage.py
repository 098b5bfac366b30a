"""Footage in a folder of recordings: videos, or numbered images, one view each, and sample pictures of them."""

from __future__ import annotations

import contextlib
import itertools
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Literal, TypeVar

import av
import numpy as np
from av.container import InputContainer
from av.video.stream import VideoStream

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Image
from tracker.foundation.errors import SequenceError
from tracker.images.film import film_of, has_clock, opened
from tracker.images.reading.images import intact_image

VIDEOS = {".mp4", ".avi", ".mov", ".mkv", ".m4v", ".mpg", ".mpeg", ".webm", ".mts", ".m2ts", ".ts", ".wmv"}
VIDEOS |= {".h264", ".264", ".h265", ".265", ".hevc", ".mjpeg", ".mjpg"}
"""The latter without a container, as small computers write them."""
PICTURES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"}

FRAME = "{frame}"
"""In a path: the number of an image."""
_NUMBER = re.compile(r"(.*?)(\d+)(\D*)")
"""The last number in a name is the frame's."""

_FEWEST = 2
"""Least number of images of a recording, and largest number of folders of cameras."""

PLATE_WORDS = "background", "backdrop", "plate", "empty", "bg"
KEYPOINT_WORDS = "keypoint", "detection", "openpose"
_CALIBRATION_WORDS = "calib", "charuco", "chess", "checker", "board", "intrinsic", "extrinsic"
_BESIDE_WORDS = (*PLATE_WORDS, *KEYPOINT_WORDS, *_CALIBRATION_WORDS)
"""Names of files and folders beside a recording: the empty room, a detector's keypoints, targets for calibration."""

_CAMERA_WORDS = "cam", "camera", "view", "gopro", "webcam", "phone", "kinect"
"""Names of folders, one a camera, that may hold several videos."""

_DEEPEST = 4
"""Folders between that of a camera and its video: OpenCap has `Videos/Cam0/InputMedia/TRIAL/TRIAL.mov`."""

_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+")


@dataclass(frozen=True)
class Footage:
    """One view."""

    path: Path
    """The video, or the images with `{frame}` for their number."""

    view: str
    size: tuple[int, int]
    fps: float
    """Frame rate; 0 for images and for streams without a container, which have none."""

    n_frames: int
    """Number of frames; 0 if the header has none."""


def listed(folder: Path) -> list[Path]:
    """Entries of a folder that are not hidden.

    Raises:
        SequenceError: it cannot be read.
    """
    try:
        return [path for path in folder.iterdir() if not path.name.startswith(".")]
    except OSError as error:
        hint = f": did you mean {folder.parent}?" if folder.suffix.lower() in VIDEOS | PICTURES else ""
        raise SequenceError(f"{folder}: {error.strerror}, expected a folder of videos{hint}") from error


def sources(folder: Path) -> list[Path]:
    """The videos in a folder; without any, numbered images in it or in its folders, with `{frame}`.

    Without these either, the videos in its folders, if there is one a camera. Plates and recordings for calibration are
    left out, by their names, if there is anything else.

    Raises:
        SequenceError: there are none, or the folder cannot be read.
    """
    found = _recordings(folder)
    return [path for path in found if not says(path.stem, _BESIDE_WORDS)] or found


def board_sources(folder: Path) -> list[Path]:
    """The same for recordings that calibrate the cameras: those with such names, if there are some.

    Raises:
        SequenceError: there are none, or the folder cannot be read.
    """
    found = [path for path in _recordings(folder) if not says(path.stem, (*PLATE_WORDS, *KEYPOINT_WORDS))]
    return [path for path in found if says(path.stem, _CALIBRATION_WORDS)] or found or sources(folder)


def _recordings(folder: Path) -> list[Path]:
    found = _videos(folder) or _numbered(folder) or _a_folder_each(folder)
    if not found:
        inner = next((path for path in sorted(listed(folder)) if path.is_dir() and _any(path)), None)
        expected = f"did you mean {inner}?" if inner else f"expected one a view, {' '.join(sorted(VIDEOS))}, or images"
        raise SequenceError(f"{folder}: no videos there; {expected}")
    return found


def says(name: str, words: tuple[str, ...]) -> bool:
    """Whether one of the words is in a name, or begins a word of it; short ones only as a whole."""
    there = [word.lower() for word in _WORD.findall(name)]
    return any(one == word or (len(word) > _SHORT and one.startswith(word)) for one in there for word in words)


_SHORT = 4
"""Letters of words that begin others as well: `bg`, `view`, `cam`."""


def _a_folder_each(folder: Path) -> list[Path]:
    """The videos of folders that are one a camera: one in each, or several if the folders have such names."""
    inner = [path for path in listed(folder) if path.is_dir() and not says(path.name, _BESIDE_WORDS)]
    found = {path: videos for path in inner if (videos := _deep_videos(path))}
    single = all(len(videos) == 1 for videos in found.values())
    if len(found) < _FEWEST or not (single or all(says(path.name, _CAMERA_WORDS) for path in found)):
        return []
    return sorted(itertools.chain.from_iterable(found.values()))


def _deep_videos(folder: Path, depth: int = _DEEPEST) -> list[Path]:
    """The videos in a folder, or in the first folders below it that have some; without plates and boards."""
    if found := [path for path in _videos(folder) if not says(path.stem, _BESIDE_WORDS)]:
        return found
    inner = [path for path in listed(folder) if path.is_dir() and not path.is_symlink()] if depth else []
    return [video for path in sorted(inner) for video in _deep_videos(path, depth - 1)]


def _any(folder: Path) -> bool:
    return bool(_videos(folder) or _numbered(folder))


def _videos(folder: Path) -> list[Path]:
    return sorted(path for path in listed(folder) if path.suffix.lower() in VIDEOS)


def _numbered(folder: Path) -> list[Path]:
    """Images with equal names except for a number: the most frequent of each folder, or all of the folder."""
    inner = [sorted(_series(path).items(), key=lambda one: -one[1]) for path in listed(folder) if path.is_dir()]
    own = _series(folder)
    return sorted(own) or sorted(series[0][0] for series in inner if series)


def _series(folder: Path) -> dict[Path, int]:
    """Pattern -> number of images."""
    series: dict[Path, int] = defaultdict(int)
    for path in listed(folder):
        match = _NUMBER.fullmatch(path.stem) if path.suffix.lower() in PICTURES else None
        if match is not None:
            series[folder / f"{match[1]}{FRAME}{match[3]}{path.suffix}"] += 1
    return {pattern: n for pattern, n in series.items() if n >= _FEWEST}


def pattern_of(found: list[Path], folder: Path, rig: Rig | None) -> tuple[Path, dict[str, Path]]:
    """The pattern that most sources follow, and the source of each view.

    With a rig, `{view}` is the camera's name in the file's or the folder's name; without one, the whole name.
    """
    fitting: dict[Path, dict[str, Path]] = {}
    for source in found:
        for name in [own_name(source, found)] if rig is None else rig.names:
            for pattern in patterns(source, folder, name):
                fitting.setdefault(pattern, {})[name] = source
    if not fitting:
        first = found[0]
        # images without a name beside their number have to lie in a folder for each view
        return (folder / "{view}" / first.name if FRAME in first.name else folder / f"{{view}}{first.suffix}"), {}
    return max(fitting.items(), key=lambda item: len(item[1]))


def own_name(source: Path, found: list[Path]) -> str:
    """Name of a view without a rig: its file, or its folder if only that differs."""
    before, frame, _ = source.stem.partition(FRAME)
    if frame:
        return before.rstrip("_-. ") or source.parent.name
    if len({path.parent for path in found}) == 1:
        return source.stem
    steps = zip(*(path.parts for path in found), strict=False)
    return source.parts[next(k for k, names in enumerate(steps) if len(set(names)) > 1)]


def patterns(source: Path, folder: Path, name: str) -> Iterator[Path]:
    """The paths with `{view}` for a name in the file's name, the folder's or both; none if it is in neither."""
    *folders, file = source.relative_to(folder).parts
    stem, frame, end = file.partition(FRAME) if FRAME in file else (source.stem, "", source.suffix)
    plain = (*folders, stem)
    for steps in itertools.product(*([*with_view(step, name), step] for step in plain)):
        if steps != plain:
            yield folder.joinpath(*steps[:-1], f"{steps[-1]}{frame}{end}")


def with_view(text: str, name: str) -> list[str]:
    """A text with `{view}` for a name: in its last place, everywhere, in each other place; empty without the name.

    Short names are in other words, too: `1` in `1_trial1`, `a` in `background_a`.
    """
    ends = [match.span() for match in re.finditer(re.escape(name), text)][::-1] if name else []
    single = [f"{text[:begin]}{{view}}{text[end:]}" for begin, end in ends]
    return [*single[:1], *([text.replace(name, "{view}")] if len(ends) > 1 else []), *single[1:]]


def _shown_size(container: InputContainer, stream: VideoStream) -> tuple[int, int]:
    """Width and height of a video's images as they are shown: its metadata may turn them."""
    turned = False
    with contextlib.suppress(av.FFmpegError, StopIteration, ValueError):  # faults of decoding are reported by a run
        turned = next(container.decode(stream)).rotation % 180 != 0
    return (stream.height, stream.width) if turned else (stream.width, stream.height)


def numbered_images(source: Path) -> list[Path]:
    """The files of a pattern with `{frame}`, in their order.

    Raises:
        SequenceError: their folder cannot be read.
    """
    before, after = source.name.split(FRAME)
    number = re.compile(rf"{re.escape(before)}(\d+){re.escape(after)}")
    found = {path: int(match[1]) for path in listed(source.parent) if (match := number.fullmatch(path.name))}
    return sorted(found, key=lambda path: (found[path], path.name))


def header(source: Path, view: str) -> Footage:
    """Information in a video's header, or in the first image.

    Raises:
        SequenceError: it cannot be read.
    """
    if FRAME in source.name:
        files = numbered_images(source)
        height, width = intact_image(files[0]).shape[:2]
        return Footage(source, view, (width, height), 0.0, len(files))
    try:
        with opened(source) as container:
            stream = container.streams.video[film_of(container)[0]]
            rate = float(stream.average_rate or stream.guessed_rate or 0) if has_clock(container) else 0.0
            return Footage(source, view, _shown_size(container, stream), rate, stream.frames)
    except SequenceError as error:
        raise SequenceError(f"{source} {error}") from error
    except (av.FFmpegError, IndexError, OSError) as error:
        raise SequenceError(f"{source} is not a video that can be read: {error}") from error


_MOST_DECODED = 1500
"""Frames decoded of a film with few key frames, from its first one on."""

_Item = TypeVar("_Item")


def spread_pictures(source: Path, n: int) -> list[Image]:
    """Up to n pictures of one view.

    Of a film these are key frames, which decode separately, if it has as many.

    Args:
        source: a film, or images with `{frame}` for their number.
        n: number of pictures.

    Returns:
        Pictures (h, w, 3) BGR.

    Raises:
        SequenceError: it cannot be read.
    """
    if FRAME in source.name:
        return [intact_image(path) for path in _spread(numbered_images(source), n)]
    try:
        keys = _spread(_decoded(source, "NONKEY"), n)
        frames = keys if len(keys) == n else _spread(islice(_decoded(source, "DEFAULT"), _MOST_DECODED), n)
    except SequenceError as error:
        raise SequenceError(f"{source} {error}") from error
    except (av.FFmpegError, IndexError, OSError, ValueError) as error:
        raise SequenceError(f"{source} is not a video that can be read: {error}") from error
    if not frames:
        raise SequenceError(f"{source}: no frame of it can be decoded")
    return [np.asarray(frame.to_ndarray(format="bgr24"), dtype=np.uint8) for frame in frames]


def _decoded(path: Path, skipped: Literal["DEFAULT", "NONKEY"]) -> Iterator[av.VideoFrame]:
    """Frames of a film, without those of a kind (FFmpeg's `AVDiscard`)."""
    with opened(path) as container:
        stream = container.streams.video[film_of(container)[0]]
        stream.codec_context.skip_frame = skipped
        yield from container.decode(stream)


def _spread(items: Iterable[_Item], n: int) -> list[_Item]:
    """Up to n of them, evenly spread; at most twice as many are held."""
    kept: list[_Item] = []
    stride = 1
    for k, item in enumerate(items):
        if k % stride == 0:
            kept.append(item)
        if len(kept) > 2 * n:
            del kept[1::2]
            stride *= 2
    chosen = np.unique(np.linspace(0, len(kept) - 1, min(n, len(kept))).round().astype(int))
    return [kept[k] for k in chosen.tolist()]
