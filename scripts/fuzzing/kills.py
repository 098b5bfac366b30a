"""Runs killed with -9 at random instants and resumed: the results must be those of a run that was left alone."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

TABLES = ("poses.csv", "sigmas.csv", "joints.csv", "overlay.mp4", "config.toml", "rig.toml", "inputs.json")
"""Files that must be the same to the byte."""


@dataclass
class Killing:
    """What came of a run that was killed again and again."""

    n_kills: int = 0
    n_anew: int = 0
    """Kills before anything was computed, after which the run was begun anew."""

    fault: str = ""
    """What went wrong; empty if nothing did."""


def run_of(config: Path, output: Path, *more: str) -> list[str]:
    """The command of a run that starts from the true poses."""
    start = ("--set", "initialization.use=given", "--set", "initialization.poses=truth_poses.csv")
    return [sys.executable, "-m", "tracker", "run", str(config), "--output", str(output), *start, *more]


def left_alone(config: Path, output: Path) -> float:
    """The run as it should be; the seconds it takes."""
    begin = time.monotonic()
    subprocess.run(run_of(config, output), check=True, capture_output=True)
    return time.monotonic() - begin


def killed(config: Path, output: Path, n_kills: int, rng: random.Random, seconds: float) -> Killing:
    """A run, killed so many times at any instant and resumed each time, in the end to its end.

    Args:
        config: of the run.
        output: result folder, not there yet.
        n_kills: how often.
        rng: chooses the instants.
        seconds: that a whole run takes.
    """
    found = Killing()
    while not found.fault:
        last = found.n_kills == n_kills
        resumed = ("--resume",) if output.exists() else ()
        process = subprocess.Popen(
            run_of(config, output, *resumed), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        try:
            _, told = process.communicate(timeout=20 * seconds + 60 if last else rng.uniform(0, seconds))
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            found.n_kills += 1
            found.fault = "hangs" if last else ""
            continue
        if process.returncode == 2 and "stopped before it computed anything" in told:
            shutil.rmtree(output)
            found.n_anew += 1
        elif process.returncode != 0:
            found.fault = f"exit code {process.returncode}: {told.strip()[-300:]}"
        elif last:
            return found
        else:
            found.n_kills += 1  # it was faster: the next one replays all of it
    return found


def killed_behind(config: Path, output: Path, n_frames: int, most_s: float) -> int:
    """A run, begun or resumed, that is killed as soon as its journal has so many frames.

    Args:
        config: of the run; it has to write every frame at once (`passes = 1`).
        output: result folder.
        n_frames: that are kept at the least.
        most_s: how long that may take.

    Returns:
        Frames that the journal has then; fewer only of a run that ended before.
    """
    resumed = ("--resume",) if output.exists() else ()
    process = subprocess.Popen(run_of(config, output, *resumed), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end, journal = time.monotonic() + most_s, output / "steps.jsonl"
    while process.poll() is None and _n_lines(journal) < n_frames and time.monotonic() < end:
        time.sleep(0.002)
    process.kill()
    process.communicate()
    return _n_lines(journal)


def _n_lines(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.is_file() else 0


def difference(one: Path, other: Path) -> str:
    """The first result that differs; empty if none does."""
    for name in TABLES:
        if (one / name).read_bytes() != (other / name).read_bytes():
            return name
    if _timeless(one) != _timeless(other):
        return "steps.jsonl"
    left = {path.name for path in other.rglob("*")} - {path.name for path in one.rglob("*")}
    return f"left behind: {sorted(left)}" if left else ""


def _timeless(folder: Path) -> list[object]:
    """The journal without what the clock says."""
    entries = [json.loads(line) for line in (folder / "steps.jsonl").read_text(encoding="utf-8").splitlines()]
    return [
        {**entry, "seconds": {}, "estimates": [{**one, "search_s": 0} for one in entry["estimates"]]}
        for entry in entries
    ]
