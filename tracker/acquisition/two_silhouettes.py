"""Two orthogonal silhouettes -> a person's body model (Gavrila & Davis 1996, section 3)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from tracker.acquisition.fitting import Fit, FitSettings, fit
from tracker.acquisition.pictures import Pair, Silhouette, read_silhouette, scene_of
from tracker.acquisition.shape_space import ShapeSpace, space_of
from tracker.acquisition.silhouette_task import SilhouetteSettings, started
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription
from tracker.bodies.contours import Contours
from tracker.cameras.camera import Camera
from tracker.evidence.measures.outlines import on_outline, overlap
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.errors import ModelError, SequenceError
from tracker.foundation.geometry.superquadrics import surface
from tracker.foundation.progress import Progress, silent
from tracker.kernels.contours import match_oriented
from tracker.synthesis import Synthesis
from tracker.synthesis.cpu import CpuSynthesis

# How far an image contour may be from the part's present one, metres, and their directions from each other.
_GATE_M = 0.05
_COSINE = 0.8

# Fewer points than these do not show a part.
_LEAST_POINTS = 12

# Distance at which a point of a contour is an outlier, metres.
_CLAMP_M = 0.03

# Coarse to fine, in units of the parameters: the last steps are a few per cent, less than edges of a pixel show.
_STEPS = {"radius": (0.12, 0.06, 0.03), "taper": (0.16, 0.08, 0.04), "squareness": (0.2, 0.1, 0.05)}
# 1 cm apart on a limb of 0.4 m.
_N_RINGS = 41


def searched_parts(
    found: Fit, silhouettes: Sequence[Silhouette], synthesis: Synthesis, progress: Progress = silent
) -> Array:
    """The shape (S,) with radii, taper and squareness of each part searched on the contours that belong to it.

    Args:
        found: a fit whose poses and lengths are about right.
        silhouettes: one a look.
        synthesis: makes the model's contours.
        progress: gets the progress.
    """
    space, shape, body = found.space, np.array(found.shape), found.body
    seen = [_back_projected(found, k, one, synthesis) for k, one in enumerate(silhouettes)]
    parts = list(dict.fromkeys(parameter.part for parameter in space.parameters if parameter.part))
    for n, name in enumerate(parts):
        progress("searching the shape of each part", n, len(parts))
        for lateral, points in _sections(space, body, name, seen):
            _search(space, shape, name, (lateral, points))
    progress("searching the shape of each part", len(parts), len(parts))
    return shape


BackProjected = tuple[Integers, Array, Array]
"""Part (N,), contour point (N, 3) and viewing direction (N, 3), the latter in the part's frame."""


def _back_projected(found: Fit, look: int, silhouette: Silhouette, synthesis: Synthesis) -> BackProjected:
    """3-D occluding contours: image contours back-projected to the depth of the model's contours beside them."""
    body, q, camera = found.body, found.pose(look), silhouette.camera
    scene = scene_of(body, q, silhouette)
    contours = synthesis.contours(scene)
    positions = contours.positions[0].copy()
    positions[~on_outline(contours, scene, synthesis), 4] = 0.0
    observation = found.looks[look].outlines
    assert observation is not None
    edges, first = observation.packed.points, observation.packed.first
    pairs = np.empty((int(contours.counts[0].sum()) + len(edges), 4), dtype=np.int64)
    gate = (_GATE_M * _scale(camera, contours), _COSINE)
    pairs = pairs[: match_oriented(positions, contours.counts[0], edges, first, gate, pairs)]
    pairs = pairs[pairs[:, 3] == 1]
    points, parts = contours.points[0, 0, pairs[:, 1]].astype(np.float64), contours.parts[0, 0, pairs[:, 1]]
    rays = camera.rays(edges[pairs[:, 2], :2].astype(np.float64))
    depth = ((points - camera.centre) ** 2).sum(axis=1) / np.maximum(
        ((points - camera.centre) * rays).sum(axis=1), 1e-9
    )
    world = camera.centre + depth[:, None] * rays
    placed = body.world_from_part(q)[parts]
    local = np.einsum("nji,nj->ni", placed[:, :3, :3], world - placed[:, :3, 3])
    return parts, local, np.einsum("nji,nj->ni", placed[:, :3, :3], rays)


def _scale(camera: Camera, contours: Contours) -> float:
    """Pixels of a metre where the contours are."""
    points = contours.of(0).points.astype(np.float64)
    return float(camera.matrix[0, 0] / np.median(camera.in_camera(points)[:, 2]))


