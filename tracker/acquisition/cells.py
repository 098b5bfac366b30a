"""Cells of space that no body explains: what stands out beside persons, and what moves with a segment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from tracker.acquisition._surface_points import outside
from tracker.acquisition.calibrated_views import Seen, Watching
from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.cameras.camera import Camera
from tracker.cameras.frame import seen_pixels
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.images.operations.masks import grown
from tracker.images.sight import Sight
from tracker.synthesis import Synthesis
from tracker.tracking.strangers import hide_strangers

CELL_M = 0.03
"""Edge of the cells, metres."""

_SAMPLING = 2
"""Every second pixel is looked at, along both axes."""

_OWN_M = 0.05
"""Changes this near to a person's silhouette are the person's: hair, wide clothes, and other things that a model
lacks."""

_AROUND_M = 1.5
"""Range of the cells around the middle of a person, metres."""

_MOST_SHARE = 0.5
"""Of a model's silhouette: what is more beside the persons is nothing carried. They are elsewhere, or the light has
changed."""

_LEAST_CELLS = 5
"""Fewer cells beside the persons, 0.14 l, are none of the things looked for."""


@dataclass(frozen=True)
class View:
    """A view that knows its background, every second pixel of it."""

    camera: Camera
    changed: Mask
    """(h, w) the foreground, a little enlarged, and what is not known."""

    apart: Mask
    """(h, w) the foreground that is not near a person."""

    px_per_m: float
    """Of these pixels, where the person is."""


@dataclass(frozen=True)
class Surroundings:
    """Data of a frame: the segments of a person, and the changes beside all persons."""

    world_from_reference: Array
    """(dof + 1, 4, 4) how far what hangs on each parameter has moved from the reference pose."""

    views: tuple[View, ...]
    beside: Array
    """(N, 3) middles of cells that two views show beside the persons and none as empty, metres."""

    standing: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(M, 3) those of furniture that is known, metres."""

    def without(self, points: Array) -> Surroundings:
        """The same with known furniture in the cells at points (N, 3)."""
        known = replace(self, standing=np.concatenate([self.standing, points]))
        return replace(known, beside=self.beside[~known.stands_at(self.beside)])

    def stands_at(self, points: Array) -> Mask:
        """(N,) which of points (N, 3) are in or beside cells of known furniture."""
        gaps = np.asarray(cKDTree(self.standing).query(points)[0])
        stands: Mask = gaps < 2 * CELL_M
        return stands

    @property
    def tells(self) -> bool:
        """Whether there is enough beside the persons."""
        return len(self.beside) >= _LEAST_CELLS


def sight_of(seen: Seen, watching: Watching) -> Sight:
    """The foreground of all views of a frame, without who is none of the persons.

    Args:
        seen: its images, and all persons at their poses.
        watching: the cameras, and what is known of their views.
    """
    sight = Sight(seen.frame, watching.plates)
    for v, camera in enumerate(watching.rig.cameras):
        sight.changes(v, (0, 0, *camera.size))
    hide_strangers(sight, seen.scene, watching.synthesis)
    return sight


def surroundings(sight: Sight, scene: Scene, person: int, synthesis: Synthesis) -> Surroundings:
    """Changes in a frame.

    Args:
        sight: see `sight_of`.
        scene: all persons at their poses.
        person: the one who is looked at.
        synthesis: draws them.
    """
    one = scene.persons[person]
    middle = one.body.landmarks_in_world(one.q).mean(axis=0)
    models = synthesis.silhouettes(scene)
    found = (_view(sight, v, model, scene.rig.cameras[v], middle) for v, model in enumerate(models))
    views = tuple(view for view in found if view is not None)
    return Surroundings(one.body.world_from_parameters(one.q), views, _beside(views, middle))


