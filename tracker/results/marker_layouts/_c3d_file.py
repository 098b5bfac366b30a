"""A C3D file on disk: header, parameters, and numbers in the formats of three processors.

It has a reader of its own: ezc3d ends the process with one damaged file in a hundred; the package c3d refuses files
whose header and parameters differ (Optotrak's do) or with unusual events or parameters, and knows no rotations.
Sources: the user manual of c3d.org, and files of OptiTrack, NDI, Theia, Vicon and Kistler.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError

Bytes = NDArray[np.uint8]

# By the format.
BLOCK_BYTES = 512
_INTEL, _DEC, _MIPS = 84, 85, 86
_MARK = 0x50
"""Second byte of every C3D file, and of its parameters."""

_TEXT = -1
"""Kind of a text parameter; another kind is the number of bytes of its numbers, and four or more are not whole."""


@dataclass(frozen=True)
class Numbers:
    """Number format of a processor."""

    processor: int

    @property
    def order(self) -> str:
        """Byte order in numpy's notation."""
        return ">" if self.processor == _MIPS else "<"

    def whole(self, content: Bytes, n_bytes: int = 2, signed: bool = False) -> Array:
        """Whole numbers."""
        kind = f"{self.order}{'i' if signed else 'u'}{n_bytes}"
        return content.view(kind).astype(np.float64)

    def floats(self, content: Bytes) -> Array:
        """Numbers of four bytes; DEC exchanges their halves, and has another exponent."""
        if self.processor == _DEC:
            return np.ascontiguousarray(content.view("<u2").reshape(-1, 2)[:, ::-1]).view("<f4")[:, 0] / 4.0
        return content.view(f"{self.order}f4").astype(np.float64)


@dataclass(frozen=True)
class _Parameter:
    kind: int
    sizes: tuple[int, ...]
    content: Bytes

    def texts(self) -> tuple[str, ...]:
        """Texts without trailing blanks."""
        width = self.sizes[0] if self.sizes else 1
        if self.kind != _TEXT or not width:
            return ()
        return tuple(_text(row.tobytes()) for row in self.content.reshape(-1, width))


@dataclass(frozen=True)
class C3dFile:
    """Header and parameters of a file, and all its bytes."""

    path: Path
    content: Bytes
    numbers: Numbers
    parameters: dict[str, _Parameter]
    """`POINT:USED` and so on -> what is there."""

    n_points: int
    n_analog: int
    """Numbers of analog signals in a frame of points."""

    first_frame: int
    last_frame: int
    scale: float
    data_block: int
    rate_hz: float

    def texts(self, name: str) -> tuple[str, ...]:
        """Texts of a parameter and its continuations: one holds 255 texts, NAME2, NAME3 and so on the others."""
        found: tuple[str, ...] = ()
        for n in range(1, len(self.parameters) + 1):
            more = self.parameters.get(name if n == 1 else f"{name}{n}")
            if more is None:
                break
            found += more.texts()
        return found

    def values(self, name: str) -> Array:
        """(n,) numbers of a parameter, whole ones unsigned; empty without such a parameter."""
        found = self.parameters.get(name)
        if found is None or found.kind not in (1, 2, 4):
            return np.zeros(0)
        return self.numbers.floats(found.content) if found.kind == 4 else self.numbers.whole(found.content, found.kind)

    def value(self, name: str, otherwise: float = math.nan) -> float:
        """A number of a parameter."""
        found = self.values(name)
        return float(found[0]) if len(found) else otherwise

    def count(self, name: str, otherwise: int = 0) -> int:
        """A parameter that counts things, 0 or more."""
        found = self.value(name, otherwise)
        return max(int(found), 0) if math.isfinite(found) else otherwise


def is_c3d(head: bytes) -> bool:
    """Whether a file with these first bytes is C3D: the block of the parameters, and a sign."""
    return len(head) >= 2 and 0 < head[0] < ord(" ") and head[1] == _MARK


def open_c3d(path: Path) -> C3dFile:
    """Reads header and parameters of a file.

    Raises:
        SequenceError: it is not a C3D file, or ends within them.
    """
    try:
        content = np.fromfile(path, np.uint8)
    except OSError as error:
        raise SequenceError(f"{path}: cannot read the markers: {error.strerror}") from error
    if not is_c3d(content[:2].tobytes()):
        raise SequenceError(f"{path}: not a C3D file")
    start = (int(content[0]) - 1) * BLOCK_BYTES
    if len(content) < max(start, BLOCK_BYTES) + 4:
        raise SequenceError(f"{path}: {len(content)} bytes, a C3D file that ends before its parameters: cut off")
    numbers = Numbers(int(content[start + 3]))
    if numbers.processor not in (_INTEL, _DEC, _MIPS):
        raise SequenceError(
            f"{path}: written by a processor {numbers.processor}, expected {_INTEL} (Intel), {_DEC} (DEC) or {_MIPS} "
            "(MIPS): damaged, or no C3D file"
        )
    words = numbers.whole(content[:BLOCK_BYTES]).astype(int)
    scale, rate_hz = numbers.floats(content[12:16])[0], numbers.floats(content[20:24])[0]
    return C3dFile(
        path=path,
        content=content,
        numbers=numbers,
        parameters=_parameters(content, start + 4, numbers),
        n_points=int(words[1]),
        n_analog=int(words[2]),
        first_frame=int(words[3]),
        last_frame=int(words[4]),
        scale=float(scale),
        data_block=int(words[8]),
        rate_hz=float(rate_hz),
    )


