"""The benchmarks run, in a form too small to measure anything, and print their columns."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def benchmark(*arguments: str) -> str:
    command = [sys.executable, "scripts/benchmark.py", *arguments, "--quick"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("arguments", "words", "n_rows"),
    [
        (("poses",), ("1 thread", "to rasterizing", "to pyrender", "2 threads", "cpu"), 2),
        (("tracking",), ("decode alone", "analysis", "other", "floor", "ratio", "frames/s", "hinge RMS deg"), 4),
        (("robustness", "--only", "missing"), ("lost", "longest loss", "joints 95 % mm", "verdict", "tracked"), 1),
        (("robustness", "--only", "start 5"), ("< 20 mm in 10 frames", "flagged lost", "silently wrong"), 1),
        (("lsm",), ("inverse-compositional", "findTransformECC", "RMS px", "real error over predicted sigma"), 30),
        (("sigma",), ("rendered RMS ratio", "noise robust", "torso_x", "all arm angles", "aim 0.7 to 1.5"), 27),
        (("calibration",), ("three in line", "four around", "3 of 3", "hold-out bar RMS mm", "error / sigma"), 4),
    ],
)
def test_benchmarks_print_their_columns(arguments: tuple[str, ...], words: tuple[str, ...], n_rows: int) -> None:
    printed = benchmark(*arguments)
    for word in words:
        assert word in printed
    assert len(re.findall("^│", printed, re.MULTILINE)) >= n_rows
    if arguments[0] in ("poses", "tracking", "lsm"):
        # Every speed stands beside its reference.
        assert re.search(r" \d[\d.]*x ", printed)
