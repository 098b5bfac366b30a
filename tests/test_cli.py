"""The command line: what it prints, and that every mistake is one line and exit code 2."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tracker.foundation.errors import TrackerError
from tracker.running.cli import _told, app
from tracker.synthesis.simulation.sequence import Recipe, write_sequence


def bodytrack(*arguments: object, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    # without -P Python would find modules of the folder, which it does not for the script `bodytrack`
    command = [sys.executable, "-P", "-m", "tracker", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)


def told(*arguments: object) -> tuple[str, int]:
    """What the command tells of a mistake and its exit code, in this process, which has imported what it needs."""
    error = CliRunner().invoke(app, list(map(str, arguments))).exception
    assert isinstance(error, TrackerError)
    return _told(error)


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli") / "sequence"
    write_sequence(Recipe("arm_swing", seconds=0.16, size=(320, 256)), folder)
    return folder


def test_a_run_can_be_tracked_and_evaluated(sequence, tmp_path):
    given = ["--set", "initialization.use=given", "--set", f"initialization.poses={sequence / 'truth_poses.csv'}"]
    # that runs leave the others out of these, whole ones show elsewhere
    given += ["--set", "reading.downscale=1", "--set", "evidence=contours", "--set", "inspection=false"]
    given += [word for one in ("report", "plots", "overlay") for word in ("--set", f"recordings.{one}=false")]
    done = bodytrack("run", sequence / "config.toml", "--output", tmp_path / "out", "--frames", "1:4", *given)
    assert done.returncode == 0, done.stderr
    assert "tracked 3 frames" in done.stdout
    assert "no frame of 3 lost, doubtful or with an ambiguous limb" in done.stdout
    # what follows goes on in this process
    evaluated = CliRunner().invoke(app, ["result", "evaluate", str(tmp_path / "out"), "--truth", str(sequence)])
    assert evaluated.exit_code == 0, evaluated.output
    assert "joint distance, mean" in evaluated.stdout
    assert (tmp_path / "out" / "evaluation.png").is_file()
    exported = CliRunner().invoke(app, ["result", "export", str(tmp_path / "out"), "--to", "trc,bvh", "--y-up"])
    assert exported.exit_code == 0, exported.output
    assert exported.stdout.split() == [str(tmp_path / "out" / "exports" / f"person1.{kind}") for kind in ("bvh", "trc")]
    again, code = told("run", sequence / "config.toml", "--output", tmp_path / "out")
    assert code == 2
    assert "not empty" in again


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["show", "simlarity"], 'did you mean "similarity"'),
        (["result", "evaluate", ".", "--truth", "."], "no joints.csv there"),
        (["demo", "--movement", "hop", "--output", "out"], 'no movement "hop"'),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(arguments, message, tmp_path, monkeypatch):
    """Of these the command prints the text and ends with the code, as of the configuration below."""
    monkeypatch.chdir(tmp_path)
    text, code = told(*arguments)
    assert code == 2
    assert message in text
    assert len(text.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_missing_configuration_is_one_line_and_leaves_nothing(tmp_path):
    done = bodytrack("run", "nowhere.toml", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "cannot read the configuration" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["demo", "--seed", "-1"], ["'--seed'", "greater than or equal to 0"]),
        (["demo", "--frams", "3"], ["--frams", "--frames"]),
        (["demmo"], ["'demmo'", "'demo'"]),
        (["run"], ["Missing argument 'CONFIG'", "run --help"]),
    ],
)
def test_a_command_line_that_cannot_be_is_one_line(arguments, words, tmp_path):
    done = bodytrack(*arguments, folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.strip().splitlines()) == 1
    assert all(word in done.stderr for word in words), done.stderr


def test_no_arguments_show_the_help(tmp_path):
    done = bodytrack(folder=tmp_path)
    assert done.returncode == 2
    assert "calibrate" in done.stdout + done.stderr


BORDER = """
import os, sys
from tracker.running.cli import app, main

@app.command()
def fails():
    raise {error}

