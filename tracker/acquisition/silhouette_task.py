"""The fit to pairs of silhouettes: settings, looks, and first poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np
import pydantic

from tracker.acquisition.clouds import Look, Mark
from tracker.acquisition.fitting import FitSettings, Task
from tracker.acquisition.pictures import Silhouette, best_pose, placed
from tracker.acquisition.shape_space import ShapePrior, ShapeSpace
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription
from tracker.cameras.rig import Rig
from tracker.evidence.measures.outlines import outline_observation
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ModelError, nearest
from tracker.images.sight import Observation
from tracker.synthesis import Synthesis

# A start whose turn is not 90 degrees must be nearer by this factor.
_CLEARLY = 1.15

Angles = Annotated[tuple[float, ...], pydantic.Field(min_length=1)]
"""Degrees."""


@component
class SilhouetteSettings:
    """Settings of an acquisition from front and side silhouettes."""

    prior: ShapePrior = ShapePrior()
    """Differences between persons."""

    fit: FitSettings = FitSettings(iterations=15, pose_m=0.5, pose_deg=6.0)
    """The refinement."""

    coarse_deg: dict[str, Angles] = pydantic.Field(
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


def started(
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