def _sections(
    space: ShapeSpace, body: BodyModel, name: str, seen: Sequence[BackProjected]
) -> Iterator[tuple[int, Array]]:
    """For each radius of a part (0 front, 1 side) the points (N, 2) lateral and along that show it."""
    names = [part.name for part in body.parts]
    mates = {names.index(name)}
    if space.prior.symmetric and space.description.mirrored(name) in names:
        mates.add(names.index(space.description.mirrored(name)))
    for lateral in (0, 1):
        rows = []
        for parts, points, rays in seen:
            # The side radius shows where the view is along the front axis, and the other way round.
            shows = np.isin(parts, list(mates)) & (np.abs(rays[:, 1 - lateral]) > 0.8)
            rows.append(points[shows][:, [lateral, 2]])
        found = np.concatenate(rows)
        if len(found) >= _LEAST_POINTS:
            yield lateral, found


def _search(space: ShapeSpace, shape: Array, name: str, section: tuple[int, Array]) -> None:
    """Coarse-to-fine grid over radius, taper and squareness; changes the shape in place."""
    lateral, points = section
    side = ("front", "side")[lateral]
    columns = [space.names.index(f"{name}.{what}") for what in (f"radius_{side}", f"taper_{side}", "squareness_along")]
    part = [part.name for part in space.description.parts].index(name)
    for steps in zip(*_STEPS.values(), strict=True):
        moves = np.array(list(product((-2, -1, 0, 1, 2), repeat=3))) * steps
        tried = np.clip(shape[columns] + moves, space.limits[columns, 0], space.limits[columns, 1])
        base = space.body(shape).shapes[part]
        shapes = np.repeat(base[None], len(tried), axis=0)
        gaps = tried - shape[columns]
        shapes[:, lateral] *= np.exp(gaps[:, 0])
        shapes[:, 5 + lateral] += gaps[:, 1]
        shapes[:, 3] += gaps[:, 2]
        cost = section_distances(shapes, lateral, points) + _prior_cost(tried, space.sigmas[columns])
        shape[columns] = tried[int(np.argmin(cost))]


def _prior_cost(tried: Array, sigmas: Array) -> Array:
    """Cost (B,) of departing from the general shape: two millimetres at three standard deviations."""
    cost: Array = 0.002 / 9 * ((tried / sigmas) ** 2).sum(axis=1)
    return cost


def section_distances(shapes: Array, lateral: int, points: Array) -> Array:
    """Chamfer distances (B,) between contours of shapes seen along their front or side axis and points, both ways, m.

    Args:
        shapes: (B, 7) packed superquadrics.
        lateral: 0 if the contour shows the front radius, 1 if it shows the side radius.
        points: (N, 2) lateral and along, metres, in the part's frame.
    """
    eta = np.linspace(-np.pi / 2, np.pi / 2, _N_RINGS)
    omega = np.array([0.0, np.pi]) if lateral == 0 else np.array([-np.pi / 2, np.pi / 2])
    rim, _ = surface(shapes.T[:, :, None, None], eta[:, None], omega)
    contour = rim[..., [lateral, 2]].reshape(len(shapes), -1, 2)
    gaps = np.linalg.norm(contour[:, :, None] - points[None, None], axis=-1)
    to_model = np.minimum(gaps.min(axis=1), _CLAMP_M).mean(axis=1)
    # The ends of a part are hidden in its neighbours: the model counts where the image shows something beside it.
    low, high = points[:, 1].min() - 0.01, points[:, 1].max() + 0.01
    counts = (contour[..., 1] >= low) & (contour[..., 1] <= high)
    nearest = np.where(counts, np.minimum(gaps.min(axis=2), _CLAMP_M), 0.0).sum(axis=1)
    distances: Array = to_model + nearest / np.maximum(counts.sum(axis=1), 1)
    return distances


_MOST_TALLER = 0.08
"""Largest difference of a silhouette from the given stature, as a share: hair and shoes count, and legs may be
apart."""


@dataclass(frozen=True)
class Acquired:
    """Outcome of an acquisition."""

    fit: Fit
    silhouettes: tuple[Silhouette, ...]
    """One a look: front and side of each pair in turn."""

    overlaps: tuple[float, ...]
    """Intersection over union in each look."""

    turns_deg: tuple[float, ...]
    """Measured turn between front and side of each pair, degrees."""

    start_overlaps: tuple[float, ...]
    """The same with the general model scaled by the stature, only posed."""


