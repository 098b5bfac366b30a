"""A C3D file as it lies on disk: header, parameters, and numbers in the order of three processors.

Read here rather than by a library: ezc3d ends the process with one damaged file in a hundred; the package c3d refuses
files whose header and parameters differ (Optotrak's do) and whose events or parameters are unusual, and knows no
rotations. Sources: the user manual of c3d.org, and what OptiTrack, NDI, Theia, Vicon and Kistler write.
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
"""Kind of a parameter; another is the number of bytes of its numbers, of which four or more are no whole ones."""


@dataclass(frozen=True)
class Numbers:
    """How a processor writes them."""

    processor: int

    @property
    def order(self) -> str:
        """Of the bytes, as numpy calls it."""
        return ">" if self.processor == _MIPS else "<"

    def whole(self, content: Bytes, n_bytes: int = 2, signed: bool = False) -> Array:
        """Whole numbers."""
        kind = f"{self.order}{'i' if signed else 'u'}{n_bytes}"
        return content.view(kind).astype(np.float64)

    def floats(self, content: Bytes) -> Array:
        """Numbers of four bytes; those of DEC have their halves exchanged, and another exponent."""
        if self.processor == _DEC:
            return np.ascontiguousarray(content.view("<u2").reshape(-1, 2)[:, ::-1]).view("<f4")[:, 0] / 4.0
        return content.view(f"{self.order}f4").astype(np.float64)


@dataclass(frozen=True)
class _Parameter:
    kind: int
    sizes: tuple[int, ...]
    content: Bytes

    def texts(self) -> tuple[str, ...]:
        """Without the blanks that fill them up."""
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
        """Of a parameter and those that go on with it: one holds 255 texts, NAME2, NAME3 and so on the others."""
        found: tuple[str, ...] = ()
        for n in range(1, len(self.parameters) + 1):
            more = self.parameters.get(name if n == 1 else f"{name}{n}")
            if more is None:
                break
            found += more.texts()
        return found

    def values(self, name: str) -> Array:
        """(n,) numbers of a parameter, whole ones without a sign; none where there is no such parameter."""
        found = self.parameters.get(name)
        if found is None or found.kind not in (1, 2, 4):
            return np.zeros(0)
        return self.numbers.floats(found.content) if found.kind == 4 else self.numbers.whole(found.content, found.kind)

    def value(self, name: str, otherwise: float = math.nan) -> float:
        """A number of a parameter."""
        found = self.values(name)
        return float(found[0]) if len(found) else otherwise

    def count(self, name: str, otherwise: int = 0) -> int:
        """A number of things of a parameter, 0 or more."""
        found = self.value(name, otherwise)
        return max(int(found), 0) if math.isfinite(found) else otherwise


def is_c3d(head: bytes) -> bool:
    """Whether a file that begins so is one: the block of the parameters, and a sign."""
    return len(head) >= 2 and 0 < head[0] < ord(" ") and head[1] == _MARK


def open_c3d(path: Path) -> C3dFile:
    """Reads header and parameters of a file.

    Raises:
        SequenceError: it is no C3D file, or ends within them.
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
    """All up to the last one, or to where the list breaks off; the first of two of one name."""
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
    """One, None where it ends behind the file."""
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
    """Up to a NUL, in UTF-8 or an 8-bit code."""
    content = content.partition(b"\0")[0]
    try:
        return content.decode("utf-8").strip()
    except UnicodeDecodeError:
        return content.decode("latin-1").strip()
