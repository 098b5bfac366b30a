"""Frames of a C3D file: how many there are, points, and the origins of segments (C-Motion's rotations)."""

from __future__ import annotations

import math

import numpy as np

from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError
from tracker.results.marker_layouts._c3d_file import BLOCK_BYTES, C3dFile

# By the format.
_POINT_NUMBERS = 4
"""x, y, z, and one of residual and cameras, which is negative where the point was not seen."""

_ROTATION_NUMBERS, _ORIGIN = 17, slice(12, 15)
"""A 4x4 matrix column by column, and its reliability, negative where the segment was not seen."""

_MOST_COUNTED = 2**16 - 1
"""POINT:FRAMES and the header count frames in two bytes; files of more say this, and tell the number elsewhere."""


def points_of(file: C3dFile, n_points: int, rate_hz: float) -> tuple[Array, tuple[str, ...]]:
    """Points (T, M, 3) in the file's unit, NaN where one was not seen, and remarks.

    Raises:
        SequenceError: the file has fewer frames than it says, or does not say where and how they are written.
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
        n_frames: of the points; 0 where there are none.
        rate_hz: of the points; 0 where the file does not say it.

    Raises:
        SequenceError: the file does not say where they are, or has fewer frames than it says.
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
    """How many segments it has rotations of."""
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
    """How many frames to read, and remarks: POINT:FRAMES counts, unless it cannot.

    Args:
        file: the file.
        n_there: as many as its bytes hold.
        ended: whether it ends with a whole one, as where a recording was stopped early.

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
    """Of points and analog signals; of two numbers of these the one that the length of the data fits."""
    ratio = file.value("ANALOG:RATE") / rate_hz if rate_hz else math.nan
    told = round(file.count("ANALOG:USED") * ratio) if math.isfinite(ratio) else file.n_analog
    sizes = [number_bytes * (_POINT_NUMBERS * n_points + n_analog) for n_analog in (file.n_analog, told)]
    n_frames, there = file.count("POINT:FRAMES"), _data_end(file, start) - start
    return next((size for size in sizes if 0 <= there - n_frames * size < BLOCK_BYTES), sizes[0])


def _scale(file: C3dFile) -> float:
    """Of whole numbers; negative where the numbers are no whole ones."""
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
    """Of the points: the file's, or where rotations begin."""
    rotations = (file.count("ROTATION:DATA_START") - 1) * BLOCK_BYTES if n_segments_of(file) else 0
    return max(min(rotations if rotations > start else len(file.content), len(file.content)), start)
