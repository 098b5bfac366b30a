"""One spoilt file against one reader: what came of it."""

from __future__ import annotations

import contextlib
import faulthandler
import hashlib
import io
import os
import random
import shutil
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from fuzzing.mutations import Mutation, mutated
from tracker.foundation.errors import TrackerError

KEPT = Path(__file__).resolve().parents[2] / "tests" / "fuzz" / "kept"

LONGEST_S = 10.0
"""CPU time after which a reader hangs: the slowest one takes 0.5 s for what it can read."""

HANGS_S = 180.0
"""Real time after which a process that does not even come back is ended; others may need the processor, too."""

LONGEST_MESSAGE = 4000
"""Signs of an error, before the command line cuts it at 2000."""


@dataclass(frozen=True)
class Reader:
    """Something of the product that reads files."""

    name: str
    sample: Callable[[Path], None]
    """Writes good files into an empty folder."""

    read: Callable[[Path], object]
    """Reads them; it may raise errors of the product's own."""

    ways: tuple[Mutation, ...]
    spoilt: tuple[str, ...]
    """Which of the files are spoilt."""

    share: int = 4
    """How often it is tried beside others: less for those that take long."""


@dataclass(frozen=True)
class Fault:
    """What must not happen."""

    reader: str
    kind: str
    """Of the error, with the place that it was raised at."""

    told: str
    file: str
    content: bytes


class Bench:
    """A folder with a reader's good files, of which one is spoilt at a time."""

    def __init__(self, reader: Reader, folder: Path) -> None:
        # as deep as names with ".." climb, so that what they write is seen
        self.reader, self._root = reader, folder / reader.name
        self.folder = self._root / "a" / "b" / "c" / "d"
        self.folder.mkdir(parents=True)
        reader.sample(self.folder)
        self._good = {name: (self.folder / name).read_bytes() for name in reader.spoilt}
        self._there = _tree(self._root)
        fault = self.trial(reader.spoilt[0], self._good[reader.spoilt[0]])
        if fault is not None:
            raise TrackerError(f"{reader.name} cannot read its sample: {fault.told}")

    def spoilt(self, rng: random.Random) -> tuple[str, bytes]:
        """A file's name and its content, spoilt."""
        name = rng.choice(self.reader.spoilt)
        return name, mutated(rng, self._good[name], self.reader.ways)

    def trial(self, name: str, content: bytes) -> Fault | None:
        """Has the reader read a content in place of one of its files."""
        (self.folder / name).write_bytes(content)
        begin = time.process_time()
        kind, told = "", ""
        try:
            with _quiet():
                self.reader.read(self.folder)
        except TrackerError as error:
            if "\n" in str(error) or not str(error).strip():
                kind, told = f"{type(error).__name__} of many lines", str(error)
            if len(str(error)) > LONGEST_MESSAGE:
                kind, told = f"{type(error).__name__} without end", str(error)[:200]
        except Exception as error:
            kind, told = _kind(error), "".join(traceback.format_exception(error))[-4000:]
        if not kind and time.process_time() - begin > LONGEST_S:
            kind, told = "hangs", f"{time.process_time() - begin:.0f} s"
        if not kind and (made := _tree(self._root) - self._there):
            kind, told = "writes", ", ".join(sorted(made))
            for path in made:
                shutil.rmtree(path, ignore_errors=True)
                Path(path).unlink(missing_ok=True)
        (self.folder / name).write_bytes(self._good[name])
        return Fault(self.reader.name, kind, told, name, content) if kind else None


def smallest(bench: Bench, fault: Fault, seconds: float = 3.0) -> Fault:
    """The shortest content that the same fault comes of: pieces are left out as long as it stays."""
    best, size, end = fault, max(1, len(fault.content) // 2), time.process_time() + seconds
    while size >= 1 and time.process_time() < end:
        place, shorter = 0, False
        while place < len(best.content) and time.process_time() < end:
            content = best.content[:place] + best.content[place + size :]
            found = bench.trial(best.file, content)
            if found is not None and found.kind == fault.kind:
                best, shorter = found, True
            else:
                place += size
        size = size if shorter and size > 1 else size // 2
    return best


def _kind(error: Exception) -> str:
    """The type, and the place of the product it came from."""
    places = [
        frame for frame in traceback.extract_tb(error.__traceback__) if f"{os.sep}tracker{os.sep}" in frame.filename
    ]
    place = f" in {Path(places[-1].filename).name}:{places[-1].name}" if places else ""
    return f"{type(error).__name__}{place}"


def _tree(folder: Path | str) -> set[str]:
    """All files and folders in it; ten times as fast as `Path.rglob`, and it runs with every input."""
    found = set()
    with os.scandir(folder) as entries:
        for entry in entries:
            found.add(entry.path)
            if entry.is_dir(follow_symlinks=False):
                found |= _tree(entry.path)
    return found


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Warnings are no faults here; what libraries print is not read."""
    with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
        warnings.simplefilter("ignore")
        yield


@contextlib.contextmanager
def ended_if_it_hangs() -> Iterator[None]:
    """Ends the process with a traceback if it does not come back in time, in compiled code too."""
    faulthandler.dump_traceback_later(HANGS_S, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


def keep(fault: Fault) -> None:
    """Files the input where tests look for it: the smallest one of each kind of fault."""
    name = hashlib.sha256(f"{fault.reader} {fault.kind}".encode()).hexdigest()[:10]
    folder = KEPT / fault.reader.replace(" ", "_")
    path = folder / f"{name}--{fault.file.replace('/', '--')}"
    if path.exists() and path.stat().st_size <= len(fault.content):
        return
    folder.mkdir(parents=True, exist_ok=True)
    path.write_bytes(fault.content)
