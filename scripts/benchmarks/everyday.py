"""Everyday movements of any body with the limbs of gavrila22, as curves through the angles of everyday.toml."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array


@dataclass(frozen=True)
class Everyday:
    """A movement."""

    about: str
    seconds: float
    """Of a round, where it repeats."""

    repeats: bool
    angles_deg: dict[str, list[float]]
    """Parameter of the body, or the two of both sides -> values at even times."""

    def poses(self, body: BodyModel, times_s: Array) -> Array:
        """(T, dof) at times (T,): before its beginning and behind its end it stands still, unless it repeats."""
        poses = np.tile(body.rest(), (len(times_s), 1))
        for name, values in self.angles_deg.items():
            closed = [*values, values[0]] if self.repeats else values
            at = np.linspace(0, self.seconds, len(closed))
            if self.repeats:
                course = CubicSpline(at, closed, bc_type="periodic")(times_s)
            else:
                course = PchipInterpolator(at, closed)(np.clip(times_s, 0, self.seconds))
            poses[:, body.columns(name)] = np.radians(course)[:, None]
        clamped: Array = body.clamped(poses)
        return clamped


def everyday() -> dict[str, Everyday]:
    """All of them by name."""
    table = tomllib.loads((Path(__file__).parent / "everyday.toml").read_text(encoding="utf-8"))
    return {
        name: Everyday(one.pop("about"), one.pop("seconds"), one.pop("repeats", False), one)
        for name, one in table.items()
    }
