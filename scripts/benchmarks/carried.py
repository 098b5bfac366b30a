"""What scanned persons wear or carry that no model has: a skirt, a rucksack, a racket, a ball, a stick, a barbell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import trimesh

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array, Integers
from tracker.synthesis.simulation.rendering import Mesh
from tracker.synthesis.simulation.sequence import Simulation

# A skirt: corners around it, rows from the waist to the knees.
_AROUND, _ROWS = 48, 12


@dataclass(frozen=True)
class Thing:
    """A surface that parts of a body move."""

    points: Array
    """(N, 3) in the pose that the body's skin was measured in, metres."""

    normals: Array
    """(N, 3) unit."""

    triangles: Integers
    """(T, 3) vertex numbers."""

    weights: Array
    """(N, P) how much each part of the body moves a vertex; they add up to 1."""

    colour: tuple[int, int, int]
    """BGR."""


Carried = Callable[[BodyModel], Thing]
"""Makes a thing to the measure of a body that has a skin."""


@dataclass(frozen=True)
class Laden(Simulation):
    """A simulation whose first person wears or carries something."""

    carried: Carried | None = None

    def meshes(self) -> tuple[Mesh, ...]:
        """The first person's surface with the thing; see `tracker.synthesis.simulation.sequence.Simulation.meshes`."""
        first, *others = super().meshes()
        assert self.carried is not None
        return (_joined(first, self.carried(self.scene.persons[0].body)), *others)


def laden(simulation: Simulation, carried: Carried) -> Laden:
    """A simulation whose first person carries something."""
    return Laden(**{name: getattr(simulation, name) for name in simulation.__dataclass_fields__}, carried=carried)


def rucksack(body: BodyModel) -> Thing:
    """20 cm deep, 45 cm high, on the back."""
    shape = trimesh.creation.icosphere(3)
    return _held(body, "chest", shape.vertices * (0.10, 0.16, 0.23) + (-0.21, 0, 0.04), shape.faces, (40, 40, 150))


def ball(body: BodyModel) -> Thing:
    """22 cm wide, in the right hand's palm."""
    shape = trimesh.creation.icosphere(3)
    return _held(body, "right_hand", shape.vertices * 0.11 + (0, -0.14, 0.05), shape.faces, (30, 100, 220))


def racket(body: BodyModel) -> Thing:
    """70 cm long, in the right hand, where the forearm points."""
    handle, head = trimesh.creation.cylinder(0.015, 0.36, sections=12), trimesh.creation.cylinder(0.13, 0.02)
    # flat as the hand is, its edge in the direction of the fingers
    face = head.vertices[:, [0, 2, 1]] * (1, -1, 1) + (0, 0, 0.49)
    points = np.concatenate([handle.vertices + np.array([0, 0, 0.18]), face])
    faces = np.concatenate([handle.faces, head.faces + len(handle.vertices)])
    return _held(body, "right_hand", points, faces, (40, 170, 60))


def barbell(body: BodyModel) -> Thing:
    """A bar of 2.2 m behind the neck, with discs of 45 cm."""
    bar = trimesh.creation.cylinder(0.015, 2.2, sections=12)
    discs = [trimesh.creation.cylinder(0.225, 0.06) for _ in range(2)]
    for disc, side in zip(discs, (-1, 1), strict=True):
        disc.apply_translation((0, 0, 0.95 * side))
    points = np.concatenate([one.vertices for one in (bar, *discs)])
    starts = np.cumsum([0, len(bar.vertices), len(discs[0].vertices)])
    faces = np.concatenate([one.faces + start for one, start in zip((bar, *discs), starts, strict=True)])
    across = points[:, [0, 2, 1]] * (1, -1, 1) + (-0.13, 0, 0.22)
    return _held(body, "chest", across, faces, (60, 60, 60))


def stick(body: BodyModel) -> Thing:
    """A walking stick of 90 cm, in the right hand, where the forearm points."""
    shape = trimesh.creation.cylinder(0.014, 0.9, sections=12)
    return _held(body, "right_hand", shape.vertices + np.array([0, 0, 0.42]), shape.faces, (40, 70, 110))


