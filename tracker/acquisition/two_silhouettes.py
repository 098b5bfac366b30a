"""Two orthogonal silhouettes -> a person's body model (Gavrila & Davis 1996, section 3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pydantic

from tracker.acquisition.fit_task import FitSettings, Task
from tracker.acquisition.fitting import Fit, fit
from tracker.acquisition.looks import Look, Mark
from tracker.acquisition.part_search import searched_parts
from tracker.acquisition.pictures import Pair, Silhouette, read_silhouette
from tracker.acquisition.shape_space import ShapePrior, ShapeSpace, space_of
from tracker.acquisition.standing import best_pose, placed, scene_of
from tracker.arrays import Array
from tracker.body import BodyModel
from tracker.body_description import BodyDescription
from tracker.components import component
from tracker.errors import ModelError, SequenceError, nearest
from tracker.observation import Observation
from tracker.outlines import outline_observation, overlap
from tracker.progress import Progress, silent
from tracker.rig import Rig
from tracker.synthesis import Synthesis
from tracker.synthesis.cpu import CpuSynthesis

# A start whose turn is not 90 degrees must be nearer by this factor.
_CLEARLY = 1.15


@component
class SilhouetteSettings:
    """How a model is acquired from front and side silhouettes."""

    prior: ShapePrior = ShapePrior()
    """How much persons differ."""

    fit: FitSettings = FitSettings(iterations=15, pose_m=0.5, pose_deg=6.0)
    """The refinement."""

    coarse_deg: dict[str, tuple[float, ...]] = pydantic.Field(
        default={"arm_abduction": (5.0, 20.0, 40.0, 60.0, 85.0), "leg_abduction": (0.0, 5.0, 12.0)}
    )
    """Angles tried at the start, of both sides alike; parameters that the model lacks are left out, degrees."""

    stance_deg: float = pydantic.Field(default=3.0, gt=0)
    """Standard deviation of the difference between left and right joint angles: T- and A-poses are symmetric."""

    turn_deg: float = pydantic.Field(default=12.0, gt=0)
    """Standard deviation of the turn in each view, degrees."""

    lean_deg: float = pydantic.Field(default=4.0, gt=0)
    """Standard deviation of the torso's tilt, degrees."""

    most_off_deg: float = pydantic.Field(default=12.0, gt=0)
    """Largest departure of the turn between the views from 90 degrees that is accepted; smaller ones are measured."""

    least_overlap: float = pydantic.Field(default=0.7, gt=0, lt=1)
    """Least intersection over union of the result: below it this was no such person or no such pose."""


@dataclass(frozen=True)
class Acquired:
    """What an acquisition has found."""

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
        progress: told how far it is.

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
        _check_sizes(front, side)
    stature = stature_m or _measured_stature(silhouettes[0][0])
    if description.stature_m <= 0:
        raise ModelError(f'model "{description.name}" does not tell its stature_m: it cannot be scaled')
    space = space_of(description.scaled(stature / description.stature_m), settings.prior)
    task, poses = _started(space, silhouettes, settings, synthesis)
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


def _check_sizes(front: Silhouette, side: Silhouette) -> None:
    """Refuses a pair whose pictures cannot show front and side of one person."""
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


def _measured_stature(front: Silhouette) -> float:
    if not front.orthographic:
        raise SequenceError("a perspective picture does not tell the person's size: give stature_m")
    return float(front.box[3] * 1000 / front.camera.matrix[1, 1])


