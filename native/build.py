"""Builds the extension `tracker._native` in build/, with CMake and ninja: `python native/build.py [--sanitize]`.

Called by scripts/build_native.sh, which leaves it in tracker/ for imports from the checkout, by the build hook of the
package (native/hatch_build.py), and by scripts/sanitized.sh, for which it stays in build/.
"""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import nanobind

ROOT = Path(__file__).resolve().parents[1]


class BuildError(Exception):
    """The extension cannot be built; the text says what to do."""


def build(*, sanitize: bool = False) -> Path:
    """Compiles what changed since the last time; returns the extension's file.

    Raises:
        BuildError: no compiler, or it failed.
    """
    if not any(map(shutil.which, filter(None, (os.environ.get("CXX"), "c++", "g++", "clang++", "cl")))):
        raise BuildError("no C++ compiler found, which bodytrack is built with: install one, e.g. apt-get install g++")
    folder = ROOT / "build" / f"native-{sys.implementation.cache_tag}{'-sanitize' if sanitize else ''}"
    folder.mkdir(parents=True, exist_ok=True)
    sys.path.insert(0, str(ROOT))
    digest = importlib.import_module("tracker.foundation.native_sources").digest_of(ROOT / "native")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    cmake, ninja = (_found(name, path) for name in ("cmake", "ninja"))
    configuring = [cmake, "-S", ROOT / "native", "-B", folder, "-G", "Ninja", f"-DCMAKE_MAKE_PROGRAM={ninja}"]
    settings = {
        "Python_EXECUTABLE": sys.executable,
        "nanobind_DIR": _kept_nanobind(folder),
        "BODYTRACK_SOURCES": digest,
        "BODYTRACK_SANITIZE": "ON" if sanitize else "OFF",
    }
    _run([*configuring, *(f"-D{name}={value}" for name, value in settings.items())])
    _run([cmake, "--build", folder, "--", "-k", "0"])
    files = (file for pattern in ("_native*.so", "_native*.pyd") for file in folder.glob(pattern))
    return max(files, key=lambda file: file.stat().st_mtime)  # one, except where an older build had another name


def is_stable(extension: Path) -> bool:
    """Whether an extension is for the stable ABI: one file serves all Python from 3.12."""
    return extension.name in ("_native.abi3.so", "_native.pyd")


def _found(name: str, path: str) -> str:
    program = shutil.which(name, path=path)
    if program is None:
        raise BuildError(f"{name} not found, which bodytrack is built with: pip install {name}")
    return program


def _kept_nanobind(folder: Path) -> Path:
    """A copy of nanobind: each of pip's environments has it elsewhere, and every build would be a whole one."""
    kept = folder / f"nanobind-{nanobind.__version__}"
    if not kept.is_dir():
        shutil.copytree(Path(nanobind.__file__).parent, kept, ignore=shutil.ignore_patterns("__pycache__"))
    return kept / "cmake"


def _run(command: list[object]) -> None:
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BuildError(f"{done.stdout}{done.stderr}\nthe extension tracker._native could not be built, see above")


def build_in_place() -> Path:
    """Builds, and lays the extension into tracker/, from where a checkout imports it; returns where it lies."""
    built = build()
    place = ROOT / "tracker" / built.name
    shutil.copy2(built, place.with_suffix(".new"))
    place.with_suffix(".new").replace(place)  # a process that runs the old one keeps it
    return place


if __name__ == "__main__":
    try:
        build(sanitize=True) if "--sanitize" in sys.argv[1:] else build_in_place()
    except BuildError as error:
        sys.exit(f"error: {error}")
