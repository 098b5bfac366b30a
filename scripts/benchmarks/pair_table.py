"""A table for fitting nats: of two poses that a run compares, what tells them apart, and where their joints are."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import are_apart
from tracker.evidence.measures import part_colours
from tracker.foundation.arrays import Array
from tracker.tracking import cycle_turn, initialization, verdict
from tracker.tracking.objective import NATS_OF_COLOURS, NATS_PER_PX, Objective

FILE = "pairs.jsonl"
"""A line a comparison of poses with limbs in different places; in the folder it is run in."""


def keep_pairs() -> None:
    """Lets every comparison of this process be kept."""
    Path(FILE).write_text("", encoding="utf-8")
    for room in (cycle_turn, initialization):
        room.colours_when_asked = _numbered(part_colours.colours_when_asked)  # type: ignore[attr-defined]
    kept = _kept(verdict.explains_better)
    for asking in (verdict, cycle_turn):
        asking.explains_better = kept  # type: ignore[attr-defined]


def _numbered(make: Callable[..., Any]) -> Callable[..., Any]:
    """The colours know the number of their frame."""

    @functools.wraps(make)
    def made(sight: Any) -> Any:
        colours = make(sight)
        colours.frame = sight.frame.index
        return colours

    return made


def _kept(compare: Callable[..., bool]) -> Callable[..., bool]:
    @functools.wraps(compare)
    def compared(objective: Objective, q: Array, other: Array) -> bool:
        better = compare(objective, q, other)
        if objective.colours is not None and are_apart(objective.body, other, q):
            with Path(FILE).open("a", encoding="utf-8") as file:
                file.write(json.dumps(_row(objective, np.array([q, other]))) + "\n")
        return better

    return compared


def _row(objective: Objective, poses: Array) -> dict[str, Any]:
    px = objective(poses)
    impurities = (objective.nats(poses) - NATS_PER_PX * px) / NATS_OF_COLOURS
    return {
        "frame": getattr(objective.colours, "frame"),  # noqa: B009 - see `_numbered`
        "person": objective.asked.scene.persons[objective.asked.person].name,
        "told": [float(px[0] - px[1]), float(impurities[0] - impurities[1])],
        "joints": [_joints(objective.body, q) for q in poses],
    }


def _joints(body: BodyModel, q: Array) -> dict[str, list[float]]:
    points = np.round(body.landmarks_in_world(q), 4).tolist()
    return dict(zip(body.landmark_names, points, strict=True))