def acquire(
    description: BodyDescription,
    pairs: Sequence[Pair],
    stature_m: float | None,
    settings: SilhouetteSettings | None = None,
    progress: Progress = silent,
) -> Acquired:
    """Acquires a body from one or several pairs of silhouettes.

    Args:
        description: the general model.
        pairs: front and side of one posture each.
        stature_m: the person's height; None where every picture has a scale.
        settings: priors and limits.
        progress: gets the progress.

    Raises:
        SequenceError: a picture that cannot be used, with the reason.
        ModelError: a model that cannot be acquired.
    """
    settings, synthesis = settings or SilhouetteSettings(), CpuSynthesis()
    silhouettes = [
        tuple(
            read_silhouette(picture, name, stature_m) for picture, name in ((pair.front, "front"), (pair.side, "side"))
        )
        for pair in pairs
    ]
    for front, side in silhouettes:
        _check_sizes(front, side, stature_m)
    stature = stature_m or _measured_stature(silhouettes[0][0])
    if description.stature_m <= 0:
        raise ModelError(f'model "{description.name}" does not tell its stature_m: it cannot be scaled')
    space = space_of(description.scaled(stature / description.stature_m), settings.prior)
    task, poses = started(space, silhouettes, settings, synthesis)
    task = replace(task, progress=progress, stature_m=stature_m)
    flat = tuple(one for pair in silhouettes for one in pair)
    sized = fit(task, np.zeros(len(space.names)), poses, ("pose",))
    before = _overlaps(sized, flat, synthesis)
    sized = fit(task, sized.shape, sized.poses, ("pose", "size"))
    searched = searched_parts(sized, flat, synthesis, progress)
    found = fit(replace(task, settings=_narrow(settings.fit)), searched, sized.poses)
    turns = tuple(_turn_deg(space.body(found.shape), found, k) for k in range(len(pairs)))
    result = Acquired(found, flat, _overlaps(found, flat, synthesis), turns, before)
    _check_result(result, settings)
    return result


def _narrow(settings: FitSettings) -> FitSettings:
    """The refinement after a search: everything moves at once."""
    gate_m = max(0.5 * settings.gate_m, settings.final_gate_m)
    return replace(settings, gate_m=gate_m, rigid_share=0.0)


def _check_sizes(front: Silhouette, side: Silhouette, stature_m: float | None) -> None:
    """Refuses a pair whose pictures cannot show front and side of one person, or of one with the given stature."""
    widths = [one.box[2] / one.box[3] for one in (front, side)]
    if widths[1] > 1.15 * widths[0]:
        raise SequenceError(
            f"front and side are swapped: the side silhouette is {widths[1]:.2f} times as wide as high, the front "
            f"one {widths[0]:.2f}; expected the arms to spread in the front view"
        )
    if front.orthographic and side.orthographic:
        heights = [one.box[3] * 1000 / one.camera.matrix[1, 1] for one in (front, side)]
        if abs(heights[1] / heights[0] - 1) > 0.05:
            raise SequenceError(
                f"the person is {heights[0]:.2f} m high in the front view and {heights[1]:.2f} m in the side view: "
                "check px_per_m of both"
            )
    for one in (front, side):
        height_m = one.box[3] * 1000 / one.camera.matrix[1, 1] if one.orthographic else None
        if stature_m is not None and height_m is not None and abs(height_m / stature_m - 1) > _MOST_TALLER:
            raise SequenceError(
                f"the person is {height_m:.2f} m high in the {one.name} view by its px_per_m, and {stature_m:.2f} m by "
                "stature_m: check both"
            )


def _measured_stature(front: Silhouette) -> float:
    if not front.orthographic:
        raise SequenceError("a perspective picture does not show the person's size: give stature_m")
    return float(front.box[3] * 1000 / front.camera.matrix[1, 1])


def _overlaps(found: Fit, silhouettes: Sequence[Silhouette], synthesis: Synthesis) -> tuple[float, ...]:
    return tuple(
        overlap(synthesis.silhouettes(scene_of(found.body, found.pose(k), one))[0], one.mask)
        for k, one in enumerate(silhouettes)
    )


def _turn_deg(body: BodyModel, found: Fit, pair: int) -> float:
    """Turn of the person between the two views, seen from the cameras, degrees."""
    angles = []
    for k in (2 * pair, 2 * pair + 1):
        # the line of sight, not the camera's axis: the person may stand beside the middle of the picture
        sight = found.pose(k)[body.root.shifts] - found.looks[k].rig.cameras[0].centre
        angles.append(found.pose(k)[body.root.turn] - np.arctan2(sight[1], sight[0]))
    turn = float(np.degrees(angles[1] - angles[0]))
    return abs((turn + 180) % 360 - 180)


def _check_result(result: Acquired, settings: SilhouetteSettings) -> None:
    for k, turn in enumerate(result.turns_deg):
        if abs(turn - 90) > settings.most_off_deg:
            off = abs(turn - 90)
            # A silhouette hardly tells whether the person has turned too little or too far.
            raise SequenceError(
                f"the views are not orthogonal: between front and side the person is turned by {90 - off:.0f} or "
                f"{90 + off:.0f} degrees, expected 90 within {settings.most_off_deg:.0f}"
                + (f" (pair {k + 1})" if len(result.turns_deg) > 1 else "")
            )
    for one, share in zip(result.silhouettes, result.overlaps, strict=True):
        if share < settings.least_overlap:
            raise SequenceError(
                f"{one.name}: the fitted body covers {share:.0%} of the silhouette (intersection over union), expected "
                f"at least {settings.least_overlap:.0%}: two persons that touch, another posture than T or A, or a "
                "wrong stature_m?"
            )
