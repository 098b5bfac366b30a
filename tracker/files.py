"""Files that are there as a whole or not at all."""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path beside another one, moved onto it if the block ends without an error and deleted otherwise.

    Whoever reads meanwhile sees the old file or the new one; two writers do not mix their bytes.

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
    """What the file at the path has, or what a new one gets: `mkstemp` makes files that only their owner reads."""
    if path.exists():
        return path.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def write_whole(path: Path, content: str | bytes) -> None:
    """Writes a file as a whole; what was there is replaced at once.

    Args:
        path: file to write; its folder exists.
        content: text is written as UTF-8.
    """
    with replacing(path) as unfinished:
        unfinished.write_bytes(content.encode() if isinstance(content, str) else content)


def write_json(path: Path, content: Any) -> None:
    """Writes plain values as an indented JSON file, as a whole."""
    write_whole(path, json.dumps(content, indent=1) + "\n")
