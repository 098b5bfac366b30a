"""Machine code on disk belongs to the sources it was made of, wherever it lies; nothing is compiled in a frame."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import tracker._native
import tracker.kernels.compilation
from tracker.cli import app
from tracker.components import find
from tracker.kernels import ahead
from tracker.kernels.compilation import sources_of
from tracker.kernels.projection import project_point

INNER = """
from tracker.kernels.compilation import compiled
{constant}
@compiled
def inner(x):
    return x + SHIFT
"""

OUTER = """
from tracker.kernels.compilation import compiled
from tracker.kernels.inner import inner
@compiled
def outer(x):
    return 10 * inner(x)
"""

ASK = """
import importlib, logging, pathlib, sys
logging.basicConfig(level=logging.INFO)
inner, *sources = sys.argv[1:]
for source in sources:
    pathlib.Path(inner).write_text(source)
    for name in [name for name in sys.modules if name.split(".")[0] == "tracker"]:
        del sys.modules[name]
    importlib.invalidate_caches()
    outer = importlib.import_module("tracker.kernels.outer").outer
    print(outer(1.0), sum(outer.stats.cache_hits.values()), outer.stats.cache_path)
"""


class Copy:
    """A package of two kernels, one calling the other, compiled as the real ones are."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.kernels = folder, folder / "installed" / "tracker" / "kernels"
        self.kernels.mkdir(parents=True)
        for package in (self.kernels, self.kernels.parent):
            (package / "__init__.py").touch()
        shutil.copy(tracker.kernels.compilation.__file__, self.kernels)
        (self.kernels / "outer.py").write_text(OUTER)
        self.environment = {"HOME": str(folder / "home"), "PYTHONDONTWRITEBYTECODE": "1"}

    def ask(self, *shifts: int) -> tuple[list[tuple[float, int, Path]], str]:
        """With each source what `outer(1)` is, how often its code was found on disk, where that lies; what was logged.

        One process imports the package anew with each: a new kernel knows nothing but what is on disk.
        """
        sources = [INNER.format(constant=f"SHIFT = {shift}") for shift in shifts]
        kept = {key: value for key, value in os.environ.items() if not key.startswith(("NUMBA_", "XDG_", "HOME"))}
        environment = {**kept, **self.environment, "PYTHONPATH": str(self.kernels.parents[1])}
        command = [sys.executable, "-c", ASK, str(self.kernels / "inner.py"), *sources]
        done = subprocess.run(command, env=environment, cwd=self.folder, capture_output=True, text=True, check=True)
        rows = [line.split() for line in done.stdout.splitlines()]
        return [(float(value), int(hits), Path(path)) for value, hits, path in rows], done.stderr

    def refuse(self) -> None:
        """Makes the installation one that cannot be written, even by root."""
        (self.kernels / "__pycache__").touch()


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    return Copy(tmp_path)


@pytest.mark.parametrize("place", ["beside", "chosen", "user"])
def test_code_of_other_sources_is_never_run_and_never_deleted(copy, place):
    home = {"beside": copy.kernels, "chosen": copy.folder / "chosen", "user": copy.folder / "home" / ".cache"}[place]
    if place == "chosen":
        copy.environment["NUMBA_CACHE_DIR"] = str(home)
    if place == "user":
        copy.refuse()
    (first, other, again), logged = copy.ask(1, 2, 1)
    value, hits, path = first
    assert (value, hits, path.is_relative_to(home)) == (20.0, 0, True)
    assert ("cannot be written" in logged) == (place == "user")
    assert other[:2] == (30.0, 0)
    assert again == (20.0, 1, path)


def test_without_a_folder_kernels_run_all_the_same_and_it_is_said(copy):
    copy.refuse()
    (copy.folder / "home").touch()
    ((value, hits, _),), logged = copy.ask(1)
    assert (value, hits) == (20.0, 0)
    assert "WARNING" in logged
    assert "set NUMBA_CACHE_DIR" in logged


def test_a_kernel_is_made_of_all_that_it_imports_by_whatever_way():
    told = set(sources_of("tracker.kernels.projection"))
    assert {f"tracker.kernels.{name}" for name in ("projection", "lens", "rows.camera")} <= told
    assert "tracker.kernels.calls" not in told


def test_machine_code_of_modules_beside_the_extension_is_kept():
    """A module that imports the extension was compiled anew in every run, and each run ended looking for its code."""
    told = sources_of("tracker.kernels.contours.scoring")
    assert told["tracker._native"] == f"# {tracker._native.SOURCES}"
    assert all(told.values())


def test_outdated_code_is_deleted_when_asked(tmp_path, monkeypatch):
    monkeypatch.setattr("tracker.kernels.compilation.code_folder", lambda: tmp_path)
    current = tmp_path / Path(project_point.stats.cache_path).parent.name
    other, foreign = tmp_path / "bundle-0123456789abcdef", tmp_path / "notes"
    for folder in (current, other, foreign):
        folder.mkdir()
        (folder / "code.nbc").write_bytes(b"1234")
    tracker.kernels.compilation._folder_of.cache_clear()
    assert ahead.forget_outdated() == 4
    tracker.kernels.compilation._folder_of.cache_clear()
    assert (current.is_dir(), other.is_dir(), foreign.is_dir()) == (True, False, True)


def test_nothing_is_compiled_once_the_kernels_are_warm():
    script = Path(__file__).with_name("late_kernels.py")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(script.parents[1]), str(script.parent)])}
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=False)
    assert (done.stdout, done.returncode) == ("", 0), done.stderr


def test_warming_up_compiles_what_runs_and_calibrations_need(monkeypatch):
    done = []
    monkeypatch.setattr(ahead, "all_cached", lambda group: False)
    monkeypatch.setattr(ahead, "warm_up", lambda progress, group: done.append(group))
    assert CliRunner().invoke(app, ["warmup"]).exit_code == 0
    needed = {find("jobs", use).kernels for use in ("track", "calibrate")}
    assert set(done) == needed
