"""Fits what evidence tells, and how probable it is that a limb is right, to runs that `benchmark.py ablate` has kept.

python scripts/fit_doubt.py FOLDER... [--picture docs/limb_probability.png]
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from benchmarks.limb_fit import fitted, left_out, limbs_of, picture, reliability
from benchmarks.pair_fit import Pairs, nats_left_out, pairs_of, weights
from benchmarks.recorded import recorded
from rich.console import Console

from tracker.foundation.errors import SequenceError


def main(folders: list[Path], picture_path: Annotated[Path | None, typer.Option("--picture")] = None) -> None:
    """Prints the numbers, what they are worth on recordings that they are not fitted to, and draws that."""
    console = Console()
    if "BODYTRACK_DATA" not in os.environ:
        console.print("BODYTRACK_DATA is not set: the truths of the recordings are there")
        raise typer.Exit(2)
    recordings = {one.name: one for one in recorded(Path(os.environ["BODYTRACK_DATA"]).resolve())[0]}
    _tell_nats(console, pairs_of(folders, recordings))
    try:
        limbs = limbs_of(folders, recordings)
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


def _tell_nats(console: Console, pairs: Pairs) -> None:
    """What a px and the colours of parts tell, and how often that is right of recordings left out."""
    if len(np.unique(pairs.recording)) < 2:
        console.print("nats: fewer than two recordings compared poses of which one is right", highlight=False)
        return
    a_px, of_colours = weights(pairs.told, pairs.second)
    nats = nats_left_out(pairs)
    right, brier = np.mean((nats > 0) == pairs.second), np.mean((1 / (1 + np.exp(-nats)) - pairs.second) ** 2)
    console.print(
        f"nats: {a_px:.2f} a px, {of_colours:.0f} a nat a pixel of mixed colours; "
        f"of {len(nats)} pairs {100 * right:.1f} % right, Brier {brier:.4f}",
        highlight=False,
        soft_wrap=True,
    )


if __name__ == "__main__":
    typer.run(main)
