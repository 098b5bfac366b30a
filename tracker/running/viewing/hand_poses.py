"""Poses made by hand: where they begin, what dragging a joint does, and the file that a run begins from."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import reaching
from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.errors import ModelError
from tracker.foundation.files import csv_lines, write_whole
from tracker.results.recording.csv_table import in_table_units, parameter_columns

_DECIMALS = 5
"""Of a start's angles and places, as in poses.csv."""

_MOVED_M = 0.01
"""A joint that a limb's parameters move by less a radian can't be dragged: a hip stays where the pelvis has it."""


def standing(scene: Scene) -> Scene:
    """All persons at rest on the floor, z = 0, in the middle of what the cameras look at, side by side.

    Bodies that cannot be moved as a whole stay.
    """
    middle, poses = _looked_at(scene.rig), []
    for k, person in enumerate(scene.persons):
        q, shifts = person.body.rest(), _shifts(person.body)
        if len(shifts):
            marks = person.body.landmarks_in_world(q)
            beside = middle + np.array([k - (len(scene.persons) - 1) / 2, 0.0, 0.0])
            place = np.append((marks.min(axis=0) + marks.max(axis=0))[:2] / 2, marks[:, 2].min())
            q[shifts] += beside - place
        poses.append(person.body.clamped(q))
    return scene.with_poses(tuple(poses))


def _looked_at(rig: Rig) -> Array:
    """(3,) the point on the floor below the one that is nearest to all optical axes, metres."""
    centres = np.array([camera.centre for camera in rig.cameras])
    axes = np.array([camera.camera_from_world[2, :3] for camera in rig.cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    # cameras that look the same way meet nowhere: a little of their own middle keeps the point near them
    normal = across.sum(axis=0) + 1e-3 * np.eye(3)
    point = np.linalg.solve(normal, (across @ centres[..., None]).sum(axis=0)[:, 0] + 1e-3 * centres.mean(axis=0))
    return np.array([point[0], point[1], 0.0])


def handles(body: BodyModel) -> tuple[int, ...]:
    """Numbers of the landmarks that can be dragged: joints of limbs, and one that carries the whole body."""
    q, limbs = body.rest(), [(body.group(limb), body.landmarks_of(limb)) for limb in body.limbs]
    points, ends = body.landmarks_in_world(q), np.array([mark.parameter for mark in body.landmarks], dtype=np.int64)
    moved = np.linalg.norm(body.point_jacobian(q, points, ends), axis=1)
    of_limbs = [int(m) for columns, own in limbs for m in np.flatnonzero(own & (moved[:, columns] > _MOVED_M).any(1))]
    others = np.flatnonzero(~np.any([own for _, own in limbs], axis=0)) if limbs else np.arange(len(points))
    if not len(_shifts(body)) or not len(others):
        return tuple(of_limbs)
    root = body.world_from_parameters(q)[body.root.columns[-1], :3, 3]
    return int(others[np.linalg.norm(points[others] - root, axis=1).argmin()]), *of_limbs


def dragged(body: BodyModel, q: Array, mark: int, place: Array) -> Array:
    """The pose (dof,) after a landmark was drawn to a place (3,): its limb follows, or the whole body.

    Args:
        body: the model.
        q: (dof,) rad and m.
        mark: number of the landmark, one of `handles`.
        place: (3,) metres.
    """
    for limb in body.limbs:
        if body.landmarks_of(limb)[mark]:
            return reaching(body, q.copy(), body.group(limb), np.array([mark]), place[None])
    pose = q.copy()
    pose[_shifts(body)] += place - body.landmarks_in_world(q)[mark]
    return body.clamped(pose)


def write_start(path: Path, number: int, scene: Scene) -> None:
    """Writes the poses of all persons as a start of a frame, as `initialization = { use = "given" }` reads it.

    Args:
        path: CSV.
        number: of the frame.
        scene: the persons at their poses.
    """
    columns, rows = parameter_columns(scene.persons), []
    for person in scene.persons:
        own = (parameter.column for parameter in person.body.parameters)
        told = dict(zip(own, in_table_units(person, person.q), strict=True))
        rows.append([number, person.name, *(f"{told[c]:.{_DECIMALS}f}" if c in told else "" for c in columns)])
    write_whole(path, csv_lines([("frame", "person", *columns), *rows]))


def _shifts(body: BodyModel) -> Integers:
    """Columns that move the whole body along x, y and z; none of one that is fixed to its place."""
    none: Integers = np.zeros(0, dtype=np.int64)
    try:
        return none if body.stays else body.root.shifts
    except ModelError:
        return none
