"""Forward kinematics, collisions of parts, and places of a body beside what images show of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Integers, Mask

# Places on parts that are followed in images: how far from there parts carry them, and the equations that bring them.
#
# Places lie on the surface where a viewing ray met it, so they are surest across that ray.


class Carried(NamedTuple):
    """N places on parts of a scene, and where an image shows them."""

    views: Integers
    """(N,) whose image."""

    parts: Integers
    """(N,) of the scene."""

    places: Array
    """(N, 3) in the part's frame, metres."""

    normals: Array
    """(N, 3) unit vectors out of the surface, in the part's frame."""

    rays: Array
    """(N, 3) unit vectors along the ray by which the place was found, in the part's frame."""

    depths_m: Array
    """(N,) standard deviation of the place along that ray, metres."""

    pixels: Array
    """(N, 2) where the image shows it."""

    variances: Array
    """(N,) of the pixel in either axis, px^2."""


def gaps_of(placements: Array, cameras: Array, carried: Carried, most_m: float, gaps: Array) -> None:
    """How far from where they are shown poses carry the places, px; no more than a distance on the body.

    Args:
        placements: (B, P, 4, 4) world_from_part.
        cameras: (V, 29) from `Rig.packed`.
        carried: the places.
        most_m: that distance, metres; also of what lies behind the camera.
        gaps: (B, N) output.
    """
    native.gaps_of(placements, cameras, carried, most_m, gaps)


def residuals_of(placements: Array, cameras: Array, carried: Carried, slide_m: float, found: Array) -> None:
    """Where a pose carries the places, less where they are shown.

    Args:
        placements: (1, P, 4, 4) world_from_part.
        cameras: (V, 29) from `Rig.packed`.
        carried: the places.
        slide_m: standard deviation of a place across its ray, for clothes slide, metres.
        found: (N, 10) output, a row each; `tracker.kernels.rows.CarriedPlaceRow` names the columns.
    """
    native.residuals_of(placements, cameras, carried, slide_m, found)


def anchor_equations(
    placements: Array, carried: Carried, found: Array, weights: Array, ends: Integers, twists: Array, moves: Mask
) -> tuple[Array, Array, float, float]:
    """Normal equations that bring the places to where they are shown.

    By wrenches, see native/body/wrenches.hpp.

    Args:
        placements: (1, P, 4, 4) world_from_part.
        carried: the places.
        found: (N, 10) from `residuals_of`.
        weights: (N,) px^-2.
        ends: (P,) last parameter that moves each part, -1 for the world; -2 for parts that do not count.
        twists: (dof, 6) spatial twists of the parameters.
        moves: (dof, dof + 1) from `BodyModel.moves`.

    Returns:
        J^T W J (dof, dof), J^T W r (dof,), sum of w r^2 and sum of w; each place has two residuals.
    """
    matrix, vector = np.empty((len(twists), len(twists))), np.empty(len(twists))
    sums = native.anchor_equations(placements, carried, found, weights, ends, twists, moves, matrix, vector)
    return matrix, vector, *sums


# Points of a body in many poses beside 2-D detections of them: which detection, with which sides, and how far.


class Detected(NamedTuple):
    """What a detector found in V views, of L keypoints that mean points of a body."""

    found: Array
    """(N, L, 3) pixel and confidence of N detections, those of a view after one another; confidence 0: not found."""

    first: Integers
    """(V + 1,) first detection of each view, and N."""

    other: Integers
    """(L,) keypoint of the other side; itself where there is none."""

    limbs: Integers
    """(L,) number of the limb whose sides are exchanged together; -1 for keypoints without a side."""


class Matches(NamedTuple):
    """Room for what is found, of B poses."""

    gaps: Array
    """(B, V, L, 2) from keypoint to point of the body, px; 0 where the weight is."""

    weights: Array
    """(B, V, L) confidences; 0 where there is no keypoint, or the point is not before the camera."""

    px_per_m: Array
    """(B, V, L) size of a metre at the point of the body."""

    losses: Array
    """(B, V, L) share of an outlier that a keypoint counts, 0 to 1 and what its exchange costs.

    Geman and McClure's loss of a gap, s^2 / (1 + s^2): half of an outlier at the reach, 1 far off.
    """