def _view(sight: Sight, v: int, model: Mask, camera: Camera, middle: Array) -> View | None:
    """What a view shows of a person whose middle is there; None where no background is known."""
    silhouette, unknown, hidden = sight.silhouette(v), sight.unknown(v), sight.occluder(v)
    if silhouette is None:
        return None
    px_per_m = float(camera.matrix[0, 0]) / max(float(camera.in_camera(middle[None])[0, 2]), 0.1) / _SAMPLING
    foreground = np.ascontiguousarray(silhouette[::_SAMPLING, ::_SAMPLING])
    own = grown(np.ascontiguousarray(model[::_SAMPLING, ::_SAMPLING]), _OWN_M * px_per_m)
    apart, changed = foreground & ~own, grown(foreground, CELL_M / 2 * px_per_m)
    if np.count_nonzero(apart) * _SAMPLING**2 > _MOST_SHARE * np.count_nonzero(model):
        apart = np.zeros_like(apart)
    for other in (unknown, hidden):
        if other is not None:
            changed |= other[::_SAMPLING, ::_SAMPLING]
    return View(camera, changed, apart, px_per_m)


def _beside(views: Sequence[View], middle: Array) -> Array:
    """The cells (N, 3) around a place that two views show beside the persons and none as empty."""
    # one of the two is not the view that shows most there
    fewest = sorted(views, key=lambda view: np.count_nonzero(view.apart))[:-1]
    along = [_along_rays(view, middle) for view in fewest]
    points = np.unique(np.round(np.concatenate([np.zeros((0, 3)), *along]) / CELL_M), axis=0) * CELL_M
    empty, n_apart = shown_in(views, points)
    found: Array = points[~empty & (n_apart >= 2)]
    return found


def _along_rays(view: View, middle: Array) -> Array:
    """Points (N, 3) around a place, behind what a view shows beside the persons."""
    y, x = np.nonzero(view.apart)
    spacing = max(1, round(CELL_M * view.px_per_m))
    kept = (x % spacing == 0) & (y % spacing == 0)
    rays = view.camera.rays(np.stack([x[kept], y[kept]], axis=-1).astype(np.float64) * _SAMPLING)
    far = np.linalg.norm(middle - view.camera.centre) + np.arange(-_AROUND_M, _AROUND_M, CELL_M)
    return (view.camera.centre + far[:, None, None] * rays).reshape(-1, 3)


def shown_in(views: Sequence[View], points: Array) -> tuple[Mask, Integers]:
    """Which of points a view shows as empty, or fewer than two see, and how many views show each beside the persons.

    Args:
        views: of one frame.
        points: (N, 3) in the world, metres.
    """
    empty = np.zeros(len(points), dtype=np.bool_)
    n_seen, n_apart = np.zeros((2, len(points)), dtype=np.int64)
    for view in views:
        at, seen = seen_pixels(view.camera, points, _SAMPLING)
        x, y = at[seen].T
        empty[seen] |= ~view.changed[y, x]
        n_apart[seen] += view.apart[y, x]
        n_seen += seen
    empty |= n_seen < 2
    return empty, n_apart


# What moves with a segment of a body over several frames, or stands, and no part of it explains: cells of space.

_REACH_M = 0.9
"""Reach of things from the landmarks of the segment that carries them, metres."""

_NEARLY = 0.8
"""Of the most cells that move with a segment."""

# See docs/lab/carried_things.md.
_MOST_EMPTY, _LEAST_APART = 0.25, 0.4
"""Share of the frames in which a cell may be background somewhere, and in which two views must show it beside the
persons, at least."""

_LEAST_MOVING = 4
"""That are so, 0.11 l. Of 46 recordings of persons who carry nothing none has one, those by two cameras included; of 12
with a rucksack, a racket or a ball the least was 5."""

_WHOLE_EMPTY, _WHOLE_BESIDE, _FURTHER_M = 0.35, 0.3, 0.3
"""The same shares for what belongs to a thing that has such cells, where one view need show it beside the persons, and
how far it reaches beyond them: of a rucksack what lies against the back."""


_LEAST_REACH_M = 0.13
"""How far from a body's surface things reach at the least, metres. A shoe reached 0.10 m beside the toes of a body
scaled to a wrong stature; a ball in a hand 0.16, sticks and rucksacks 0.21 to 0.34."""

