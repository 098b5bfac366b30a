"""The calibration of an OpenCap session."""

from __future__ import annotations

import math
import pickletools
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._cameras import Entry, listing_of
from tracker.cameras.rig_layouts._plausible import up_remarks
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError, os_fault

_MOST_STEPS = 5000
"""Most entries of a pickle: a camera takes 120."""

_MOST_NUMBERS = 64
"""Most bytes of an array."""

_NAMED = re.compile(r"numpy\.(?:_?core\.)?(?:multiarray |numeric |)(_reconstruct|_frombuffer|scalar|ndarray|dtype)")
_KIND = re.compile(r"[<>=|]?([fiu][1248])")

_MARK = object()


@dataclass
class _Name:
    """Functions that a pickle calls."""

    name: str


@dataclass
class _Kind:
    """The type of an array's numbers."""

    code: str
    order: str = "<"


@dataclass
class _Array:
    """An array, described in two steps: its existence, and its content."""

    values: Any = None


@dataclass
class _Stack:
    """State of reading a pickle."""

    values: list[Any] = field(default_factory=list)
    memo: dict[int, Any] = field(default_factory=dict)

    def pop(self, n: int) -> list[Any]:
        """The last so many values, taken off."""
        taken = self.values[len(self.values) - n :]
        del self.values[len(self.values) - n :]
        if len(taken) < n:
            raise CalibrationError("a pickled table that ends too early")
        return taken

    def pop_mark(self) -> list[Any]:
        """The values since the last mark, taken off."""
        where = max(k for k, value in enumerate(self.values) if value is _MARK)
        taken = self.values[where + 1 :]
        del self.values[where:]
        return taken


def pickled_table(content: bytes) -> dict[str, Any]:
    """The table of numbers and arrays that a pickle holds.

    The steps of the pickle are read one by one; only those that make up dictionaries, tuples, words, numbers and
    numpy arrays are known, and the arrays are built here of their bytes. Python's own reader would run what the file
    asks for.

    Raises:
        CalibrationError: it holds, or asks for, anything else.
    """
    stack = _Stack()
    try:
        for n, (step, argument, _) in enumerate(pickletools.genops(content)):
            if n > _MOST_STEPS:
                raise CalibrationError("a pickle with more in it than a camera")
            _take(stack, step.name, argument)
        (table,) = stack.values
    except CalibrationError:
        raise
    except Exception as error:
        raise CalibrationError(f"not a pickled table of arrays: {str(error)[:100]}") from error
    if not isinstance(table, dict) or not all(isinstance(key, str) for key in table):
        raise CalibrationError("not a pickled table of arrays: no table in it")
    return {key: value.values if isinstance(value, _Array) else value for key, value in table.items()}


def _take(stack: _Stack, step: str, argument: Any) -> None:
    """Does one step."""
    if step in _IGNORED:
        return
    if step in _PLAIN:
        stack.values.append(argument)
    elif step in _MADE:
        stack.values.append(_MADE[step](stack))
    elif step in ("BINPUT", "LONG_BINPUT"):
        stack.memo[argument] = stack.values[-1]
    elif step == "MEMOIZE":
        stack.memo[len(stack.memo)] = stack.values[-1]
    elif step in ("BINGET", "LONG_BINGET"):
        stack.values.append(stack.memo[argument])
    elif step in ("SETITEM", "SETITEMS"):
        entries = stack.pop(2) if step == "SETITEM" else stack.pop_mark()
        stack.values[-1].update(zip(entries[::2], entries[1::2], strict=True))
    elif step == "GLOBAL":
        stack.values.append(_named(argument))
    elif step == "BUILD":
        (state,) = stack.pop(1)
        _build(stack.values[-1], state)
    else:
        raise CalibrationError(f"a pickle with the step {step}, expected a table of arrays: it is not read")


_IGNORED = {"PROTO", "FRAME", "STOP"}
_PLAIN = {
    *("BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8", "BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8"),
    *("BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT"),
}
_MADE: dict[str, Callable[[_Stack], Any]] = {
    "EMPTY_DICT": lambda stack: {},
    "EMPTY_TUPLE": lambda stack: (),
    "MARK": lambda stack: _MARK,
    "NONE": lambda stack: None,
    "NEWTRUE": lambda stack: True,
    "NEWFALSE": lambda stack: False,
    "TUPLE": lambda stack: tuple(stack.pop_mark()),
    "TUPLE1": lambda stack: tuple(stack.pop(1)),
    "TUPLE2": lambda stack: tuple(stack.pop(2)),
    "TUPLE3": lambda stack: tuple(stack.pop(3)),
    "STACK_GLOBAL": lambda stack: _named(" ".join(stack.pop(2))),
    "REDUCE": lambda stack: _reduced(*stack.pop(2)),
}


