"""A scanned person's model: the skeleton of a general model put into the scan, superquadrics fitted, the skin beside.

The general model says what the parameters are called, in which direction they count, and which segments are one; the
scan says where the joints are and about which axes they turn. The angles of the scan's pose in the general model's
terms are found limb by limb, so that zero stays what it is there: arms and legs hanging.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tracker.acquisition.scan import SAME_PLACE_M, Placed, Scan, joint_of, placed_segment, triple
from tracker.bodies.body.description import BodyDescription
from tracker.bodies.body.entries import LandmarkEntry, PartEntry
from tracker.bodies.body.sections import SkinSection
from tracker.bodies.segments import Mirror
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ModelError, nearest
from tracker.foundation.geometry.superquadrics import inside_outside

# Standard deviations of a shape about a plain can along the axis given: what the points do not show stays so.
_LENGTH, _SQUARENESS, _TAPER, _TILT_RAD = 0.1, 0.3, 0.3, 0.2
# A surface point lies so far off a superquadric, as a share of its thickness.
_NOISE = 0.1
# More points than this tell no more of 13 numbers, and take longer.
_MOST_POINTS = 600
_LEAST_POINTS = 12


@dataclass(frozen=True)
class Fitted:
    """A superquadric and its place."""

    shape: Array
    """(7,) packed superquadric, metres."""

    placement: Array
    """(4, 4) of the part's frame."""

    rms_m: float
    """Of the distances of the points along the lines to its middle, metres."""

    bias_m: float
    """Their mean, positive where the points lie outside, metres."""


def fit_superquadric(points: Array, weights: Array, axis: Array, front: Array) -> Fitted:
    """Fits place, extents, squareness and taper by least squares of radial distances.

    The distance of a point x along the line to the middle is ``|x| (1 - F(x)^(-e1/2))`` (exact without a taper).

    Args:
        points: (N, 3) metres.
        weights: (N,) how much of the surface each stands for.
        axis: (3,) about the direction of its z axis.
        front: (3,) about that of x.

    Returns:
        The fit; of fewer than 12 points, a rounded can around them.
    """
    start = _frame(axis, front)
    chosen = np.linspace(0, len(points) - 1, min(len(points), _MOST_POINTS)).astype(int)
    own, share = points[chosen], np.sqrt(weights[chosen] / max(float(weights[chosen].mean()), 1e-12))
    local = own @ start
    low, high = np.percentile(local, [1, 99], axis=0)
    half, centre = np.maximum((high - low) / 2, 0.005), start @ ((low + high) / 2)
    noise = _NOISE * float(half.min())

    def parted(x: Array) -> tuple[Array, Array, Array]:
        rotation = start @ Rotation.from_rotvec(_TILT_RAD * x[3:6]).as_matrix()
        shape = np.concatenate([half * np.exp(x[6:9]), x[9:13]])
        return shape, rotation, centre + noise * x[:3]

    def distances(x: Array) -> Array:
        shape, rotation, middle = parted(x)
        inside = (own - middle) @ rotation
        value = np.maximum(inside_outside(shape, inside), 1e-9)
        gap: Array = np.linalg.norm(inside, axis=1) * (1 - value ** (-shape[3] / 2))
        return gap

    def residuals(x: Array) -> Array:
        prior = [x[3:6], [x[8] / _LENGTH], (x[9:11] - (0.5, 1.0)) / _SQUARENESS, x[11:13] / _TAPER]
        return np.concatenate([share * distances(x) / noise, *prior])

    first = np.array([0, 0, 0, 0, 0, 0, 0, 0, 0, 0.5, 0.9, 0, 0], dtype=np.float64)
    bounds = np.array([[np.inf] * 3 + [3.0] * 3 + [0.7] * 3 + [1.0, 1.0, 0.6, 0.6]] * 2)
    bounds[0] *= -1
    bounds[0, 9:11] = 0.15
    found = first
    if len(own) >= _LEAST_POINTS:
        found = least_squares(residuals, first, bounds=(bounds[0], bounds[1]), loss="soft_l1", max_nfev=60).x
    shape, rotation, middle = parted(found)
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = rotation, middle
    gaps = distances(found)
    total = float((share**2).sum())
    rms, bias = np.sqrt((share**2 * gaps**2).sum() / total), (share**2 * gaps).sum() / total
    return Fitted(shape, placement, float(rms), float(bias))


def _frame(axis: Array, front: Array) -> Array:
    """(3, 3) rotation whose z axis is one direction, and x as near to another as can be."""
    z = axis / np.linalg.norm(axis)
    y = np.cross(z, front)
    if np.linalg.norm(y) < 0.1:
        y = np.cross(z, (0.0, 0.0, 1.0))
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], axis=1)


_UPRIGHT = 0.3
"""Cosine between a trunk and that of the model, which stands, at least: lower ones lie, or y is up."""


@dataclass(frozen=True)
class Rigged:
    """A scanned person's model, and how well its parts fit the scan."""

    description: BodyDescription
    fits: dict[str, Fitted]
    """Part -> its fit."""