def _parameters(content: Bytes, at: int, numbers: Numbers) -> dict[str, _Parameter]:
    """All parameters up to the last one, or to a broken list; of two with one name the first."""
    groups: dict[int, str] = {}
    found: list[tuple[int, str, _Parameter]] = []
    while at + 4 < len(content):
        length, owner = (int(number) for number in content[at : at + 2].view(np.int8))
        below = at + 2 + abs(length)
        if not length or not owner or below + 2 > len(content):
            break
        name = _text(content[at + 2 : below].tobytes()).upper()
        if owner < 0:
            groups.setdefault(-owner, name)
        elif (parameter := _parameter(content, below + 2)) is not None:
            found.append((owner, name, parameter))
        step = int(numbers.whole(content[below : below + 2], signed=True)[0])
        if step <= 0:
            break
        at = below + step
    return {f"{groups.get(owner, '')}:{name}": parameter for owner, name, parameter in reversed(found)}


def _parameter(content: Bytes, at: int) -> _Parameter | None:
    """One parameter; None if it ends behind the file."""
    if at + 2 > len(content):
        return None
    kind, n_sizes = int(content[at : at + 1].view(np.int8)[0]), int(content[at + 1])
    sizes = tuple(int(size) for size in content[at + 2 : at + 2 + n_sizes])
    start = at + 2 + n_sizes
    n_bytes = math.prod(sizes) * abs(kind)
    if len(sizes) < n_sizes or start + n_bytes > len(content):
        return None
    return _Parameter(kind, sizes, content[start : start + n_bytes])


def _text(content: bytes) -> str:
    """Text up to a NUL, in UTF-8 or an 8-bit code."""
    content = content.partition(b"\0")[0]
    try:
        return content.decode("utf-8").strip()
    except UnicodeDecodeError:
        return content.decode("latin-1").strip()


# Frames of a C3D file: how many there are, points, and the origins of segments (C-Motion's rotations).

# By the format.
_POINT_NUMBERS = 4
"""Numbers of a point: x, y, z, and one of residual and cameras, negative for a hidden point."""

_ROTATION_NUMBERS, _ORIGIN = 17, slice(12, 15)
"""Numbers of a segment: a 4x4 matrix column by column, and its reliability, negative for a hidden segment."""

_MOST_COUNTED = 2**16 - 1
"""POINT:FRAMES and the header count frames in two bytes; this value marks files with more, which have the number
elsewhere."""


def points_of(file: C3dFile, n_points: int, rate_hz: float) -> tuple[Array, tuple[str, ...]]:
    """Points (T, M, 3) in the file's unit, NaN where one was not seen, and remarks.

    Raises:
        SequenceError: the file has fewer frames than it says, or does not describe its data.
    """
    scale, start = _scale(file), _data_start(file)
    whole = scale > 0
    n_bytes = _frame_bytes(file, n_points, rate_hz, 2 if whole else 4, start)
    n_there, rest = divmod(_data_end(file, start) - start, n_bytes)
    n_frames, remarks = _n_frames(file, n_there, not rest)
    frames = file.content[start : start + n_frames * n_bytes].reshape(n_frames, n_bytes)
    own = np.ascontiguousarray(frames[:, : n_points * _POINT_NUMBERS * (2 if whole else 4)]).reshape(-1)
    numbers = scale * file.numbers.whole(own, signed=True) if whole else file.numbers.floats(own)
    numbers = numbers.reshape(n_frames, n_points, _POINT_NUMBERS)
    seen: Array = np.where((numbers[..., 3] < 0)[..., None], np.nan, numbers[..., :3])
    return seen, remarks