_TOLD_M = 3**0.5 * CELL_M
"""A segment that moves by less may have a thing in the same cells all along: the diagonal of a cell."""

_KNEES = 0.33
"""Height above the lowest landmark at which nothing stands on the floor, of a person's; knees are at 0.29."""

_WORLD = -1
"""What hangs on no parameter stands."""


class How(Enum):
    """How cells came to be beside a body in most frames."""

    CARRIED = "carried"
    STANDS = "stands"
    """Where they are in the world explains at least as much as where they are on the segment: furniture."""

    DOUBT = "doubt"
    """The same, and the segment moves too little to tell."""

    OWN = "own"
    """So near to the body that it is the person's: shoes, hair, wide clothes."""


@dataclass(frozen=True)
class Moving:
    """Cells that move with what hangs on a parameter of a body, or stand in the world."""

    end: int
    """The parameter; -1 of what stands."""

    points: Array
    """(N, 3) where the cells are in the reference pose, metres."""

    shares: Array
    """(N,) of the frames in which two views show each beside the persons."""

    how: How = How.CARRIED

    def in_world(self, frame: Surroundings) -> Array:
        """(N, 3) where the cells are in a frame, metres."""
        return _placed(frame, self.end, self.points)

    @property
    def n_shown(self) -> float:
        """Cells that a frame shows on average."""
        return float(self.shares.sum())

    def gap_m(self, marks: Array) -> float:
        """From the middle of the cells to the nearest of points (N, 3), metres."""
        return float(np.linalg.norm(self.points.mean(axis=0) - marks, axis=1).min())


def most_moving(frames: Sequence[Surroundings], body: BodyModel) -> Moving | None:
    """The cells that move with one of the segments, of several the one with most, or stand there; None where none do.

    Who does not turn the head wears a rucksack on the neck as well: of segments with nearly as many cells it is the one
    nearest to them. A chair moves with who sits still on it: what the world explains as well
    as the segment does, stands.

    Args:
        frames: what is around one person, whose poses differ.
        body: the person's.
    """
    if not frames or sum(one.tells for one in frames) < _LEAST_APART * len(frames):
        return None
    ends = np.array([mark.parameter for mark in body.landmarks])
    marks = np.array([mark.point for mark in body.landmarks])
    found = [_moving(frames, int(end), marks[ends == end]) for end in np.unique(ends[ends >= 0])]
    found = [one for one in found if len(one.points) >= _LEAST_MOVING]
    if not found:
        return None
    most = max(one.n_shown for one in found)
    likely = [one for one in found if one.n_shown >= _NEARLY * most]
    core = min(likely, key=lambda one: one.gap_m(marks[ends == one.end]))
    places = np.array([core.in_world(one) for one in frames])
    standing = _standing(frames, places.reshape(-1, 3))
    moved_m = np.linalg.norm(places - places.mean(axis=0), axis=-1).mean(axis=1).max()
    if standing.n_shown >= core.n_shown and moved_m >= _TOLD_M:
        return replace(_whole(frames, standing), how=How.STANDS)
    thing = _whole(frames, core)
    if standing.n_shown >= core.n_shown and not _hangs(frames, thing, body):
        return replace(thing, how=How.DOUBT)
    return replace(thing, how=How.CARRIED if reach_m(thing, body) >= _LEAST_REACH_M else How.OWN)


def reach_m(thing: Moving, body: BodyModel) -> float:
    """How far the cells of a thing reach from the body's surface, in the reference pose, metres."""
    _, feet, _ = outside(body.model_from_parts, body.shapes, thing.points)
    return float(np.linalg.norm(feet - thing.points, axis=1).max())


def _hangs(frames: Sequence[Surroundings], thing: Moving, body: BodyModel) -> bool:
    """Whether a thing is above the knees in all frames: a rucksack is, and furniture reaches the floor."""
    ends = np.array([mark.parameter for mark in body.landmarks])
    marks = np.array([mark.point for mark in body.landmarks])
    floor = min(
        float(_placed(one, int(end), marks[ends == end])[:, 2].min()) for one in frames for end in np.unique(ends)
    )
    low = min(float(thing.in_world(one)[:, 2].min()) for one in frames)
    return low - floor > _KNEES * float(body.extents_m.max())


