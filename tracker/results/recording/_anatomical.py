"""Joint angles as the International Society of Biomechanics defines them.

Wu et al., J. Biomechanics 35, 2002 (hip, ankle, spine) and 38, 2005 (shoulder, elbow); knee after Grood and Suntay, J.
Biomech. Eng. 105, 1983. Segment axes are x forwards, y up, z to the right in the model's reference pose, upright with
the limbs straight down, where all angles are zero.
"""

from __future__ import annotations

import base64
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person
from tracker.foundation.arrays import Array
from tracker.foundation.files import csv_lines
from tracker.results.recording._motion import Y_UP
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Step

_MIRRORED = np.diag([1.0, 1.0, -1.0])
"""Left limbs are reflected onto the right side, as the standard says."""

_NO_PLANE_DEG = 5.0
"""Elevation of an upper arm from straight down, or up, below which the plane of elevation is undefined."""

_NOTHING = 1e-9
"""Largest value, rad, of an angle that is zero in all poses."""

_STEP = 1e-6
"""Change of parameters, rad and m, for the derivatives of the angles."""

_UPRIGHT = np.cos(np.radians(20.0))
"""Limbs of a reference pose hang down if their angle to the vertical is smaller."""


@dataclass(frozen=True)
class AnatomicalJoint:
    """A joint with angles of its own."""

    name: str
    """For instance `left_knee`."""

    proximal: int
    """Proximal segment."""

    distal: int
    """Distal segment."""

    angles: tuple[str, ...]
    """Names of the angles, for instance `flexion`."""

    measured: Callable[[Array], Array]
    """Rotations (T, 3, 3) of the distal in the proximal segment, in the standard's axes -> angles, rad, a row each."""

    mirrored: bool
    """Whether it is on the left."""

    columns: tuple[int, ...]
    """Numbers of these angles among the measured ones."""

    def of(self, turns: Array) -> Array:
        """Angles (T, A), rad, of rotations (T, S, 3, 3) of all segments in the world."""
        relative = turns[:, self.proximal].transpose(0, 2, 1) @ turns[:, self.distal]
        standard = Y_UP @ relative @ Y_UP.T
        measured = self.measured(_MIRRORED @ standard @ _MIRRORED if self.mirrored else standard)
        return measured[:, list(self.columns)]

    def changing_in(self, turns: Array) -> AnatomicalJoint:
        """The joint without angles that are zero in all of some rotations (T, S, 3, 3)."""
        moves = ~(np.abs(self.of(turns)) < _NOTHING).all(axis=0)  # an angle that says nothing is none that stays zero
        angles, columns = (tuple(np.compress(moves, of).tolist()) for of in (self.angles, self.columns))
        return replace(self, angles=angles, columns=columns)


def angles_of(joints: Sequence[AnatomicalJoint], body: BodyModel, q: Array, covariances: Array) -> tuple[Array, Array]:
    """Angles of all joints at poses, and their standard deviations.

    Args:
        joints: of the body.
        body: owner of the poses.
        q: (T, dof) rad and m.
        covariances: (T, dof, dof) of them, carried on to the angles to first order.

    Returns:
        (T, A) and (T, A) degrees; NaN if an angle is undefined, or the pose unknown.
    """
    poses = q[:, None] + np.vstack([np.zeros(body.dof), _STEP * np.eye(body.dof)])
    turns = body.world_from_parameters(poses.reshape(-1, body.dof))[
        :, [segment.end for segment in body.segments], :3, :3
    ]
    angles = np.concatenate([joint.of(turns) for joint in joints], axis=1).reshape(len(q), body.dof + 1, -1)
    rates = (np.remainder(angles[:, 1:] - angles[:, :1] + np.pi, 2 * np.pi) - np.pi) / _STEP
    variances = np.einsum("tka,tkl,tla->ta", rates, covariances, rates)
    return np.degrees(angles[:, 0]), np.degrees(np.sqrt(np.maximum(variances, 0.0)))


def joints_of(body: BodyModel) -> list[AnatomicalJoint]:
    """The joints with angles of the standard, as far as the body has them.

    Empty for a body without a person's landmarks.
    """
    segments = {segment.name: k for k, segment in enumerate(body.segments)}
    holders = {mark.name: segments[mark.segment] for mark in body.landmarks if mark.segment in segments}
    found = []
    for name, (proximal, distal, angles, measured) in _JOINTS.items():
        for side in ("left_", "right_") if name in _SIDED else ("",):
            ends = [mark if mark in ("pelvis", "neck", "head_top") else side + mark for mark in (proximal, distal)]
            if set(ends) <= set(holders) and holders[ends[0]] != holders[ends[1]]:
                pair = holders[ends[0]], holders[ends[1]]
                columns = tuple(range(len(angles)))
                found.append(AnatomicalJoint(side + name, *pair, angles, measured, side == "left_", columns))
    turns = _all_turned(body)
    return [joint for joint in (one.changing_in(turns) for one in found) if joint.angles]


