"""Distances between model contours and image contours in metres at the person, with derivatives."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tracker.acquisition.clouds import Look
from tracker.acquisition.shape_space import Variants, heights, levels
from tracker.bodies.body import BodyModel
from tracker.bodies.contours import Contours
from tracker.bodies.scene import Person, Scene
from tracker.cameras.rig import Rig
from tracker.evidence.measures.outlines import on_outline
from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.foundation.geometry.superquadrics import shape_derivatives
from tracker.images.sight import Observation
from tracker.kernels.contours import match_oriented
from tracker.synthesis import Synthesis

Bodies = tuple[BodyModel, Variants, Array]
"""A body, its neighbours in the shape space, and the (S,) steps to them."""


# What a point asks of its part: the upper three rows of its placement, its shape, the twist of its segment.
_PLACED, _FORMED, _CARRIED, _N_ASKED = slice(0, 12), slice(12, 19), slice(19, 25), 25


@dataclass(frozen=True)
class Rows:
    """N residuals with derivatives; a residual is metres in the image plane's direction at the model point."""

    residuals: Array
    """(N,) m, along the contour's normal: positive where the model is too large."""

    asks: Array
    """(N, 25) of their parts, see `asks_of`: times `part_slopes` the derivative by shape and pose."""

    lengths_m: Array
    """(N,) contour each stands for, metres."""

    parts: Integers
    """(N,) part of the model point."""

    views: Integers
    inner: Mask
    """(N,) from edges, not from the outline of a silhouette."""

    weights: Array
    """(N,)"""

    patches: Integers
    """(N,) stretch of the body's surface that the model point lies on, see `patches_of`."""

    def joined(self, other: Rows) -> Rows:
        """These rows and others."""
        fields = self.__dataclass_fields__
        return Rows(**{name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in fields})


def no_rows() -> Rows:
    """Rows of nothing."""
    none, whole = np.zeros(0), np.zeros(0, dtype=np.int64)
    return Rows(none, np.zeros((0, _N_ASKED)), none, whole, whole, np.zeros(0, dtype=np.bool_), none, whole)


def look_rows(look: Look, bodies: Bodies, q: Array, synthesis: Synthesis, gate: tuple[float, float]) -> Rows:
    """Rows of all contour pairs of a look.

    Args:
        look: the images.
        bodies: the body and its neighbours.
        q: (dof,) pose.
        synthesis: makes the contours.
        gate: largest distance of a pair, metres, and angle, degrees.
    """
    body = bodies[0]
    if look.outlines is None and look.edges is None:
        return no_rows()
    scene = Scene((Person("subject", body, q),), look.rig)
    contours = synthesis.contours(scene)
    scale = pixels_per_metre(look.rig, contours)
    found: list[Rows] = []
    if look.outlines is not None:
        outer = on_outline(contours, scene, synthesis)
        found.append(_matched(look.rig, bodies, q, _only(contours, outer), (look.outlines, False), (*gate, scale)))
    if look.edges is not None:
        found.append(_matched(look.rig, bodies, q, contours, (look.edges(contours), True), (*gate, scale)))
    rows = found[0]
    for more in found[1:]:
        rows = rows.joined(more)
    return rows


def _only(contours: Contours, kept: Mask) -> Contours:
    """The contours with all other samples weightless, which are not matched."""
    positions = contours.positions.copy()
    positions[0, ~kept, 4] = 0.0
    return replace(contours, positions=positions)


def pixels_per_metre(rig: Rig, contours: Contours) -> Array:
    """(V,) size of a metre at the person in each view, px; NaN where nothing of it is seen."""
    scales = np.full(len(rig), np.nan)
    for v, camera in enumerate(rig.cameras):
        points = contours.of(v).points
        if len(points):
            scales[v] = camera.matrix[0, 0] / np.median(camera.in_camera(points.astype(np.float64))[:, 2])
    return scales


def _matched(
    rig: Rig,
    bodies: Bodies,
    q: Array,
    contours: Contours,
    seen: tuple[Observation, bool],
    gate: tuple[float, float, Array],
) -> Rows:
    observation, inner = seen
    gate_m, direction_deg, scale = gate
    pairs = _pairs(contours, observation, gate_m * float(np.nanmean(scale)), direction_deg)
    views, samples, scene = pairs[:, 0], pairs[:, 1], pairs[:, 2]
    edges: Array32 = observation.packed.points
    sample = contours.positions[0][views, samples].astype(np.float64)
    points, parts = contours.points[0][views, samples].astype(np.float64), contours.parts[0][views, samples]
    across = across_normals(rig, points, views, sample[:, 2:4])
    gap = ((sample[:, :2] - edges[scene, :2]) * sample[:, 2:4]).sum(axis=1)
    return Rows(
        residuals=gap / scale[views],
        asks=asks_of(bodies[0], q, points, parts, across / scale[views, None]),
        lengths_m=np.where(pairs[:, 3] == 0, sample[:, 4], edges[scene, 4]) / scale[views],
        parts=parts,
        views=views,
        inner=np.full(len(pairs), inner),
        weights=np.ones(len(pairs)),
        patches=patches_of(bodies[0], q, points, parts),
    )


