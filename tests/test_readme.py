"""The README: its commands exist, its files are there, its tables are true."""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path

import pytest
import typer.main

from tracker.cli import app
from tracker.recording.csv_table import _JOINT_COLUMNS, _POSE_COLUMNS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
COMMANDS = sorted(
    {line.partition("#")[0].strip() for line in README.splitlines() if line.startswith("bodytrack ")}
    | set(re.findall(r"`(bodytrack [^`]+)`", README))
)


@pytest.mark.parametrize("line", COMMANDS)
def test_commands_parse(line):
    _, name, *arguments = shlex.split(line)
    typer.main.get_command(app).commands[name].make_context(name, arguments)


def test_files_that_are_named_exist():
    linked = re.findall(r"\]\((?!http)([^)#]+)\)", README)
    named = re.findall(r"`((?:tracker|scripts|configs|models|tests|docs)/[\w./]+)`", README)
    missing = [path for path in linked + named if not (ROOT / path).exists()]
    assert missing == ["tracker/similarity/hausdorff.py"]  # the file to be added in the example


@pytest.mark.parametrize("script", ["scripts/demo.sh", "scripts/test.sh", ".ci/run"])
def test_scripts_are_executable(script):
    assert os.access(ROOT / script, os.X_OK)


def test_the_gate_calls_the_test_command_of_the_readme():
    assert "scripts/test.sh" in README
    assert "exec scripts/test.sh" in (ROOT / ".ci/run").read_text()


def test_columns_are_those_of_the_tables():
    assert f"`{','.join(_JOINT_COLUMNS)}`" in README
    assert f"`{','.join(_POSE_COLUMNS)}`" in README


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))], ids=lambda path: path.name
)
def test_tables_are_whole(page):
    """A row behind an empty line is shown as text."""
    lines = page.read_text(encoding="utf-8").splitlines()
    heads = [k for k in range(1, len(lines)) if lines[k].startswith("|") and not lines[k - 1].startswith("|")]
    assert [lines[k] for k in heads if not re.match(r"\|[\s:|-]+$", lines[k + 1])] == []
    assert [line for k in heads for line in lines[k - 1 : k] if line] == []
