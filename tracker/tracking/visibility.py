"""The number of views that can show persons and limbs: a person in only one view is no longer measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tracker.bodies.scene import Person, Scene
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.images.sight import Sight
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.estimate import Estimate

_LEAST_INSIDE = 0.25
"""Share of a person's joints inside an image that shows the person: a leg alone does not identify a person."""

# See docs/lab/coming_in.md.
_LEAST_COVERED = 0.25
"""Share of a model's silhouette on changed pixels in a view that shows the person. Right poses have 0.9 and more, half
of a person behind a cupboard 0.5; poses of a man who had left three of four views had 0 to 0.1 there."""

_LEAST_OWN = 0.25
"""Share of a model's silhouette outside those of the others: with less, a view cannot assign a change."""


def judged_in_view(
    sight: Sight, scene: Scene, estimates: tuple[Estimate, ...], silhouettes: Sequence[Sequence[Mask]], least_views: int
) -> tuple[Estimate, ...]:
    """The estimates: persons whom too few views can show are lost, and limbs of others ambiguous.

    A view that cannot decide, without an image or a plate in its light, does not count against persons. A limb is as
    far in view as that of its parts which fewest images have inside: of a man who walked out of the pictures elbows,
    wrists and knees were up to 0.5 m off in 12 frames, and two of these in doubt.

    Args:
        sight: the images.
        scene: the persons at the poses of the estimates.
        estimates: one a person.
        silhouettes: of each person in each view (H, W); empty without backgrounds.
        least_views: least number of views; all views of a smaller rig.
    """
    least, judged = min(least_views, len(scene.rig)), list(estimates)
    placed = scene.world_from_parts()[0, :, :3, 3]
    for k, (person, estimate) in enumerate(zip(scene.persons, estimates, strict=True)):
        if not estimate.lost:
            first = scene.first_part(k)
            parts = placed[first : first + len(person.body.parts)]
            others = [own for n, own in enumerate(silhouettes) if n != k and not judged[n].lost]
            shown = _shown(sight, scene, person, _outside(silhouettes[k], others) if silhouettes else ())
            n_views = (shown[:, None] & _inside(scene, parts)).sum(axis=0)
            judged[k] = _judged(person, estimate, int(shown.sum()), n_views, least)
    return tuple(judged)


def _outside(silhouettes: Sequence[Mask], others: Sequence[Sequence[Mask]]) -> list[Mask]:
    """The part of a person's silhouettes (H, W) outside those of others; None if that is small."""
    if not others:
        return list(silhouettes)
    found = []
    for v, silhouette in enumerate(silhouettes):
        own: Mask = silhouette & ~np.any([other[v] for other in others], axis=0)
        enough = np.count_nonzero(own) >= _LEAST_OWN * np.count_nonzero(silhouette)
        found.append(own if enough else np.zeros_like(silhouette))
    return found


def _judged(person: Person, estimate: Estimate, n_shown: int, n_views: Integers, least: int) -> Estimate:
    """The estimate of a person by the number of views with the person, and with each part (P,) inside."""
    if n_shown < least:
        return estimate.losing(Doubt("", Because.FEW_VIEWS, n_shown, least))
    fewest = {group: int(n_views[person.body.parts_of(group)].min()) for group in person.body.limbs}
    return estimate.doubting(Doubt(group, Because.FEW_VIEWS, n, least) for group, n in fewest.items() if n < least)


def _shown(sight: Sight, scene: Scene, person: Person, silhouettes: Sequence[Mask]) -> Mask:
    """(V,) views that show a person, or may do so.

    A view in which another person hides the person does not count if a third view could show the person and does not. A
    woman had not come in yet, and her model stood beside a man: in two views it was behind him, in one half of it was
    before the floor.
    """
    inside: Mask = _inside(scene, person.body.landmarks_in_world(person.q)).mean(axis=1) >= _LEAST_INSIDE
    shown, hidden = inside.copy(), np.zeros_like(inside)
    for v, silhouette in enumerate(silhouettes):
        covered = sight.changed_behind(v, silhouette)
        shown[v] &= covered is None or covered >= _LEAST_COVERED
        hidden[v] = not silhouette.any()
    return shown & ~hidden if (inside & ~shown).any() else shown


def _inside(scene: Scene, points: Array) -> Mask:
    """(V, N) views that have points (N, 3) in their images."""
    sizes = np.array([camera.size for camera in scene.rig.cameras])
    pixels = scene.rig.project(points)
    return np.asarray(((pixels >= 0) & (pixels < sizes[:, None])).all(axis=-1), dtype=np.bool_)