def match_keypoints(
    points: Array, cameras: Array, detected: Detected, n_limbs: int, reach: tuple[float, float], matches: Matches
) -> None:
    """Takes in each view the detection of least loss for each pose, limb by limb with the sides of less loss.

    Args:
        points: (B, L, 3) of the body, metres.
        cameras: (V, 29) from `Rig.packed`.
        detected: what was found.
        n_limbs: limbs with sides.
        reach: distance of half a loss, metres; and what it costs to exchange a keypoint's side, share of an outlier.
        matches: written.
    """
    native.match_keypoints(points, cameras, detected, n_limbs, reach, matches)


# Forward kinematics by product of exponentials, batched over poses.


def chain_transforms(poses: Array, rotates: Mask, axes: Array, points: Array, parents: Integers) -> Array:
    """Motion of the reference pose at the end of every parameter's chain.

    Args:
        poses: (B, dof) rad or m.
        rotates: (dof,) rotation or translation.
        axes: (dof, 3) unit axes in the reference pose.
        points: (dof, 3) points on the axes, metres.
        parents: (dof,) index of the preceding parameter, -1 for none; parents come first.

    Returns:
        (B, dof + 1, 4, 4); entry `dof` is the unit motion, so that index -1 means the world.
    """
    motions = np.empty((len(poses), poses.shape[1] + 1, 4, 4))
    native.chain_transforms(poses, rotates, axes, points, parents, motions)
    return motions


def twists_in_world(motions: Array, rotates: Mask, axes: Array, points: Array, parents: Integers) -> Array:
    """Spatial twists of all parameters at given poses.

    Args:
        motions: (B, dof + 1, 4, 4) from `chain_transforms`.
        rotates, axes, points, parents: as there.

    Returns:
        (B, dof, 6) linear velocity v and angular velocity w of unit speed: a point X moves by v + w x X.
    """
    twists = np.empty((len(motions), len(axes), 6))
    native.twists_in_world(motions, rotates, axes, points, parents, twists)
    return twists


def meet_parts(placements: Array, shapes: Array, centre: Array, rays: Array, parts: Integers, found: Array) -> None:
    """The first crossing of each ray with one part.

    Args:
        placements: (P, 4, 4) world_from_part.
        shapes: (P, 7) packed superquadrics.
        centre: (3,) where the rays start, metres.
        rays: (N, 3) unit vectors in the world.
        parts: (N,) which part each of them is to meet.
        found: (N, 10) output, a row each; `tracker.kernels.rows.MetPlaceRow` names the columns.
    """
    native.meet_parts(placements, shapes, centre, rays, parts, found)


# Parts of a body that run through each other.

POINTS_A_PART = 5
"""Along the middle 80 % of an axis: joints overlap by design."""


def sum_collisions(placements: Array, shapes: Array, pairs: Integers) -> Array:
    """Points on the axes of parts that lie inside other parts, five to a part, by how deep they lie.

    Surfaces that touch count for nothing, and what is deep inside another part for one a point.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        shapes: (P, 7) packed superquadrics.
        pairs: (N, 2) parts that must not run through each other.

    Returns:
        (B,) sums over the points.
    """
    sums = np.empty(len(placements))
    native.sum_collisions(placements, shapes, pairs, sums)
    return sums


def depth(shape: Array, u: float, v: float, w: float) -> float:
    """How deep a point lies inside a part: 0 at its surface, 1 on its axis, along the line between them across it.

    Args:
        shape: (7,) packed superquadric.
        u, v, w: position in the part's frame divided by a1, a2, a3; inside.
    """
    return native.depth(shape, u, v, w)