def _all_turned(body: BodyModel) -> Array:
    """Rotations (2, S, 3, 3) of the segments in the world, every joint turned, by other angles, one way and the other.

    Angles that no parameter between two segments turns are zero in both; limits may forbid one way.
    """
    turned = np.linspace(0.3, 0.6, body.dof)
    poses = np.stack([body.clamped(turned), body.clamped(-turned)])
    return body.world_from_parameters(poses)[:, [segment.end for segment in body.segments], :3, :3]


def leaning_limb(body: BodyModel) -> str:
    """A limb that does not hang down in the reference pose: its angles would not be the standard's; or none."""
    places = {mark.name: mark.point for mark in body.landmarks}
    for side in ("left", "right"):
        for upper, lower in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist")):
            ends = f"{side}_{upper}", f"{side}_{lower}"
            if set(ends) <= set(places):
                bone = places[ends[1]] - places[ends[0]]
                if -bone[2] < _UPRIGHT * np.linalg.norm(bone):
                    return f"{ends[0]} to {ends[1]}"
    return ""


def _hinged(signs: tuple[float, float, float], n_angles: int) -> Callable[[Array], Array]:
    """Angles about z, the floating x and y (Grood and Suntay's joint coordinate system), times signs."""
    return lambda turns: np.array(signs[:n_angles]) * _euler(turns, "ZXY")[:, :n_angles]


def _shoulder(turns: Array) -> Array:
    """Plane of elevation, elevation and axial rotation: y x y, with the negative turn about x (Wu 2005, 2.4.7)."""
    first, elevation, second = _euler(turns, "YXY").T
    plane, axial = (np.remainder(angle, 2 * np.pi) - np.pi for angle in (first, second))
    hanging = np.minimum(elevation, np.pi - elevation) < np.radians(_NO_PLANE_DEG)
    angles: Array = np.stack([plane, elevation, axial], axis=1)
    angles[hanging, 0] = angles[hanging, 2] = np.nan
    return angles


def _euler(turns: Array, order: Literal["ZXY", "YXY"]) -> Array:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the outer axes coincide
        angles: Array = Rotation.from_matrix(turns).as_euler(order)
    return angles


_JOINTS: dict[str, tuple[str, str, tuple[str, ...], Callable[[Array], Array]]] = {
    "trunk": ("pelvis", "neck", ("flexion", "lateral_bending", "axial_rotation"), _hinged((-1, 1, 1), 3)),
    "neck": ("neck", "head_top", ("flexion", "lateral_bending", "axial_rotation"), _hinged((-1, 1, 1), 3)),
    "shoulder": ("neck", "shoulder", ("plane_of_elevation", "elevation", "axial_rotation"), _shoulder),
    "elbow": ("shoulder", "elbow", ("flexion",), _hinged((1, 1, 1), 1)),
    "hip": ("pelvis", "hip", ("flexion", "adduction", "internal_rotation"), _hinged((1, 1, 1), 3)),
    "knee": ("hip", "knee", ("flexion",), _hinged((-1, 1, 1), 1)),
    "ankle": ("knee", "ankle", ("dorsiflexion",), _hinged((1, 1, 1), 1)),
}
"""Joint -> landmarks on its proximal and its distal segment, its angles, and how they are measured."""

_SIDED = {"shoulder", "elbow", "hip", "knee", "ankle"}
"""Joints on both sides."""


# Joint angles of the ISB over a run, left beside right: a figure, a table and a file for the report.

_WIDE, _HIGH, _BELOW = 6.5, 1.1, 0.6
"""Inches: a figure's width, a panel's height, and margins below and beside the panels for numbers."""

_COLOURS = {"left": "#2a6f85", "right": "#b5533c", "": "#4a4f57"}
"""Colours of the sides' curves."""


_AT_ONCE = 32
"""Frames whose angles are computed together: 0.3 ms each. One by one they take 1 ms, and 3 ms during a run."""


class Sides(NamedTuple):
    """A row of the table: range of an angle on the left and on the right, or in the middle alone."""

    angle: str
    left: str
    right: str


