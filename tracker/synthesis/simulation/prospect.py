"""What is to be expected of cameras before anything is filmed: sigmas, what each view adds, what stays hidden."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array
from tracker.synthesis import Synthesis
from tracker.synthesis.simulation.precision import best_views, covariances, joint_sigmas, view_information
from tracker.synthesis.simulation.visibility import by_segment, visible_shares

SHOWN = 0.25
"""Share of a segment's surface that a view must show to tell where it is."""

NEARLY = 1.5
"""Times the error of all cameras that fewer may have and still do."""

_POSES = 20
"""Poses of the movement that are looked at."""


@dataclass(frozen=True)
class Views:
    """What some of the cameras reach."""

    names: tuple[str, ...]
    sigma_mm: float
    """Root mean square over joints and frames of the standard deviation of a joint."""

    worst_joint: str
    worst_mm: float
    """Its standard deviation, root mean square over the frames."""

    worst_angle: str
    worst_deg: float


@dataclass(frozen=True)
class Prospect:
    """What is to be expected of one person and movement."""

    joints_mm: dict[str, tuple[float, float]]
    """Joint -> its standard deviation, root mean square over the frames, and the largest."""

    parameters: dict[str, tuple[float, float]]
    """Pose parameter with its unit -> the same, degrees or millimetres."""

    all_views: Views
    without: dict[str, Views]
    """View -> what the others reach; empty with two views."""

    fewest: dict[int, Views]
    """Number of cameras -> the best so many."""

    visible: dict[str, dict[str, float]]
    """Segment -> view -> share of its surface that is seen, averaged over the frames."""

    hidden: dict[str, float]
    """Segment -> share of the frames in which fewer than two views show a quarter of it."""

    @property
    def enough(self) -> int:
        """The fewest cameras whose error is within `NEARLY` times that of all."""
        return min(n for n, views in self.fewest.items() if views.sigma_mm <= NEARLY * self.all_views.sigma_mm)

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""

        def plain(views: Views) -> dict[str, Any]:
            return {**vars(views), "names": list(views.names)}

        return {
            "joints_sigma_mm": {name: {"rms": rms, "worst": worst} for name, (rms, worst) in self.joints_mm.items()},
            "parameters_sigma": {name: {"rms": rms, "worst": worst} for name, (rms, worst) in self.parameters.items()},
            "all_views": plain(self.all_views),
            "without": {name: plain(views) for name, views in self.without.items()},
            "fewest": {str(n): plain(views) for n, views in self.fewest.items()},
            "enough": self.enough,
            "visible": self.visible,
            "hidden": self.hidden,
        }


def prospect(scene: Scene, poses: Array, synthesis: Synthesis, edge_px: float) -> Prospect:
    """Looks ahead.

    Args:
        scene: one person, and the rig of two or more cameras.
        poses: (T, dof) of the movement.
        synthesis: traces contours and paints parts.
        edge_px: standard deviation of an edge position, px.
    """
    body, names = scene.persons[0].body, scene.rig.names
    chosen = poses[np.unique(np.linspace(0, len(poses) - 1, _POSES).round().astype(int))]
    information = view_information(scene, chosen, synthesis, edge_px)
    reported = list(body.reported)

    def reached(views: tuple[int, ...]) -> tuple[Views, Array, Array]:
        covariance = covariances(body, information, views)
        joints = 1000 * joint_sigmas(body, chosen, covariance)[:, reported]
        own = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)) * np.where(body.rotates, np.degrees(1.0), 1000.0)
        by_joint, by_angle = _rms(joints), np.where(body.rotates, _rms(own), 0.0)
        j, a = int(by_joint.argmax()), int(by_angle.argmax())
        found = Views(
            tuple(names[v] for v in views),
            float(np.sqrt(np.mean(joints**2))),
            body.landmark_names[reported[j]],
            float(by_joint[j]),
            body.names[a],
            float(by_angle[a]),
        )
        return found, joints, own

    everything = tuple(range(len(names)))
    all_views, joints, own = reached(everything)
    units = ["deg" if rotates else "mm" for rotates in body.rotates]
    segments = by_segment(body, visible_shares(scene, chosen, synthesis))
    return Prospect(
        joints_mm={body.landmark_names[mark]: pair for mark, pair in zip(reported, _rms_and_most(joints), strict=True)},
        parameters={
            f"{name}_{unit}": pair for name, unit, pair in zip(body.names, units, _rms_and_most(own), strict=True)
        },
        all_views=all_views,
        without={name: reached(tuple(one for one in everything if one != v))[0] for v, name in enumerate(names)}
        if len(names) > 2
        else {},
        fewest={n: reached(views)[0] for n, views in best_views(body, chosen, information).items()},
        visible={
            name: dict(zip(names, shares.mean(axis=0).tolist(), strict=True)) for name, shares in segments.items()
        },
        hidden={name: float(np.mean((shares >= SHOWN).sum(axis=1) < 2)) for name, shares in segments.items()},
    )


def _rms(values: Array) -> Array:
    root: Array = np.sqrt(np.mean(values**2, axis=0))
    return root


def _rms_and_most(values: Array) -> list[tuple[float, float]]:
    return list(zip(_rms(values).tolist(), values.max(axis=0).tolist(), strict=True))
