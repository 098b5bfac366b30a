"""The README: one page whose commands exist and whose files are there; tables of all pages are whole and true."""

from __future__ import annotations

import os
import re
import shlex
import tomllib
from pathlib import Path

import pytest
import typer.main

from tracker.results.recording.csv_table import _JOINT_COLUMNS, _POSE_COLUMNS
from tracker.running.cli import app
from tracker.running.jobs import job_from

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
    assert len(linked) > 20
    assert [path for path in linked + named if not (ROOT / path).exists()] == []


def test_it_is_one_page():
    assert len(README.splitlines()) <= 150


def test_its_configuration_can_be_read(tmp_path):
    (block,) = re.findall(r"```toml\n(.*?)```", README, flags=re.DOTALL)
    job = job_from("track", tomllib.loads(block), "README.md", tmp_path, "run")
    assert [person.name for person in job.persons] == ["anna"]
    assert job.reading.rig.name == "Calib.toml"
    assert len(block.splitlines()) == 6


@pytest.mark.parametrize("script", ["scripts/demo.sh", "scripts/test.sh", ".ci/run"])
def test_scripts_are_executable(script):
    assert os.access(ROOT / script, os.X_OK)


def test_the_gate_calls_the_test_command_of_the_readme():
    assert "scripts/test.sh" in README
    assert "exec scripts/test.sh" in (ROOT / ".ci/run").read_text()


def test_columns_are_those_of_the_tables():
    page = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    assert f"`{','.join(_JOINT_COLUMNS)}`" in page
    assert f"`{','.join(_POSE_COLUMNS)}`" in page


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))], ids=lambda path: path.name
)
def test_tables_are_whole(page):
    """A row behind an empty line is shown as text."""
    lines = page.read_text(encoding="utf-8").splitlines()
    heads = [k for k in range(1, len(lines)) if lines[k].startswith("|") and not lines[k - 1].startswith("|")]
    assert [lines[k] for k in heads if not re.match(r"\|[\s:|-]+$", lines[k + 1])] == []
    assert [line for k in heads for line in lines[k - 1 : k] if line] == []