def _standing(frames: Sequence[Surroundings], places: Array) -> Moving:
    """The cells beside a person that stand in the world where cells on a segment come to, at places (N, 3)."""
    low, high = places.min(axis=0) - CELL_M, places.max(axis=0) + CELL_M
    points = np.unique(np.round(np.concatenate([one.beside for one in frames]) / CELL_M), axis=0) * CELL_M
    return _sure(frames, _WORLD, points[((points >= low) & (points <= high)).all(axis=1)])


def _moving(frames: Sequence[Surroundings], end: int, marks: Array) -> Moving:
    """The cells that move with what hangs on a parameter, near its landmarks (N, 3) in the reference pose."""
    return _sure(frames, end, _candidates(frames, end, marks))


def _sure(frames: Sequence[Surroundings], end: int, points: Array) -> Moving:
    """Those of points (N, 3) in the reference pose that are beside the persons in enough frames."""
    empty, _, apart = _shares(frames, end, points)
    sure = (empty <= _MOST_EMPTY) & (apart >= _LEAST_APART)
    return Moving(end, points[sure], apart[sure])


def _placed(frame: Surroundings, end: int, points: Array) -> Array:
    """Points (N, 3) of the reference pose in the world of a frame."""
    motion = frame.world_from_reference[end]
    placed: Array = points @ motion[:3, :3].T + motion[:3, 3]
    return placed


def _whole(frames: Sequence[Surroundings], core: Moving) -> Moving:
    """A thing with what of it is seldom beside the persons in two views: cells that hang together with the core."""
    low, high = core.points.min(axis=0) - _FURTHER_M, core.points.max(axis=0) + _FURTHER_M
    numbers = [np.arange(round(a / CELL_M), round(b / CELL_M) + 1) for a, b in zip(low, high, strict=True)]
    lattice = np.stack(np.meshgrid(*numbers, indexing="ij"), axis=-1)
    points = lattice.reshape(-1, 3) * CELL_M
    empty, beside, apart = _shares(frames, core.end, points)
    sure = (empty <= _MOST_EMPTY) & (apart >= _LEAST_APART)
    filled = sure | ((empty <= _WHOLE_EMPTY) & (beside >= _WHOLE_BESIDE))
    labels = ndimage.label(filled.reshape(lattice.shape[:3]), structure=np.ones((3, 3, 3)))[0].ravel()
    kept = np.isin(labels, np.unique(labels[sure]))
    return Moving(core.end, points[kept], apart[kept])


def _shares(frames: Sequence[Surroundings], end: int, points: Array) -> tuple[Array, Array, Array]:
    """Of the frames in which each of points (N, 3) is empty, is beside the persons in a view, and in two."""
    n = np.zeros((3, len(points)))
    for one in frames:
        placed = _placed(one, end, points)
        empty, n_apart = shown_in(one.views, placed)
        n_apart[one.stands_at(placed)] = 0
        n += empty, ~empty & (n_apart >= 1), ~empty & (n_apart >= 2)
    empty_in, beside_in, apart_in = n / max(len(frames), 1)
    return empty_in, beside_in, apart_in


def _candidates(frames: Sequence[Surroundings], end: int, marks: Array) -> Array:
    """Middles (N, 3) in the reference pose of the cells that are beside the persons in any of the frames."""
    found = [np.zeros((0, 3))]
    for one in frames:
        motion = one.world_from_reference[end]
        found.append((one.beside - motion[:3, 3]) @ motion[:3, :3])
    points = np.unique(np.round(np.concatenate(found) / CELL_M), axis=0) * CELL_M
    near: Mask = np.linalg.norm(points[:, None] - marks, axis=-1).min(axis=1, initial=np.inf) <= _REACH_M
    return points[near]