main()
"""


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        ("RuntimeError('two\\nlines [red]')", 1, "RuntimeError: two lines [red]: this is a fault of bodytrack; please"),
        ("OSError(28, os.strerror(28), 'a.csv')", 2, "a.csv: no space left on device; free some space"),
        ("RecursionError()", 1, "RecursionError: : this is a fault"),
        ("UnicodeEncodeError('utf-8', 'anna/\\udcff.mp4', 5, 6, 'x')", 2, r"'anna/\udcff.mp4': utf-8 cannot write"),
    ],
)
def test_whatever_escapes_is_one_line(error, code, words):
    command = [sys.executable, "-c", BORDER.format(error=error), "fails"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (code, "")
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1
    shown = subprocess.run([*command, "--debug"], capture_output=True, text=True, check=False)
    assert "Traceback" in shown.stderr


@pytest.mark.parametrize("arguments", [["--debug", "fails"], ["fails", "--debug"]])
def test_debug_shows_the_traceback_and_may_stand_anywhere(arguments):
    script = BORDER.format(error="__import__('tracker.foundation.errors').errors.ConfigError('no such file')")
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "Traceback" in done.stderr


def test_code_from_outside_is_told_first_and_can_be_forbidden(sequence, tmp_path):
    (tmp_path / "my_lab.py").write_text("print('it ran')\n")
    command = ["run", sequence / "config.toml", "--output", tmp_path / "out", "--set", 'estimation.use="my_lab:Mine"']
    done = bodytrack(*command, folder=tmp_path)
    assert done.stdout.splitlines()[:2] == ["runs code from outside bodytrack: my_lab:Mine", "it ran"]
    refused = bodytrack(*command, "--no-plugins", folder=tmp_path)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "--no-plugins forbids" in refused.stderr


def test_a_name_that_the_terminal_cannot_show_is_written_out():
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    script = BORDER.format(error="SystemExit(print('Zo\u00eb \u20ac'))")
    command = [sys.executable, "-c", script, "fails"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert (done.returncode, done.stdout, done.stderr) == (0, "Zo\\xeb \\u20ac\n", "")


NOISE = """
import logging, os, sys, warnings
import numpy
from tracker.running.cli import app, main

@app.command()
def noisy():
    warnings.warn("a library's warning")
    numpy.nanmean(numpy.array([numpy.nan]))
    logging.getLogger("matplotlib").warning("a library's log")
    os.write(2, b"compiled code\\n")
    logging.getLogger("tracker").warning("rig.toml: a camera is left out")
    print("a word", file=sys.stderr)

main()
"""


def test_what_libraries_warn_of_does_not_reach_the_terminal():
    command = [sys.executable, "-c", NOISE, "noisy"]
    quiet = subprocess.run(command, capture_output=True, text=True, check=True)
    assert quiet.stderr.splitlines() == ["look: rig.toml: a camera is left out", "a word"]
    shown = subprocess.run([*command, "--debug"], capture_output=True, text=True, check=True)
    for noise in ("a library's warning", "RuntimeWarning", "a library's log", "compiled code"):
        assert noise in shown.stderr, shown.stderr


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["calibrate", "--help"], ["--version"]])
def test_what_the_command_line_is_like_is_told_without_loading_libraries(arguments):
    script = "import sys\nfrom tracker.running.cli import app\napp(standalone_mode=False)\n"
    script += "print(*sys.modules, file=sys.stderr)"
    command = [sys.executable, "-c", script, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout
    loaded = set(done.stderr.split())
    assert "typer" in loaded
    assert not loaded & {"numba", "numpy", "scipy", "matplotlib", "cv2", "av", "trimesh"}


def test_components_are_shown_with_their_documentation():
    """In this process, which has imported what they need; the command imports it for three seconds."""
    shown = {stage: CliRunner().invoke(app, ["show", *stage.split()]).output for stage in ("", "loss", "similarity")}
    assert "chamfer" in shown[""]
    assert "look_ahead_s" in shown["loss"]
    assert "outlier_px" in shown["similarity"]
    assert "40.0" in shown["similarity"]
    assert bodytrack("--version").stdout.startswith("bodytrack ")