_PATCH_M, _MOST_PATCHES = 0.1, 32
"""Side of a patch of surface, metres, see `FitSettings.correlation_m`; patches along a part, and around it, at most."""


def patches_of(body: BodyModel, q: Array, points: Array, parts: Integers) -> Integers:
    """(N,) the stretch of a part's surface that points lie on, numbered over all parts: what is there stays there.

    Args:
        body: the body.
        q: (dof,) pose.
        points: (N, 3) in the world, metres.
        parts: (N,) their parts.
    """
    placed = body.world_from_part(q)[parts]
    local = np.einsum("nij,ni->nj", placed[:, :3, :3], points - placed[:, :3, 3])
    across, deep, long = body.shapes[parts, :3].T
    along = _numbered(local[:, 2] / (2 * long) + 0.5, 2 * long)
    turned = np.arctan2(local[:, 1] / deep, local[:, 0] / across) / (2 * np.pi) + 0.5
    around = _numbered(turned, 2 * np.pi * np.sqrt(across * deep))
    found: Integers = (parts * _MOST_PATCHES + along) * _MOST_PATCHES + around
    return found


def _numbered(shares: Array, lengths_m: Array) -> Integers:
    """(N,) which of the stretches of some lengths places are in, that are given as shares of the length."""
    n_stretches = np.clip(np.rint(lengths_m / _PATCH_M), 1, _MOST_PATCHES)
    found: Integers = np.clip(np.floor(shares * n_stretches), 0, n_stretches - 1).astype(np.int64)
    return found


def _pairs(contours: Contours, observation: Observation, gate_px: float, direction_deg: float) -> Integers:
    """(N, 4) see `match_oriented`."""
    scene, first = observation.packed.points, observation.packed.first
    pairs = np.empty((int(contours.counts[0].sum()) + len(scene), 4), dtype=np.int64)
    gate = (gate_px, float(np.cos(np.radians(direction_deg))))
    return pairs[: match_oriented(contours.positions[0], contours.counts[0], scene, first, gate, pairs)]


def across_normals(rig: Rig, points: Array, views: Integers, normals: Array) -> Array:
    """(N, 3) derivative of a pixel along its normal by the world point, px per metre.

    Args:
        rig: the cameras.
        points: (N, 3) in the world, metres.
        views: (N,) the view of each.
        normals: (N, 2) in its image.
    """
    across = np.zeros_like(points)
    for v, camera in enumerate(rig.cameras):
        rows = views == v
        across[rows] = np.einsum("ni,nij->nj", normals[rows], camera.project_jacobian(points[rows]))
    return across


def asks_of(body: BodyModel, q: Array, points: Array, parts: Integers, directions: Array) -> Array:
    """(N, 25) what surface points that are to move in given directions ask of their parts.

    A point of an occluding contour keeps its latitude and longitude: that the contour slides along the surface moves
    its image along the contour only. It moves by the placement of its part on its segment (12 numbers), by the shape of
    its part (7) and by the motion of the segment (6: a force and its moment). Sums over the points of a part are of 25
    by 25 numbers then, whatever the number of unknowns; with a row of all unknowns a point they took half of a fit.

    Args:
        body: the body.
        q: (dof,) pose.
        points: (N, 3) in the world, metres.
        parts: (N,) their parts.
        directions: (N, 3) of any length.
    """
    placed = body.world_from_part(q)[parts]
    rotations = placed[:, :3, :3]
    local = np.einsum("ni,nij->nj", points - placed[:, :3, 3], rotations)
    with_one = np.concatenate([local, np.ones((len(local), 1))], axis=1)
    asks = np.empty((len(points), _N_ASKED))
    asks[:, _PLACED] = (directions[:, :, None] * with_one[:, None, :]).reshape(len(local), 12)
    formed = shape_derivatives(body.shapes[parts].T, local)
    asks[:, _FORMED] = np.einsum("ni,nij,njk->nk", directions, rotations, formed, optimize=True)
    asks[:, _CARRIED] = np.concatenate([directions, np.cross(points, directions)], axis=1)
    return asks


def part_slopes(bodies: Bodies, q: Array) -> Array:
    """(P, 25, S + dof) derivatives, by shape and pose, of what `asks_of` asks of each part.

    Shapes and placements are differentiated by steps, motions exactly, by twists.

    Args:
        bodies: the body and its neighbours.
        q: (dof,) pose.
    """
    body, neighbours, steps = bodies
    n_parts, n_shape = len(body.parts), len(steps)
    slopes = np.zeros((n_parts, _N_ASKED, n_shape + body.dof))
    moved = np.moveaxis(neighbours.placements(q)[0] - body.world_from_part(q), 0, -1) / steps
    slopes[:, _PLACED, :n_shape] = moved[:, :3].reshape(n_parts, 12, n_shape)
    slopes[:, _FORMED, :n_shape] = np.moveaxis(neighbours.shapes - body.shapes, 0, -1) / steps
    slopes[:, _CARRIED, n_shape:] = body.twists(q).T * body.moves[:, body.part_parameters].T[:, None, :]
    return slopes


