"""Movements of laboratories, as `laboratory.toml` beside this file describes them, done by any body."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.bodies.body.description import read_description
from tracker.bodies.body.sections import Movement
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ModelError
from tracker.foundation.source_files import toml_of
from tracker.synthesis.simulation.movements import poses_of

_FILE = Path(__file__).with_suffix(".toml")
# How long each is filmed.
_SECONDS = 3.2


def laboratory_poses(movement: str, model: Path, rate_hz: float, heading_deg: float) -> Array:
    """Poses (T, dof) of a movement on the floor, about the world's origin, rad and m.

    Args:
        movement: its name in `laboratory.toml`.
        model: file of a body with the parameters of `human`.
        rate_hz: frames a second.
        heading_deg: direction faced at the start, degrees from the world's x axis.

    Raises:
        ModelError: the body lacks parameters.
        ConfigError: no such movement.
    """
    described = {name: Movement.model_validate(one) for name, one in toml_of(_FILE, ModelError, "movements").items()}
    body = read_description(model).model_copy(update={"movements": described}).build()
    poses = poses_of(movement, body, np.arange(round(_SECONDS * rate_hz)) / rate_hz, heading_deg)
    place = poses[:, body.root.shifts[:2]]
    poses[:, body.root.shifts[:2]] -= (place.min(axis=0) + place.max(axis=0)) / 2
    return poses