def _started(
    space: ShapeSpace,
    silhouettes: Sequence[tuple[Silhouette, ...]],
    settings: SilhouetteSettings,
    synthesis: Synthesis,
) -> tuple[Task, Array]:
    """Looks and start poses; a pair shares its joint angles, each picture has a root of its own."""
    body = space.body(np.zeros(len(space.names)))
    root, looks, poses, links = body.root, [], [], []
    trial = {
        tuple(body.columns(name)): np.radians(values)
        for name, values in settings.coarse_deg.items()
        if body.mirror.meant(name, body.names)
    }
    first = 0
    for front, side in silhouettes:
        seen = [outline_observation((one.mask,)) for one in (front, side)]
        q = placed(body, body.rest(), front, 0.0, synthesis)
        q, _ = best_pose(body, q, (front, seen[0]), trial, synthesis)
        turned = _faced(body, q, (side, seen[1]), synthesis)
        whole = first + np.arange(body.dof, dtype=np.int64)
        other = whole.copy()
        other[root.columns] = first + body.dof + np.arange(len(root.columns))
        for one, observation, places in ((front, seen[0], whole), (side, seen[1], other)):
            looks.append(Look(Rig((one.camera,)), places, observation, None, _marks(body, one)))
        poses += [q, turned[root.columns]]
        links += [(first + a, first + b) for a, b in mirrored_parameters(body, space.description)]
        first += body.dof + len(root.columns)
    start = np.concatenate(poses)
    task = Task(space, tuple(looks), synthesis, settings.fit)
    return replace(
        task,
        pose_sigmas=_sigmas(body, tuple(looks), settings, len(start)),
        links=tuple((a, b, float(np.radians(settings.stance_deg))) for a, b in links),
    ), start


def _faced(body: BodyModel, q: Array, seen: tuple[Silhouette, Observation], synthesis: Synthesis) -> Array:
    """The pose in the side view: turned aside either way, by other than 90 degrees where that fits clearly better."""
    tried = []
    for off_deg in (0, -20, 20, -40, 40):
        for side in (1, -1):
            pose = placed(body, q, seen[0], side * np.radians(90 + off_deg), synthesis)
            found, distance = best_pose(body, pose, seen, {}, synthesis)
            tried.append((found, distance * (1 if off_deg == 0 else _CLEARLY)))
    return min(tried, key=lambda found: found[1])[0]


def _sigmas(body: BodyModel, looks: tuple[Look, ...], settings: SilhouetteSettings, n: int) -> Array:
    """(n,) standard deviations of the poses around their start; the body stands upright."""
    root, sigmas = body.root, np.zeros(n)
    own = np.where(body.rotates, np.radians(settings.fit.pose_deg), settings.fit.pose_m)
    tilts = [k for k in root.columns if body.rotates[k] and k != root.turn]
    own[tilts], own[root.turn] = np.radians(settings.lean_deg), np.radians(settings.turn_deg)
    for look in looks:
        sigmas[look.columns] = own
    return sigmas


def mirrored_parameters(body: BodyModel, description: BodyDescription) -> list[tuple[int, int]]:
    """Columns of the pose parameters that mirror each other."""
    pairs = []
    for k, name in enumerate(body.names):
        mate = description.mirrored(name)
        if mate != name and mate in body.names and k < body.index(mate):
            pairs.append((k, body.index(mate)))
    return pairs


def _marks(body: BodyModel, silhouette: Silhouette) -> tuple[Mark, ...]:
    marks = []
    for name, pixel in silhouette.clicks.items():
        if name not in body.landmark_names:
            raise ModelError(f'{silhouette.name}: clicks: no landmark "{name}"; {nearest(name, body.landmark_names)}')
        marks.append(Mark(body.landmark_names.index(name), 0, pixel))
    return tuple(marks)


def _overlaps(found: Fit, silhouettes: Sequence[Silhouette], synthesis: Synthesis) -> tuple[float, ...]:
    return tuple(
        overlap(synthesis.silhouettes(scene_of(found.body, found.pose(k), one))[0], one.mask)
        for k, one in enumerate(silhouettes)
    )


def _turn_deg(body: BodyModel, found: Fit, pair: int) -> float:
    """Turn of the person between the two views, seen from the cameras, degrees."""
    angles = []
    for k in (2 * pair, 2 * pair + 1):
        axis = found.looks[k].rig.cameras[0].camera_from_world[2, :3]
        angles.append(found.pose(k)[body.root.turn] - np.arctan2(axis[1], axis[0]))
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