def skirt(body: BodyModel) -> Thing:
    """From the waist to the knees, wider below; thighs take its cloth along on their side."""
    skin = body.skin
    assert skin is not None
    names = [part.name for part in body.parts]
    pelvis, left, right = (names.index(name) for name in ("pelvis", "left_thigh", "right_thigh"))
    at = np.linalg.inv(skin.part_from_rest)[:, :3, 3]
    top, low = at[pelvis, 2] + 0.08, 1.9 * at[left, 2] - 0.9 * at[pelvis, 2] - 0.04
    down, angle = np.meshgrid(np.linspace(0, 1, _ROWS), np.linspace(-np.pi, np.pi, _AROUND, endpoint=False))
    wide, deep = 0.19 + 0.11 * down, 0.15 + 0.10 * down
    folds = 1 + 0.06 * down * np.sin(9 * angle)
    places = np.stack([deep * np.cos(angle) * folds, wide * np.sin(angle) * folds, top + down * (low - top)], axis=-1)
    points = places.reshape(-1, 3) + np.array([at[pelvis, 0], at[pelvis, 1], 0])
    outward = np.stack([np.cos(angle), np.sin(angle), np.full_like(angle, 0.25)], axis=-1).reshape(-1, 3)
    weights = np.zeros((len(points), len(names)))
    taken, to_left = (0.75 * down).ravel(), (0.5 + 0.5 * np.sin(angle)).ravel()
    weights[:, pelvis], weights[:, left], weights[:, right] = 1 - taken, taken * to_left, taken * (1 - to_left)
    normals = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    return Thing(points, normals, _tube(), weights, (120, 60, 110))


def _tube() -> Integers:
    """Triangles between the rows of a skirt's corners, its first ones beside the last ones."""
    column, row = np.meshgrid(np.arange(_AROUND), np.arange(_ROWS - 1), indexing="ij")
    here, beside = column * _ROWS + row, (column + 1) % _AROUND * _ROWS + row
    halves = (here, here + 1, beside), (beside, here + 1, beside + 1)
    found: Integers = np.concatenate([np.stack(half, axis=-1).reshape(-1, 3) for half in halves])
    return found


def _held(body: BodyModel, name: str, own: Array, triangles: Integers, colour: tuple[int, int, int]) -> Thing:
    """A rigid thing whose vertices are at (N, 3) in the frame of the part that holds it."""
    assert body.skin is not None
    names = [part.name for part in body.parts]
    rest_from_part = np.linalg.inv(body.skin.part_from_rest[names.index(name)])
    points = own @ rest_from_part[:3, :3].T + rest_from_part[:3, 3]
    normals = trimesh.Trimesh(points, triangles, process=False).vertex_normals
    weights = np.tile(np.eye(len(names))[names.index(name)], (len(points), 1))
    return Thing(points, np.array(normals), np.array(triangles, dtype=np.int64), weights, colour)


def _joined(mesh: Mesh, thing: Thing) -> Mesh:
    """A person's surface and a thing as one."""
    n_bones = mesh.bones.shape[1]
    strongest = np.argsort(-thing.weights, axis=1, kind="stable")[:, :n_bones]
    weights = np.take_along_axis(thing.weights, strongest, axis=1)
    weave = 1 + 0.05 * np.sin(60 * thing.points[:, :1]) * np.sin(50 * thing.points[:, 2:])
    return replace(
        mesh,
        points=np.concatenate([mesh.points, thing.points]),
        normals=np.concatenate([mesh.normals, thing.normals]),
        colours=np.concatenate([mesh.colours, np.array(thing.colour) * weave]).astype(np.float32),
        triangles=np.concatenate([mesh.triangles, thing.triangles + len(mesh.points)]),
        bones=np.concatenate([mesh.bones, strongest]),
        weights=np.concatenate([mesh.weights, weights / weights.sum(axis=1, keepdims=True)]).astype(np.float32),
    )
