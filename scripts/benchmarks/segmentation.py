"""Level sets: the contour of a person found from an outline that is off, in what time, and how well."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from tracker.bodies.scene import Scene
from tracker.evidence.measures.outlines import overlap
from tracker.foundation.arrays import Image, Mask
from tracker.images.operations.level_set import (
    Codes,
    Densities,
    Forces,
    colour_codes,
    densities,
    descent,
    signed_distance,
    texture_codes,
    threshold_dynamics,
)
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Recipe, simulate

SIZE = 384, 288
"""Of the images, px: what the evidence `level_set` looks at of larger ones."""

_OFF_DEG, _OFF_M = 5.0, 0.03
"""Of every parameter of the pose whose outline the contour starts from."""

_MARGIN_PX = 17
"""About the box of the outline."""

_AROUND_PX, _LENGTH, _SHAPE, _STRANGE = 15, 3.0, 0.075, -4.0
"""As the evidence has them."""


@dataclass(frozen=True)
class Sample:
    """A view: image, exact mask, the outline to start from, what was learnt in a frame before."""

    image: Image
    exact: Mask
    start: Mask


Way = Callable[[Sample], Mask]


def compare(console: Console, quick: bool, output: Path | None) -> None:
    """Prints milliseconds a view, the ratio to GrabCut and the overlap with the exact mask."""
    samples, repeats = _samples(), 1 if quick else 5
    ways: dict[str, Way] = {
        "start": lambda sample: sample.start,
        "OpenCV's grabCut, 3 rounds": _grab_cut,
        "descent, the paper's way": lambda sample: _drawn(sample, descent_only=True),
        "threshold dynamics": _drawn,
        "threshold dynamics, colour and texture": lambda sample: _drawn(sample, texture=True),
        "threshold dynamics, EM three times": lambda sample: _drawn(sample, adaptations=3),
    }
    table = Table(
        title=f"contour of a person simulated in {SIZE[0]}x{SIZE[1]}, mean of {len(samples)} views, one thread"
    )
    for name in ("way", "ms/view (thread)", "to grabCut", "IoU", "worst view"):
        table.add_column(name, justify="left" if name == "way" else "right")
    cv2.setNumThreads(1)
    reference = 0.0
    for name, way in ways.items():
        ms, found = _timed(way, samples, repeats)
        reference = ms if "grabCut" in name else reference
        overlaps = [overlap(mask, sample.exact) for mask, sample in zip(found, samples, strict=True)]
        ratio = f"{reference / ms:.1f}x" if reference and name != "start" else ""
        table.add_row(name, f"{ms:.2f}", ratio, f"{np.mean(overlaps):.3f}", f"{min(overlaps):.3f}")
        if output is not None and name == "threshold dynamics":
            output.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(output / "contours.png"), _picture(samples, found))
    console.print(table)


def _samples() -> list[Sample]:
    """The views of the middle of an arm swing."""
    simulation = simulate(Recipe("arm_swing", seconds=0.4, size=SIZE))
    frame = list(simulation.frames())[5]
    scene = simulation.scene.with_pose(0, simulation.poses[0][5])
    body = scene.persons[0].body
    signs = np.random.default_rng(2).choice([-1.0, 1.0], body.dof)
    off = signs * np.where(body.rotates, np.radians(_OFF_DEG), _OFF_M)
    displaced: Scene = scene.with_pose(0, body.clamped(scene.persons[0].q + off))
    masks = zip(frame.images, CpuSynthesis().silhouettes(scene), CpuSynthesis().silhouettes(displaced), strict=True)
    return [_around(Sample(image, exact, start)) for image, exact, start in masks if image is not None]


def _around(sample: Sample) -> Sample:
    """What the evidence looks at of an image: the start's box and all that its contour may reach."""
    x, y, width, height = cv2.boundingRect(sample.start.view(np.uint8))
    rows = slice(max(y - _MARGIN_PX, 0), y + height + _MARGIN_PX)
    columns = slice(max(x - _MARGIN_PX, 0), x + width + _MARGIN_PX)
    exact, start = (mask[rows, columns].copy() for mask in (sample.exact, sample.start))
    return Sample(np.ascontiguousarray(sample.image[rows, columns]), exact, start)


def _drawn(sample: Sample, texture: bool = False, adaptations: int = 0, descent_only: bool = False) -> Mask:
    """The contour from an outline, with densities learnt from the exact mask as a frame before teaches them."""
    codes: Codes = (colour_codes(sample.image), *((texture_codes(sample.image),) if texture else ()))
    prior = signed_distance(sample.start, 2 * _AROUND_PX)
    near = prior > -_AROUND_PX
    known = _learnt(sample, codes) if not adaptations else densities(codes, sample.start, near & ~sample.start)
    region = sample.start
    for _ in range(max(adaptations, 1)):
        if known is None:
            break
        odds = np.where(near, known.log_odds(codes), np.float32(_STRANGE))
        forces = Forces(odds, _LENGTH, prior, _SHAPE)
        region = descent(sample.start, forces)[0] if descent_only else threshold_dynamics(sample.start, forces)
        known = densities(codes, region, near & ~region) if adaptations else known
    return region


_KNOWN: dict[tuple[int, int], Densities | None] = {}


def _learnt(sample: Sample, codes: Codes) -> Densities | None:
    key = id(sample), len(codes)
    if key not in _KNOWN:
        around = signed_distance(sample.exact) > -_AROUND_PX
        _KNOWN[key] = densities(codes, sample.exact, around & ~sample.exact)
    return _KNOWN[key]


def _grab_cut(sample: Sample) -> Mask:
    """What is near the start's outline may be either; the rest is as it was."""
    distance = signed_distance(sample.start)
    labels = np.where(sample.start, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[distance < -_AROUND_PX] = cv2.GC_BGD
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(sample.image, labels, None, *models, 3, cv2.GC_INIT_WITH_MASK)
    mask: Mask = np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD))
    return mask


def _timed(way: Way, samples: list[Sample], repeats: int) -> tuple[float, list[Mask]]:
    """Least milliseconds of processor time a view, and the regions."""
    found = [way(sample) for sample in samples]
    times = []
    for _ in range(repeats):
        begin = time.thread_time()
        for sample in samples:
            way(sample)
        times.append(1000 * (time.thread_time() - begin) / len(samples))
    return max(min(times), 1e-6), found


def _picture(samples: list[Sample], found: list[Mask]) -> Image:
    """Figure 2 of the paper: above the contours at the start, below what they are drawn to."""
    sides = zip(samples, found, strict=True)
    pairs = [np.vstack([_outlined(one.image, one.start), _outlined(one.image, mask)]) for one, mask in sides]
    highest = max(len(pair) for pair in pairs)
    picture: Image = np.hstack([np.pad(pair, ((0, highest - len(pair)), (0, 4), (0, 0))) for pair in pairs])
    return picture


def _outlined(image: Image, mask: Mask) -> Image:
    drawn = image.copy()
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(drawn, contours, -1, (255, 255, 255), 1)
    return drawn
