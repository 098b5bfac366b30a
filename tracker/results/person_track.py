"""What a run found of one person: poses, joints and how sure they are, over time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person
from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.foundation.errors import ConfigError, nearest
from tracker.results.recording.csv_table import joint_statuses
from tracker.tracking.doubt import Doubt
from tracker.tracking.estimate import Estimate


@dataclass(frozen=True, repr=False)
class Track:
    """What was found of one person; what is lost is NaN everywhere."""

    name: str
    body: BodyModel
    frames: Integers
    """(T,) numbers of the frames."""

    times_s: Array
    """(T,) seconds."""

    estimates: tuple[Estimate, ...]
    """(T,) all that is known of each frame; the poses of lost ones are predictions and not to be used."""

    def __repr__(self) -> str:
        """Of whom, and how long."""
        return f"Track({self.name!r}, model {self.body.name!r}, {len(self.frames)} frames)"

    @cached_property
    def lost(self) -> Mask:
        """(T,) frames in which the person was not found."""
        mask: Mask = frozen([estimate.lost for estimate in self.estimates], dtype=np.bool_)
        return mask

    @cached_property
    def poses(self) -> Array:
        """(T, dof) rad and m, columns as `parameters`."""
        return self._without_lost(np.array([estimate.q for estimate in self.estimates]))

    @cached_property
    def covariances(self) -> Array:
        """(T, dof, dof) of the poses."""
        return self._without_lost(np.array([estimate.covariance for estimate in self.estimates]))

    @cached_property
    def sigmas(self) -> Array:
        """(T, dof) standard deviations of the poses, rad and m."""
        return frozen(np.sqrt(np.maximum(np.diagonal(self.covariances, axis1=1, axis2=2), 0)))

    @cached_property
    def statuses(self) -> tuple[str, ...]:
        """(T,) `tracked`, `bootstrapped`, `recovered`, `doubtful` or `lost`; in a smoothed result also `filled`."""
        return tuple(str(estimate.verdict) for estimate in self.estimates)

    @cached_property
    def ambiguous(self) -> tuple[tuple[str, ...], ...]:
        """(T,) limbs that may be elsewhere."""
        return tuple(estimate.ambiguous for estimate in self.estimates)

    @cached_property
    def doubts(self) -> tuple[tuple[Doubt, ...], ...]:
        """(T,) why the person is lost or doubtful, or limbs may be elsewhere."""
        return tuple(estimate.doubts for estimate in self.estimates)

    @cached_property
    def distances_px(self) -> Array:
        """(T,) what the poses leave unexplained, px."""
        return frozen([estimate.distance_px for estimate in self.estimates])

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the pose parameters, in the order of `poses`."""
        return self.body.names

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of `joints`."""
        return tuple(self.body.landmark_names[mark] for mark in self.body.reported)

    @cached_property
    def joints(self) -> Array:
        """(T, J, 3) joint centres in the world, metres."""
        poses = np.array([estimate.q for estimate in self.estimates])
        return self._without_lost(self.body.landmarks_in_world(poses)[:, list(self.body.reported)])

    @cached_property
    def joint_statuses(self) -> tuple[tuple[str, ...], ...]:
        """(T, J) the frame's status, or `ambiguous` on a limb that may be elsewhere."""
        person = Person(self.name, self.body, self.body.rest())
        told = (joint_statuses(person, estimate) for estimate in self.estimates)
        return tuple(tuple(statuses[mark] for mark in self.body.reported) for statuses in told)

    def parameter(self, name: str) -> Array:
        """One parameter over time (T,), rad or m.

        Raises:
            ModelError: no such parameter.
        """
        return self.poses[:, self.body.index(name)]

    def joint(self, name: str) -> Array:
        """One joint over time (T, 3), metres.

        Raises:
            ConfigError: no such joint.
        """
        if name not in self.joint_names:
            raise ConfigError(f'"{self.name}" has no joint "{name}"; {nearest(name, self.joint_names)}')
        return self.joints[:, self.joint_names.index(name)]

    def columns(self) -> dict[str, Any]:
        """Everything beside each other in the units of the tables, for `pandas.DataFrame(track.columns())`.

        Returns:
            Column name -> (T,) values: `frame`, `time_s`, `status`, `left_arm_extension_deg`,
            `left_arm_extension_sigma_deg`, `left_elbow_x_m`, ...
        """
        units = np.where(self.body.rotates, 180 / np.pi, 1.0)
        table: dict[str, Any] = {"frame": self.frames, "time_s": self.times_s, "status": list(self.statuses)}
        for k, parameter in enumerate(self.body.parameters):
            table[parameter.column] = units[k] * self.poses[:, k]
        for k, parameter in enumerate(self.body.parameters):
            table[f"{parameter.name}_sigma_{parameter.unit}"] = units[k] * self.sigmas[:, k]
        for j, name in enumerate(self.joint_names):
            table |= {f"{name}_{axis}_m": self.joints[:, j, k] for k, axis in enumerate("xyz")}
        return table

    def _without_lost(self, values: Array) -> Array:
        values[self.lost] = np.nan
        return frozen(values)
