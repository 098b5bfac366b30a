"""What stands out in the images of a frame beside the persons' bodies: cells of space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from tracker.acquisition.calibrated_views import Seen, Watching
from tracker.bodies.scene import Scene
from tracker.cameras.camera import Camera
from tracker.cameras.seen_pixels import seen_pixels
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.images.operations.growing import grown
from tracker.images.sight import Sight
from tracker.synthesis import Synthesis
from tracker.tracking.strangers import hide_strangers

CELL_M = 0.03
"""Edge of the cells, metres."""

_SAMPLING = 2
"""Every second pixel is looked at, along both axes."""

_OWN_M = 0.05
"""What stands out so near to a person's silhouette is the person's: hair, wide clothes, what a model has not."""

_AROUND_M = 1.5
"""How far from the middle of a person cells are looked for, metres."""

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
    """Of a frame: where the segments of a person are, and what stands out beside all persons."""

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
    """What stands out in a frame.

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