@dataclass(frozen=True)
class Direct:
    """Residuals of the whole body: few, so with all their derivatives."""

    residuals: Array
    """(N,) m."""

    jacobian: Array
    """(N, S + dof)"""


def height_row(bodies: Bodies, stature_m: float, weight: float) -> Direct:
    """The row that holds the body's height in the reference pose.

    Args:
        bodies: the body and its neighbours.
        stature_m: the person's height, metres.
        weight: factor of the residual.
    """
    body, neighbours, steps = bodies
    low, high = levels(body.shapes, body.model_from_parts)
    # The parts that reach highest and lowest are enough.
    shown = [int(np.argmax(high)), int(np.argmin(low))]
    tall = heights(body.shapes[shown], body.model_from_parts[shown])
    moved = heights(neighbours.shapes[:, shown], neighbours.model_from_parts[:, shown])
    by_shape = (moved - tall) / steps
    return Direct(weight * np.array([float(tall) - stature_m]), weight * np.append(by_shape, np.zeros(body.dof))[None])


def mark_rows(look: Look, bodies: Bodies, q: Array, weight_m_per_px: float) -> Direct:
    """Rows of the clicked joints: two each, along the axes of the image.

    Args:
        look: the picture with its marks.
        bodies: the body and its neighbours.
        q: (dof,) pose.
        weight_m_per_px: what a pixel counts, metres.
    """
    body, neighbours, steps = bodies
    placed = body.landmarks_in_world(q)
    moved = np.moveaxis(neighbours.placements(q)[1] - placed, 0, -1) / steps
    ends = np.array([mark.parameter for mark in body.landmarks], dtype=np.int64)
    turned = body.point_jacobian(q, placed, ends)
    residuals, jacobian = [np.zeros(0)], [np.zeros((0, len(steps) + body.dof))]
    for mark in look.marks:
        camera = look.rig.cameras[mark.view]
        slope = camera.project_jacobian(placed[mark.landmark])
        residuals.append(weight_m_per_px * (camera.project(placed[mark.landmark]) - mark.pixel))
        columns = np.concatenate([moved[mark.landmark], turned[mark.landmark]], axis=1)
        jacobian.append(weight_m_per_px * slope @ columns)
    return Direct(np.concatenate(residuals), np.concatenate(jacobian))


# Misfit that stays on the body: what clothes and muscles differ from a model by, every look and view shows again.
#
# However many looks show a patch of surface, they tell of its misfit no better than it lasts. Each patch has a
# departure of its own, an unknown that drops out of the equations (a random effect: Laird & Ware, Biometrics 38, 1982).
# Taken for independent, thousands of contour points of twelve looks drowned all that is known of persons: headings were
# told to 0.4 degrees, and were 5 off.


@dataclass
class Lasting:
    """The equations of looks, summed up, and what they have in common on each patch."""

    n: int
    """Unknowns: shape, and poses of all looks."""

    share: float
    """Of the variance of a residual: what stays on the body; 0 for residuals that are all independent."""

    _found: list[tuple[Integers, Integers, Array, Array]] = field(default_factory=list)
    """Of each look its patches (M,), unknowns (U,), sums of weights and of weighted residuals (M, 2), slopes (M, U)."""

    def add(self, rows: Rows, slopes: Array, unknowns: Integers) -> None:
        """Adds a look's rows.

        Args:
            rows: its residuals.
            slopes: (P, 25, U) see `part_slopes`.
            unknowns: (U,) where its unknowns are among all.
        """
        if not self.share or not len(rows.residuals):
            return
        order = np.argsort(rows.patches, kind="stable")
        patches, first = np.unique(rows.patches[order], return_index=True)
        weights = rows.weights[order]
        sums = np.add.reduceat(np.column_stack([weights, weights * rows.residuals[order]]), first)
        asks = np.add.reduceat(weights[:, None] * rows.asks[order], first)
        parts = rows.parts[order][first]
        found = np.empty((len(patches), len(unknowns)))
        for p in np.unique(parts):
            found[parts == p] = asks[parts == p] @ slopes[p]
        self._found.append((patches, unknowns, sums, found))

    def taken_from(self, matrix: Array, vector: Array) -> tuple[Array, Array]:
        """J^T W J (n, n) and J^T W r (n,) of independent residuals without what is known of the patches' departures."""
        if not self._found:
            return matrix, vector
        patches = np.unique(np.concatenate([one[0] for one in self._found]))
        sums, slopes = np.zeros((len(patches), 2)), np.zeros((len(patches), self.n))
        for own, unknowns, some, found in self._found:
            places = np.searchsorted(patches, own)
            sums[places] += some
            slopes[np.ix_(places, unknowns)] += found
        # of a residual's variance 1 - share is its own: weights grow by that, and a departure's is `share`
        grown = 1 / (1 - self.share)
        gain = grown / np.sqrt(grown * sums[:, 0] + 1 / self.share)
        slopes *= gain[:, None]
        return grown * matrix - slopes.T @ slopes, grown * vector - slopes.T @ (gain * sums[:, 1])
