"""Fits how probable it is that a limb is right to runs that `benchmark.py ablate` or `recordings` has kept.

python scripts/fit_doubt.py FOLDER... [--picture docs/limb_probability.png]
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from benchmarks.limb_fit import fitted, left_out, limbs_of, picture, reliability
from benchmarks.recorded import recorded
from rich.console import Console

from tracker.foundation.errors import SequenceError


def main(folders: list[Path], picture_path: Annotated[Path | None, typer.Option("--picture")] = None) -> None:
    """Prints the numbers, what they are worth on recordings that they are not fitted to, and draws that."""
    console = Console()
    if "BODYTRACK_DATA" not in os.environ:
        console.print("BODYTRACK_DATA is not set: the truths of the recordings are there")
        raise typer.Exit(2)
    try:
        limbs = limbs_of(folders, {one.name: one for one in recorded(Path(os.environ["BODYTRACK_DATA"]).resolve())[0]})
    except SequenceError as error:
        console.print(f"{error}; run scripts/benchmark.py ablate --output FOLDER", soft_wrap=True)
        raise typer.Exit(2) from error
    odds, (told, by_flags) = fitted(limbs.known, limbs.right), left_out(limbs)
    wrong = ~limbs.right
    console.print(f"{len(wrong)} limbs of {len(np.unique(limbs.recording))} recordings, {wrong.sum()} 150 mm off")
    console.print(
        ", ".join(f"{name} {number:.4g}" for name, number in odds._asdict().items()), highlight=False, soft_wrap=True
    )
    for name, given, says in (("probability", told, told < 0.5), ("flags", by_flags, limbs.flagged)):
        brier, found, false = np.mean((given - limbs.right) ** 2), np.sum(says & wrong), np.sum(says & limbs.right)
        console.print(f"{name}: Brier {brier:.4f}, of those off {found} said, {false} false")
    rows = reliability(told, limbs.right)
    for low, high, n, _, share in rows:
        console.print(f"| {low:g} to {high:g} | {n} | {100 * share:.0f} % |", highlight=False)
    if picture_path is not None:
        picture(rows).savefig(picture_path, dpi=110)


if __name__ == "__main__":
    typer.run(main)