def rigged(general: BodyDescription, scan: Scan, name: str) -> Rigged:
    """A person's model of a scan; its skin has no files yet.

    Args:
        general: the model whose parameters, groups and conventions it has.
        scan: in the model's frame.
        name: of the model.

    Raises:
        ModelError: the scan has no segment of that model, or another axis than z is up in it.
    """
    owners = _owners(general, scan)
    _check_upright(general, scan)
    ratio = _height(scan) / general.stature_m if general.stature_m > 0 else 1.0
    larger, placed, segments = general.scaled(ratio), Placed(), []
    for entry in general.segments:
        segments.append(placed_segment(entry, general, scan, placed, ratio))
    fits, parts = _parts(scan, owners, placed)
    kept = {part.name for part in parts}
    mirror = Mirror(general.sides, general.across)
    garments = {
        key: tuple(one for one in worn if mirror.meant(one, kept)) for key, worn in general.clothes.garments.items()
    }
    clothes = {
        "garments": {key: worn for key, worn in garments.items() if worn},
        "hair": tuple(one for one in general.clothes.hair if mirror.meant(one, kept)),
    }
    changes = {
        "name": name,
        "about": f"acquired from a scan, from {general.name}",
        "stature_m": _height(scan),
        "segments": tuple(segments),
        "parts": tuple(parts),
        "landmarks": _landmarks(general, scan, placed, ratio),
        "keypoints": larger.keypoints,
        "movements": larger.movements,
        "clothes": general.clothes.model_copy(update=clothes),
        "sigmas": {},
        "skin": SkinSection(surface="scan.ply", weights="scan.npz", pose_deg=placed.pose_deg),
    }
    return Rigged(general.model_copy(update=changes), fits)


def _check_upright(general: BodyDescription, scan: Scan) -> None:
    """Refuses a scan whose midline does not run as the model's does."""
    mirror, root = Mirror(general.sides, general.across), general.segments[0]
    known = {one.child: one.centre for one in scan.joints if mirror.of(one.child) == one.child}
    ways = {one.name: np.subtract(one.joint, root.joint) for one in general.segments if one.name in known}
    if not ways:
        return
    name = max(ways, key=lambda one: float(np.linalg.norm(ways[one])))
    lengths = float(np.linalg.norm(ways[name]) * np.linalg.norm(known[name]))
    cosine = float(ways[name] @ known[name]) / lengths if lengths else 1.0
    if cosine < _UPRIGHT:
        raise ModelError(
            f'the joint of "{name}" lies {np.degrees(np.arccos(max(cosine, -1.0))):.0f} degrees from where the model '
            f'"{general.name}" has it, seen from the root: expected z up in the scan, and somebody who stands or sits'
        )


def _height(scan: Scan) -> float:
    return float(np.ptp(scan.surface.points[:, 2]))


def _owners(general: BodyDescription, scan: Scan) -> dict[str, str]:
    """Segment of the scan -> that of the model which it moves with: of its own name, or of what it hangs on."""
    names = [segment.name for segment in general.segments]
    found = {}
    for segment in scan.rigging.segments:
        above: str | None = segment
        while above is not None and above not in names:
            joint = scan.joint_of(above)
            above = None if joint is None else joint.parent
        found[segment] = above or names[0]
    if not set(names[1:]) & set(scan.rigging.segments):
        raise ModelError(
            f'the scan has no segment of model "{general.name}"; {nearest(names[-1], scan.rigging.segments)}'
        )
    return found


def _parts(scan: Scan, owners: dict[str, str], placed: Placed) -> tuple[dict[str, Fitted], list[PartEntry]]:
    """A superquadric for each segment of the scan, fitted to the vertices that it moves most."""
    labels, areas = scan.rigging.weights.argmax(axis=1), _vertex_areas(scan)
    fits, parts = {}, []
    for k, name in enumerate(scan.rigging.segments):
        own = labels == k
        if not own.any():
            continue
        points, owner = scan.surface.points[own], owners[name]
        weights = areas[own] if areas[own].any() else np.ones(len(points))  # of no face, they have no area
        middle = weights @ points / weights.sum()
        found = fit_superquadric(points, weights, _direction(scan, name, middle), np.array([1.0, 0.0, 0.0]))
        fits[name] = found
        rotation, centre, half = found.placement[:3, :3], found.placement[:3, 3], found.shape[2]
        ends = [placed.in_reference(owner, centre + way * half * rotation[:, 2]) for way in (-1, 1)]
        parts.append(
            PartEntry(
                name=name,
                segment=owner,
                start=triple(ends[0]),
                end=triple(ends[1]),
                radii=(float(found.shape[0]), float(found.shape[1])),
                squareness=(float(found.shape[3]), float(found.shape[4])),
                taper=(float(found.shape[5]), float(found.shape[6])),
                front=triple(placed.rotations[owner].T @ rotation[:, 0]),
            )
        )
    return fits, parts


def _direction(scan: Scan, name: str, middle: Array) -> Array:
    """(3,) long axis of a segment: from its joint to the next one, or to the middle of its surface."""
    own = scan.joint_of(name)
    behind = [joint.centre for joint in scan.joints if joint.parent == name]
    if own is None or len(behind) > 1:
        return np.array([0.0, 0.0, 1.0])
    ways = [end - own.centre for end in (*behind, middle)]
    # rigging programs put joints, for instance those of a twist, into one place
    return next((way for way in ways if np.linalg.norm(way) > SAME_PLACE_M), np.array([0.0, 0.0, 1.0]))


def _vertex_areas(scan: Scan) -> Array:
    """(N,) area of the surface that each vertex stands for, square metres."""
    corners = scan.surface.points[scan.surface.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    shares = np.bincount(scan.surface.faces.ravel(), areas.repeat(3) / 3, minlength=len(scan.surface.points))
    return np.asarray(shares, dtype=np.float64)


def _landmarks(general: BodyDescription, scan: Scan, placed: Placed, ratio: float) -> dict[str, LandmarkEntry]:
    """The model's landmarks where the scan has them; others keep their scaled place on their segment."""
    known = scan.marks | {joint.name: joint.centre for joint in scan.joints}
    found = {}
    for name, mark in general.landmarks.items():
        if name in known:
            at = placed.in_reference(mark.segment, known[name])
        else:
            at = placed.joints[mark.segment] + ratio * (np.array(mark.at) - joint_of(general, mark.segment))
        found[name] = mark.model_copy(update={"at": triple(at)})
    return found
