"""The wheel holds all that the package reads besides its code, and says what whoever publishes it must know."""

from __future__ import annotations

import email
import re
import subprocess
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

import tracker

ROOT = Path(tracker.__file__).resolve().parents[1]
DATA = (".toml", ".csv", ".txt", ".html", ".js", ".gz", ".glsl", ".frag", ".vert", ".comp", ".typed", ".pyi", ".json")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    (path,) = WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"])
    with zipfile.ZipFile(path) as archive:
        yield archive


def kept():
    """Files under version control."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    return {Path(name) for name in listed.stdout.splitlines()}


def test_all_files_of_the_package_and_all_models_are_in_it(wheel):
    inside = set(wheel.namelist())
    package = {str(path) for path in kept() if path.parts[0] == "tracker"}
    models = {f"tracker/_models/{path.relative_to('models')}" for path in kept() if path.parts[0] == "models"}
    assert package - inside == set()
    assert models - inside == set()
    assert any(name.startswith("tracker/_models/movements/walk/") and name.endswith(".csv") for name in models)
    others = {name for name in inside - package - models if ".dist-info/" not in name}
    assert [name.partition(".")[0] for name in others if Path(name).suffix in (".so", ".pyd")] == ["tracker/_native"]
    assert {name for name in others if Path(name).suffix not in (*DATA, ".py", ".so", ".pyd")} == set()
    assert not any(name.startswith(("tests/", "scripts/", "configs/")) for name in inside)


def test_it_says_what_it_is(wheel):
    (name,) = (name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    told = email.message_from_string(wheel.read(name).decode())
    assert told["Name"] == "bodytrack"
    assert told["License-Expression"] == "MIT AND Zlib"
    assert set(told.get_all("License-File")) == {
        "LICENSE",
        "models/movements/DEEPMIMIC_LICENSE.txt",
        "tracker/results/recording/_report/THREE_LICENSE.txt",
    }
    assert told["Description-Content-Type"] == "text/markdown"
    assert "# bodytrack" in told.get_payload()
    assert re.match(r">=3\.\d+", told["Requires-Python"])
    (entry,) = (name for name in wheel.namelist() if name.endswith("entry_points.txt"))
    assert "bodytrack = tracker.__main__:main" in wheel.read(entry).decode()
