"""Every reader with spoilt files: some each time, and all that once went wrong; `scripts/fuzz.py` tries more."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest
from fuzzing.readers import readers
from fuzzing.trial import KEPT, Bench, Fault, Reader, keep, smallest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.foundation.errors import TrackerError

READERS = {reader.name: reader for reader in readers()}
N_INPUTS = 20
"""Of each reader; the fuzzer tries thousands."""


@pytest.fixture(autouse=True)
def without_words_of_libraries() -> Iterator[None]:
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    yield
    cv2.utils.logging.setLogLevel(level)


@pytest.mark.parametrize("name", READERS)
def test_nothing_but_one_clear_line_comes_of_a_spoilt_file(name: str, tmp_path: Path) -> None:
    bench = Bench(READERS[name], tmp_path / "bench")

    @settings(max_examples=N_INPUTS, deadline=None, derandomize=True, database=None)
    @given(rng=st.randoms(use_true_random=False))
    def tried(rng: random.Random) -> None:
        """Hypothesis makes the choices of the mutations, and fewer and simpler ones once they find a fault."""
        fault = bench.trial(*bench.spoilt(rng))
        if fault is not None:
            keep(fault)
        assert fault is None, f"{fault.kind}: {fault.told}"

    tried()


def kept() -> list[Path]:
    return sorted(path for path in KEPT.rglob("*") if path.is_file())


@pytest.mark.parametrize("path", kept(), ids=lambda path: f"{path.parent.name}/{path.name}")
def test_what_once_went_wrong_does_not_again(path: Path, tmp_path: Path) -> None:
    reader = READERS[path.parent.name.replace("_", " ")]
    file = path.name.partition("--")[2].replace("--", "/")
    fault = Bench(reader, tmp_path / "bench").trial(file, path.read_bytes())
    assert fault is None, f"{fault.kind}: {fault.told}"


# The fuzzer itself finds what it is to find


def reader_that(read: object) -> Reader:
    def sample(folder: Path) -> None:
        (folder / "a.txt").write_text("good 17\n")

    good = READERS["inputs"]
    return Reader("sample", sample, read, good.ways, ("a.txt",))  # type: ignore[arg-type]


def careless(folder: Path) -> object:
    words = (folder / "a.txt").read_text(errors="replace").split()
    return int(words[1])


def chatty(folder: Path) -> object:
    if (folder / "a.txt").read_text(errors="replace") != "good 17\n":
        raise TrackerError("")
    return None


def straying(folder: Path) -> object:
    if (folder / "a.txt").read_text(errors="replace") != "good 17\n":
        (folder.parent / "escaped").write_text("")
    return None


@pytest.mark.parametrize(
    ("read", "kind"), [(careless, "ValueError"), (chatty, "TrackerError of many lines"), (straying, "writes")]
)
def test_faults_are_found_and_made_small(read: object, kind: str, tmp_path: Path) -> None:
    bench, rng, found = Bench(reader_that(read), tmp_path / "bench"), random.Random(1), list[Fault]()
    while not any(fault.kind == kind for fault in found):
        fault = bench.trial(*bench.spoilt(rng))
        found += [fault] if fault is not None else []
        assert len(found) < 500
    best = smallest(bench, found[-1])
    assert best.kind == kind
    assert len(best.content) <= len(found[-1].content)
    assert (bench.folder / "a.txt").read_text() == "good 17\n"


def test_the_same_seed_spoils_the_same_way(tmp_path: Path) -> None:
    bench = Bench(READERS["inputs"], tmp_path / "bench")
    one, other = (([bench.spoilt(random.Random(3)) for _ in range(20)]) for _ in range(2))
    assert one == other