@dataclass
class IsbSeries:
    """Angles of one person so far; empty for a body without angles of the standard."""

    person: Person
    joints: list[AnatomicalJoint]
    times_s: list[float] = field(default_factory=list)
    heads: list[list[object]] = field(default_factory=list)
    _known: list[Array] = field(default_factory=list)
    _waiting: list[Estimate] = field(default_factory=list)

    @staticmethod
    def of(person: Person) -> IsbSeries:
        """Nothing yet; without joints where limbs do not hang down in the reference pose."""
        return IsbSeries(person, [] if leaning_limb(person.body) else joints_of(person.body))

    @property
    def names(self) -> list[str]:
        """(A,) of the angles, for instance `left_hip_flexion`."""
        return [f"{joint.name}_{angle}" for joint in self.joints for angle in joint.angles]

    def add(self, step: Step, estimate: Estimate) -> None:
        """Takes the angles of one frame."""
        if self.joints:
            self.times_s.append(step.frame.time_s)
            told = str(estimate.verdict), " ".join(estimate.ambiguous)
            self.heads.append([step.frame.index, f"{step.frame.time_s:.6f}", *told])
            self._waiting.append(estimate)
            if len(self._waiting) == _AT_ONCE:
                self._settle()

    def _settle(self) -> None:
        """Computes the angles of the frames that wait."""
        waiting = self._waiting
        if waiting:
            of = np.array([one.q for one in waiting]), np.array([one.covariance for one in waiting])
            values = np.stack(angles_of(self.joints, self.person.body, *of), axis=1)
            values[[one.lost for one in waiting]] = np.nan
            self._known.append(values)
            self._waiting = []

    @property
    def values(self) -> Array:
        """(T, 2, A) angles and standard deviations, degrees."""
        self._settle()
        self._known = [np.concatenate(self._known)]
        return self._known[0]

    def table(self) -> str:
        """A CSV table as a link holds it: a row a frame, angles, then their standard deviations."""
        columns = [f"{name}_{what}" for what in ("deg", "sigma_deg") for name in self.names]
        lines = [["frame", "time_s", "status", "ambiguous", *columns]]
        rows = [[*head, *map(_text, both.ravel())] for head, both in zip(self.heads, self.values, strict=True)]
        return "data:text/csv;base64," + base64.b64encode(csv_lines([*lines, *rows]).encode()).decode()

    def rows(self) -> list[Sides]:
        """Ranges of each angle, left beside right."""
        told = dict(zip(self.names, (self._told(k) for k in range(len(self.names))), strict=True))
        found = []
        for angle, sides in self._paired():
            own = [told[name] for name in sides.values()]
            found.append(Sides(angle, own[0], own[1] if len(own) > 1 else ""))
        return found

    def _told(self, k: int) -> str:
        angles, sigmas = self.values[:, :, k].T
        known = angles[np.isfinite(angles)]
        if not len(known):
            return "-"
        sure = sigmas[np.isfinite(sigmas)]
        low, high = (round(float(end)) for end in (known.min(), known.max()))
        return f"{low} to {high}" + (f" ± {np.median(sure):.1f}" if len(sure) else "")

    def _paired(self) -> list[tuple[str, dict[str, str]]]:
        """Angle in words -> side -> name; an unpaired joint has an empty side."""
        found: dict[str, dict[str, str]] = {}
        for name in self.names:
            side = next((one for one in ("left", "right") if name.startswith(f"{one}_")), "")
            found.setdefault(name.removeprefix(f"{side}_").replace("_", " "), {})[side] = name
        return list(found.items())

    def figure(self) -> Figure:
        """A row an angle, left beside right on one scale, with a band of a standard deviation to each side."""
        paired = self._paired()
        high = _HIGH * len(paired) + _BELOW
        figure = Figure(figsize=(_WIDE, high))
        margins = {"left": _BELOW / _WIDE, "right": 0.98, "bottom": _BELOW / high, "top": 1 - 0.4 / high}
        grid = figure.add_gridspec(len(paired), 2, **margins, hspace=0.62, wspace=0.15)
        for row, (angle, sides) in enumerate(paired):
            first: Axes | None = None
            for column, (side, name) in enumerate(sides.items()):
                place = grid[row, column] if len(sides) > 1 else grid[row, :]
                axis = figure.add_subplot(place, sharey=first)
                self._draw(axis, self.names.index(name), side)
                axis.set_title(f"{side} {angle}".strip(), fontsize=8, y=1.0)
                axis.tick_params(labelbottom=row == len(paired) - 1 or len(sides) != len(paired[row + 1][1]))
                first = first or axis
        figure.supxlabel("time, s", fontsize=8)
        figure.supylabel("degrees", fontsize=8)
        return figure

    def _draw(self, axis: Axes, k: int, side: str) -> None:
        angles, sigmas = self.values[:, :, k].T
        shown = np.degrees(np.unwrap(np.radians(angles))) if np.isfinite(angles).all() else angles
        axis.fill_between(self.times_s, shown - sigmas, shown + sigmas, color=_COLOURS[side], alpha=0.25, lw=0)
        axis.plot(self.times_s, shown, color=_COLOURS[side], lw=1)
        axis.tick_params(labelsize=7)
        axis.locator_params(axis="x", nbins=5)
        axis.locator_params(axis="y", nbins=4)
        axis.grid(alpha=0.3)


def _text(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else ""
