"""Files that appear as a whole or not at all."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from tracker.foundation.errors import ConfigError


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path beside another one, moved onto it if the block ends without an error and deleted otherwise.

    A reader meanwhile sees the old file or the new one; two writers do not mix their bytes.

    Args:
        path: file to write; its folder exists.

    Yields:
        The path to write to, in the same folder and with the same suffix.
    """
    handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=f".part{path.suffix}", dir=path.parent)
    os.close(handle)
    unfinished = Path(name)
    try:
        yield unfinished
        unfinished.chmod(_usual_mode(path))
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def _usual_mode(path: Path) -> int:
    """Permissions of the file at the path, or of a new file: `mkstemp` makes files that only their owner reads."""
    if path.exists():
        return path.stat().st_mode & 0o777
    return 0o666 & ~_mask()


def _mask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def check_free(files: Iterable[Path], overwrite: bool = False) -> None:
    """Refuses to replace files unasked.

    Raises:
        ConfigError: a file exists already.
    """
    for path in files:
        if path.exists() and not overwrite:
            raise ConfigError(f"{path} is there already: choose another --output{_OR_REPLACE}")


_OR_REPLACE = ", or replace it with --overwrite"


def check_empty(folder: Path, replaceable: bool = False) -> None:
    """Refuses a folder for results that is not empty.

    Args:
        folder: may be missing.
        replaceable: whether the command can replace it; the message says so.

    Raises:
        ConfigError: it is not empty, or a file.
    """
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"{folder} is a file: choose another --output, a folder")
    if folder.is_dir() and any(folder.iterdir()):
        raise ConfigError(f"{folder} is not empty: choose another --output{_OR_REPLACE if replaceable else ''}")


@contextlib.contextmanager
def whole_folder(folder: Path, overwrite: bool = False) -> Iterator[Path]:
    """A folder beside another one, moved to its place if the block ends without an error and deleted otherwise.

    Args:
        folder: must not exist, or be empty.
        overwrite: it may hold files; they are deleted when the new folder is whole.

    Raises:
        ConfigError: it is not empty.
    """
    if not overwrite:
        check_empty(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    unfinished = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        yield unfinished
        unfinished.chmod(0o777 & ~_mask())
        with _put_aside(folder):
            unfinished.replace(folder)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


@contextlib.contextmanager
def _put_aside(folder: Path) -> Iterator[None]:
    """Deletes the old content of a folder once the block has put a new folder into its place."""
    if not folder.exists():
        yield
        return
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as aside:
        before = folder.rename(Path(aside) / folder.name)
        try:
            yield
        except OSError:
            before.rename(folder)
            raise


class Successor:
    """A file that is written beside an old one, and takes its place when it has caught up with it."""

    def __init__(self, path: Path, waits: bool) -> None:
        """Chooses the path.

        Args:
            path: the file to replace.
            waits: whether it stays until `take_place`; otherwise it is written in place.
        """
        self._final = path
        self.path = path.with_name(f".{path.stem}{_LATER}{path.suffix}") if waits else path
        """Present path; an open file may be moved meanwhile."""

    def take_place(self) -> Path:
        """Moves it into place, once; returns the final path."""
        if self.path != self._final:
            self.path.replace(self._final)
            self.path = self._final
        return self._final


_LATER = "-later.part"


def remove_unfinished(folder: Path) -> None:
    """Removes files that were begun and never took their place, as after a kill; nobody else may write there."""
    for path in folder.rglob(".*.part*"):
        path.unlink(missing_ok=True)


class GrowingFile:
    """A file that grows by whole blocks, each written at once: a block that does not fit on the disk is taken back."""

    def __init__(self, path: Path, waits: bool = False, append: bool = False) -> None:
        """Creates it.

        Args:
            path: of the file.
            waits: whether the old file stays until `take_place`.
            append: whether blocks are added to an existing file.
        """
        self._successor = Successor(path, waits)
        if not append:
            self._successor.path.write_bytes(b"")

    def add(self, content: str | bytes) -> None:
        """Adds a block.

        Raises:
            OSError: it cannot be written; the file is as it was before.
        """
        block, done = content.encode() if isinstance(content, str) else content, 0
        with self._successor.path.open("ab", buffering=0) as file:
            begin = file.seek(0, os.SEEK_END)
            try:
                while done < len(block):
                    done += file.write(block[done:])
            except OSError as error:
                file.truncate(begin)
                error.filename = str(self._successor.path)
                raise

    def take_place(self) -> Path:
        """Replaces the old file; returns its path."""
        return self._successor.take_place()


def csv_lines(rows: Iterable[Iterable[object]]) -> str:
    """Rows of a CSV table as text."""
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    return text.getvalue()


def write_whole(path: Path, content: str | bytes) -> None:
    """Writes a file as a whole; an old one is replaced at once.

    Args:
        path: file to write; its folder exists.
        content: text is written as UTF-8.
    """
    with replacing(path) as unfinished:
        unfinished.write_bytes(content.encode() if isinstance(content, str) else content)


def write_json(path: Path, content: Any) -> None:
    """Writes plain values as an indented JSON file, as a whole.

    JSON has no NaN and no infinity: unknown numbers become null.
    """
    write_whole(path, json.dumps(_finite(content), indent=1, allow_nan=False) + "\n")


def _finite(value: Any) -> Any:
    """Plain values with None in place of numbers that are not finite."""
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


Stamp = tuple[str, int]
"""Target of a path, and the time of its last change, ns; 0 if it does not exist."""


def stamp_of(path: Path) -> Stamp:
    """Stamp of a file or folder, which shows whether data read from it is still up to date."""
    real = path.resolve()
    return str(real), real.stat().st_mtime_ns if real.exists() else 0
