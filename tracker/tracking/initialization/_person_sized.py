"""Starts of bodies much smaller or larger than persons, in a world scaled to a person's size."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import SMALL_M
from tracker.bodies.scene import Scene
from tracker.bodies.segments import Landmark
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, frozen
from tracker.foundation.errors import ModelError
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._persons import size_of
from tracker.tracking.start import Start

# Voxels, bins and margins of a start are for persons: a toddler and a horse are still found with them, a hand or a bird
# has too few voxels, and a lorry is larger than the searched space. Metres, and cubic metres.
_MOST_M, _PERSON_M, _LEAST_M3 = 3.5, 1.8, 0.008
# Tracked from given poses, dogs of 0.096, 0.058 and 0.043 m were 0.2 % of their size off; one of 0.029 m was doubtful
# in all frames, one of 0.01 m lost: steps of the estimation are in metres.
_SMALLEST_M = 0.04


@runtime_checkable
class _Placed(Protocol):
    """A component with places of the world among its settings."""

    def in_world(self, factor: float) -> Any:
        """The component for a world enlarged by a factor."""
        ...


_Way = TypeVar("_Way")
_Begin = Callable[[_Way, Frame, Scene, Stages], Start]


def person_sized(begin: _Begin[_Way]) -> _Begin[_Way]:
    """A `start` of a component that only gets scenes of a person's size, and whose poses are scaled back."""

    @functools.wraps(begin)
    def start(self: _Way, frame: Frame, scene: Scene, stages: Stages) -> Start:
        factor = enlargement(scene)
        if factor == 1.0:
            return begin(self, frame, scene, stages)
        bodies = [person.body for person in scene.persons]
        own = self.in_world(factor) if isinstance(self, _Placed) else self
        return _brought_back(begin(own, frame, enlarged(scene, factor), stages), bodies, factor)

    return start


def enlargement(scene: Scene) -> float:
    """Factor that enlarges the world; 1 if the largest body is about as large as a person."""
    sizes = [size_of(person) for person in scene.persons]
    length_m, volume_m3 = max(size.length_m for size in sizes), max(size.volume_m3 for size in sizes)
    alike = length_m <= 0 or (SMALL_M <= length_m <= _MOST_M and volume_m3 >= _LEAST_M3)
    return 1.0 if alike else _PERSON_M / length_m


def check_size(scene: Scene) -> None:
    """Refuses bodies that are too small for tracking in metres.

    Raises:
        ModelError: the size of the body, and what to do.
    """
    for person in scene.persons:
        length_m = size_of(person).length_m
        if 0 < length_m < _SMALLEST_M:
            raise ModelError(
                f'model "{person.body.name}" of "{person.name}" is {length_m:.2g} m large, and bodies are tracked from '
                f"{_SMALLEST_M} m on: write model and calibration in a smaller unit, such as millimetres for metres"
            )


def enlarged(scene: Scene, factor: float) -> Scene:
    """The scene with every length multiplied by a factor: its pictures stay the same, without the skins."""
    persons = tuple(
        replace(
            person,
            body=_body(person.body, factor),
            q=_shifted(person.body, person.q, factor),
            at=None if person.at is None else (factor * person.at[0], factor * person.at[1]),
        )
        for person in scene.persons
    )
    return Scene(persons, Rig(tuple(_camera(camera, factor) for camera in scene.rig.cameras)))


def _camera(camera: Camera, factor: float) -> Camera:
    moved = np.array(camera.camera_from_world)
    moved[:3, 3] *= factor
    return replace(camera, camera_from_world=moved)


def _body(body: BodyModel, factor: float) -> BodyModel:
    def marks(landmarks: Sequence[Landmark]) -> tuple[Landmark, ...]:
        return tuple(replace(mark, point=frozen(factor * mark.point)) for mark in landmarks)

    parts = []
    for part in body.parts:
        placement = np.array(part.model_from_part)
        placement[:3, 3] *= factor
        shape = replace(part.shape, size=factor * part.shape.size)
        parts.append(replace(part, shape=shape, model_from_part=frozen(placement)))
    parameters = tuple(
        replace(
            one,
            point=frozen(factor * one.point),
            limits=one.limits if one.rotates else (factor * one.limits[0], factor * one.limits[1]),
        )
        for one in body.parameters
    )
    return replace(
        body,
        parameters=parameters,
        parts=tuple(parts),
        landmarks=marks(body.landmarks),
        segments=tuple(replace(segment, joint=frozen(factor * segment.joint)) for segment in body.segments),
        stature_m=factor * body.stature_m,
        keypoints=marks(body.keypoints),
        skin=None,
    )


def _shifted(body: BodyModel, q: Array, factor: float) -> Array:
    """A pose (dof,) whose translations are multiplied by a factor."""
    pose: Array = np.where(body.rotates, q, factor * q)
    return pose


def _brought_back(start: Start, bodies: list[BodyModel], factor: float) -> Start:
    def back(body: BodyModel, q: Array) -> Array:
        return body.clamped(_shifted(body, q, 1 / factor))

    return replace(
        start,
        poses=tuple(back(body, q) for body, q in zip(bodies, start.poses, strict=True)),
        hypotheses=tuple(
            tuple(replace(one, q=back(body, one.q)) for one in ranking)
            for body, ranking in zip(bodies, start.hypotheses, strict=False)
        ),
    )
