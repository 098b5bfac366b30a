"""A calibrated rig with all that tells how good it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from tracker.cameras.calibration._adjustment import Adjustment
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image


@dataclass(frozen=True)
class Measure:
    """A figure that judges a calibration, in words a user understands."""

    name: str
    value: float
    unit: str
    meaning: str


@dataclass(frozen=True)
class Calibrated:
    """What a calibration found."""

    kind: str
    """Component that made it, for instance `reference_bar`."""

    adjustment: Adjustment
    """The bundle adjustment, in the world frame asked for."""

    n_objects: int
    """Bar positions, board poses or points."""

    measures: tuple[Measure, ...]
    """Figures such as the RMS error of hold-out bars."""

    advice: tuple[str, ...] = ()
    """What a better recording would do."""

    world: str = ""
    """Where the world frame comes from."""

    scale: str = ""
    """What tells the scale, for instance `square_m = 0.054`."""

    found_out: str = ""
    """What was not told and found out, as a configuration would tell it."""

    pictures: dict[str, Image] = field(default_factory=dict)
    """A picture of each view with what was found in it."""

    points: Array | None = None
    """(P, 3) adjusted points of the objects in the world, metres; NaN where not determined."""

    @cached_property
    def rig(self) -> Rig:
        """The cameras in the world frame asked for."""
        return Rig(self.adjustment.cameras)