def origins_of(file: C3dFile, n_segments: int, n_frames: int, rate_hz: float) -> tuple[Array, float]:
    """Origins (T, S, 3) of segments in the file's unit, NaN where one was not seen, and their rate, Hz.

    Args:
        file: the file.
        n_segments: ROTATION:USED.
        n_frames: of the points; 0 without points.
        rate_hz: of the points; 0 if unknown.

    Raises:
        SequenceError: the file does not describe them, or has fewer frames than it says.
    """
    own_rate_hz = file.value("ROTATION:RATE", file.value("ROTATION:RATIO", 1.0) * rate_hz)
    block = file.count("ROTATION:DATA_START", 0 if n_frames else file.data_block)
    if block < 2:
        raise SequenceError(f"{file.path}: ROTATION:DATA_START is missing: where do the rotations of segments begin?")
    start, n_bytes = (block - 1) * BLOCK_BYTES, 4 * _ROTATION_NUMBERS * n_segments
    fitting = max((len(file.content) - start) // n_bytes, 0)
    told = file.count("ROTATION:FRAMES") or round(n_frames * own_rate_hz / rate_hz if rate_hz else 0)
    if not told:
        told = _n_frames(file, fitting, False)[0]
    if told > fitting:
        raise SequenceError(f"{file.path}: ROTATION:FRAMES says {told} frames, {fitting} are there: cut off")
    numbers = file.numbers.floats(file.content[start : start + told * n_bytes])
    placed = numbers.reshape(told, n_segments, _ROTATION_NUMBERS)
    origins: Array = np.where((placed[..., -1] < 0)[..., None], np.nan, placed[..., _ORIGIN])
    return origins, own_rate_hz


def n_segments_of(file: C3dFile) -> int:
    """Number of segments with rotations."""
    return file.count("ROTATION:USED", len(file.texts("ROTATION:LABELS")))


def first_frame(file: C3dFile) -> int:
    """Number of the first frame from 0 on; the format counts from 1, OptiTrack Motive from 0."""
    words = file.values("TRIAL:ACTUAL_START_FIELD")
    first = file.first_frame if not len(words) else _long(words)
    return max(first - 1, 0)


def _long(words: Array) -> int:
    """A number in two words, the lower first, or in one."""
    return int(words[0] + (2**16 * words[1] if len(words) > 1 else 0)) if np.isfinite(words[:2]).all() else 0


def _n_frames(file: C3dFile, n_there: int, ended: bool) -> tuple[int, tuple[str, ...]]:
    """Number of frames to read, and remarks: POINT:FRAMES counts, unless it cannot be.

    Args:
        file: the file.
        n_there: number of frames in its bytes.
        ended: whether it ends with a whole one, as after an early stop.

    Raises:
        SequenceError: there are fewer, and the file was cut off.
    """
    start, end = file.values("TRIAL:ACTUAL_START_FIELD"), file.values("TRIAL:ACTUAL_END_FIELD")
    long = max(_long(end) - _long(start) + 1 if len(start) and len(end) else 0, file.count("POINT:LONG_FRAMES"))
    header = file.last_frame - file.first_frame + 1
    told = file.count("POINT:FRAMES")
    if _MOST_COUNTED < long <= n_there:
        return long, ()
    if told == _MOST_COUNTED and not long:
        return n_there, ()
    told = told or long or header
    if told <= n_there:
        return told, ()
    if 1 < header <= n_there:
        return header, (f"POINT:FRAMES of {file.path.name} says {told} frames, its header and data {header}",)
    if ended and n_there > 1:
        return n_there, (f"POINT:FRAMES of {file.path.name} says {told} frames, it ends after {n_there}",)
    raise SequenceError(f"{file.path}: POINT:FRAMES says {told} frames, {n_there} are there: the file is cut off")


def _frame_bytes(file: C3dFile, n_points: int, rate_hz: float, number_bytes: int, start: int) -> int:
    """Bytes of points and analog signals; of two numbers of these the one that fits the length of the data."""
    ratio = file.value("ANALOG:RATE") / rate_hz if rate_hz else math.nan
    told = round(file.count("ANALOG:USED") * ratio) if math.isfinite(ratio) else file.n_analog
    sizes = [number_bytes * (_POINT_NUMBERS * n_points + n_analog) for n_analog in (file.n_analog, told)]
    n_frames, there = file.count("POINT:FRAMES"), _data_end(file, start) - start
    return next((size for size in sizes if 0 <= there - n_frames * size < BLOCK_BYTES), sizes[0])


def _scale(file: C3dFile) -> float:
    """Scale of whole numbers; negative for other numbers."""
    told = (file.value("POINT:SCALE"), file.scale)
    scale = next((number for number in told if math.isfinite(number) and number), None)
    if scale is None:
        raise SequenceError(f"{file.path}: POINT:SCALE is missing, and 0 in the header: how are the points written?")
    return scale


def _data_start(file: C3dFile) -> int:
    block = file.data_block if file.data_block > 1 else file.count("POINT:DATA_START")
    if block < 2:
        raise SequenceError(f"{file.path}: POINT:DATA_START is missing: where do the points begin?")
    return (block - 1) * BLOCK_BYTES


def _data_end(file: C3dFile, start: int) -> int:
    """Block of the points: the file's, or where rotations begin."""
    rotations = (file.count("ROTATION:DATA_START") - 1) * BLOCK_BYTES if n_segments_of(file) else 0
    return max(min(rotations if rotations > start else len(file.content), len(file.content)), start)