def _named(words: str) -> _Name:
    if words == "_codecs encode":
        return _Name("encode")
    match = _NAMED.fullmatch(words if " " in words and "." in words.split()[0] else words.replace(" ", "."))
    if match is None:
        raise CalibrationError(f"a pickle that asks for {words.replace(' ', '.')[:80]}: it is not read")
    return _Name(match[1])


def _reduced(called: Any, arguments: Any) -> Any:
    """Meaning of numpy's type codes."""
    name = called.name if isinstance(called, _Name) else ""
    if name == "encode":  # bytes in the second protocol
        text, encoding = arguments
        return text.encode("latin1") if encoding == "latin1" else None
    if name == "dtype":
        match = _KIND.fullmatch(arguments[0])
        if match is None:
            raise CalibrationError(f"an array of {arguments[0]!r}, expected numbers")
        return _Kind(match[1])
    if name == "_reconstruct":
        return _Array()
    if name == "scalar":
        kind, content = arguments
        return _Array(_filled(kind, (), False, content))
    if name == "_frombuffer":
        content, kind, shape, order = arguments
        return _Array(_filled(kind, shape, order == "F", content))
    raise CalibrationError("a pickle that asks for a call: it is not read")


def _build(made: Any, state: Any) -> None:
    if isinstance(made, _Kind):
        made.order = {"<": "<", ">": ">", "|": "|"}[state[1]]
    elif isinstance(made, _Array):
        _, shape, kind, by_columns, content = state
        made.values = _filled(kind, shape, by_columns, content)
    else:
        raise CalibrationError("a pickle of something else than arrays: it is not read")


def _filled(kind: _Kind, shape: tuple[int, ...], by_columns: bool, content: bytes) -> Any:
    if math.prod(shape) > _MOST_NUMBERS or min(shape, default=0) < 0:
        raise CalibrationError(f"an array of shape {shape}, expected those of a camera")
    flat = np.frombuffer(bytes(content), np.dtype(kind.order + kind.code))
    return flat.reshape(shape, order="F" if by_columns else "C").astype(np.float64)


_FILE = "cameraIntrinsicsExtrinsics.pickle"
_KEYS = "intrinsicMat", "distortion", "rotation", "translation"
_LARGEST_BYTES = 2**16
"""Most bytes of a file: a camera takes 1 kB."""


@component
class OpenCapLayout:
    """A session's folder with `Videos/CAMERA/cameraIntrinsicsExtrinsics.pickle`; millimetres, the board's axes.

    OpenCap stores calibrations as pickles only. They are read as data, by a reader that knows numbers and arrays and
    nothing else; Python's, which runs what such a file asks for, is not used.
    """

    endings: ClassVar[tuple[str, ...]] = ()
    shape: ClassVar[str] = f"an OpenCap session (Videos/CAMERA/{_FILE})"
    terms: ClassVar[int] = 8

    def detects(self, path: Path) -> bool:
        """The session, its folder of videos, or one of its files."""
        return bool(_files(path))

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the cameras, called as their folders; one that was only calibrated by itself is left out."""
        entries = []
        for file in _files(path):
            name = file.parent.name
            try:
                table = pickled_table(_content(file))
            except CalibrationError as error:
                raise CalibrationError(f'camera "{name}": {_FILE}: {error}') from error
            entries.append(Entry(name, _with_size(table), *_KEYS))
        listing = listing_of(entries, "mm", no_pose="has no pose: the board was not found in its images")
        return replace(listing, remarks=(*listing.remarks, *up_remarks(listing.cameras)))

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """Nothing: OpenCap takes pickles, which are not written either."""
        raise CalibrationError("OpenCap's calibrations are read only: choose another layout")


def _files(path: Path) -> list[Path]:
    if path.name == _FILE and path.is_file():
        path = path.parent.parent
    if not path.is_dir():
        return []
    return sorted(path.glob(f"*/{_FILE}")) or sorted(path.glob(f"Videos/*/{_FILE}"))


def _content(file: Path) -> bytes:
    try:
        with file.open("rb") as opened:
            content = opened.read(_LARGEST_BYTES + 1)
    except OSError as error:
        raise CalibrationError(os_fault(error)) from error
    if len(content) > _LARGEST_BYTES:
        raise CalibrationError("larger than 64 kB, expected one camera")
    return content


def _with_size(table: dict[str, Any]) -> dict[str, Any]:
    """The table with `size` as width and height: OpenCap's `imageSize` is height and width."""
    size = table.get("imageSize")
    return table if size is None else {**table, "size": size.ravel()[::-1] if hasattr(size, "ravel") else size}
