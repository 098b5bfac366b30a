"""Runs that are killed at any instant are resumed to the same bytes (`scripts/fuzz.py kills` for fifty of them)."""

from __future__ import annotations

import random
from pathlib import Path

from fuzzing.kills import difference, killed, left_alone

from tracker.simulation.sequence import Recipe, write_sequence


def test_five_kills_change_nothing(tmp_path: Path) -> None:
    config = write_sequence(Recipe("arm_swing", seconds=0.32, size=(256, 208)), tmp_path / "sequence")
    seconds = left_alone(config, tmp_path / "whole")
    found = killed(config, tmp_path / "killed", 5, random.Random(4), seconds)
    assert found.fault == ""
    assert found.n_kills == 5
    assert difference(tmp_path / "whole", tmp_path / "killed") == ""
