"""A person's model from the tracking cameras: pose, lengths and shapes together, from one or more frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pydantic

from tracker.acquisition.clouds import Look
from tracker.acquisition.fitting import Fit, FitSettings, Task, fit
from tracker.acquisition.shape_space import ShapePrior, ShapeSpace
from tracker.bodies.contours import Contours
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence.measures.outlines import outline_observation, overlap
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import SequenceError
from tracker.foundation.progress import Progress, silent
from tracker.images.analysis import Analysis
from tracker.images.analysis.contours import ContourAnalysis
from tracker.images.operations.edges import distance_to
from tracker.images.plate import Plate
from tracker.images.sight import Observation, Sight
from tracker.synthesis import Synthesis
from tracker.tracking.strangers import hide_strangers

# Foreground farther from where the person was tracked is furniture, a shadow or a passer-by.
_AROUND_M = 0.15


@component
class ViewSettings:
    """Settings of an acquisition from calibrated views."""

    prior: ShapePrior = ShapePrior()
    """Differences between persons."""

    fit: FitSettings = FitSettings(
        iterations=12,
        gate_m=0.08,
        final_gate_m=0.025,
        pose_deg=8.0,
        pose_m=0.05,
        rigid_share=0.2,
        noise_m=0.01,
        lasting=0.5,
    )
    """The refinement of shape and poses. Clothes of persons who move depart from superquadrics by 4 mm where a fit has
    bent these to them; with 5 mm of noise elbows and knees were 3 times as far off as their sigmas:
    docs/lab/sure_bodies.md."""

    frames: int = pydantic.Field(default=12, ge=1)
    """Frames used: of so many stretches of those tracked the one that leaves least over."""

    analysis: Analysis = ContourAnalysis()
    """Finds the edges that the contours are fitted to."""

    person: str | None = None
    """Person to model; may be left out for a single person."""

    least_overlap: float = pydantic.Field(default=0.6, gt=0, lt=1)
    """Least mean intersection over union of the views with a background: below it the person was not found."""

    rounds: int = pydantic.Field(default=2, ge=1)
    """Number of times that the frames are tracked with the present model, and the shape is fitted anew."""


@dataclass(frozen=True)
class Seen:
    """A person in one frame, at the pose it was tracked at."""

    frame: Frame
    scene: Scene
    """All persons at their poses."""


@dataclass(frozen=True)
class Watching:
    """The cameras and what is made of their images."""

    rig: Rig
    synthesis: Synthesis
    analysis: Analysis
    plates: tuple[Plate | None, ...]


def fit_to_views(
    space: ShapeSpace,
    start: tuple[Array, int],
    seen: Sequence[Seen],
    watching: Watching,
    settings: ViewSettings,
    progress: Progress = silent,
) -> Fit:
    """Fits the shape of one person, and its pose in every frame.

    Args:
        space: the ways in which the body may differ.
        start: shape (S,) that the frames were tracked with, and the person's position in the scene.
        seen: the frames.
        watching: rig and components.
        settings: priors and steps.
        progress: gets the progress.

    Raises:
        SequenceError: no frame to fit to.
    """
    shape, person = start
    if not seen:
        raise SequenceError("the person was lost in every frame: there is nothing to acquire a model from")
    dof = space.description.build().dof
    looks = tuple(_look(one, person, k * dof + np.arange(dof, dtype=np.int64), watching) for k, one in enumerate(seen))
    task = Task(space, looks, watching.synthesis, settings.fit, progress=progress)
    return fit(task, shape, np.concatenate([one.scene.persons[person].q for one in seen]))


def _look(seen: Seen, person: int, columns: Integers, watching: Watching) -> Look:
    """Outlines where a background is known, however little of it, and edges near the contours expected.

    With all views left out that do not know a fiftieth of what is behind the person, as at first, hardly anybody was
    fitted before backdrops that a recording makes by itself: a cartwheel that nothing was built on was 26 mm off
    instead of 15, a roll 33 instead of 21, a walk 11 instead of 8. Of who stays in one place limbs alone are known, and
    their lengths told: with views left out that do not know four fifths elbows were 6.4 degrees off, with none left out
    1.6.
    """
    analysis, frame = watching.analysis, seen.frame
    around = watching.synthesis.contours(seen.scene)
    sight = Sight(frame, watching.plates)
    hide_strangers(sight, seen.scene, watching.synthesis)
    analysis.look(sight, around)
    analysis.observe(sight, around)
    views = range(len(watching.rig))
    masks = tuple(_silhouette(sight, v) for v in views)
    unknown = tuple(sight.unknown(v) for v in views)
    own = _own(masks, seen, person, watching) if any(mask is not None for mask in masks) else ()
    outlines = outline_observation(own, unknown) if own else None

    def edges(expected: Contours) -> Observation:
        return analysis.observe(sight, expected)

    return Look(watching.rig, columns, outlines, edges)


def _silhouette(sight: Sight, view: int) -> Mask | None:
    """The foreground of a view; None if no person stands out."""
    found = sight.silhouette(view)
    return found if found is not None and found.any() else None


def _own(masks: tuple[Mask | None, ...], seen: Seen, person: int, watching: Watching) -> tuple[Mask | None, ...]:
    """The person's part of the foreground: near it, and nearer to it than to anyone else.

    Without views where persons overlap: there the outline is not one person's.
    """
    alone = [watching.synthesis.silhouettes(Scene((one,), watching.rig)) for one in seen.scene.persons]
    subject = seen.scene.persons[person]
    centre = subject.body.landmarks_in_world(subject.q).mean(axis=0)
    own: list[Mask | None] = []
    for v, (mask, camera) in enumerate(zip(masks, watching.rig.cameras, strict=True)):
        others = [silhouettes[v] for k, silhouettes in enumerate(alone) if k != person]
        if mask is None or any((other & alone[person][v]).any() for other in others):
            own.append(None)
            continue
        gap = distance_to(alone[person][v])
        around_px = _AROUND_M * camera.matrix[0, 0] / max(float(camera.in_camera(centre[None])[0, 2]), 0.1)
        nearest = np.min([distance_to(other) for other in others], axis=0) if others else np.inf
        own.append(mask & (gap <= np.minimum(around_px, nearest)))
    return tuple(own)


def view_overlaps(found: Fit, seen: Sequence[Seen], watching: Watching) -> Array:
    """Intersection over union (V,) of model and foreground where it is known, mean over the frames.

    NaN without background.
    """
    shares = np.full((len(seen), len(watching.rig)), np.nan)
    for k, one in enumerate(seen):
        sight = Sight(one.frame, watching.plates)
        hide_strangers(sight, one.scene, watching.synthesis)
        scene = Scene((Person("subject", found.body, found.pose(k)),), watching.rig)
        outlines = found.looks[k].outlines
        if outlines is None:
            continue
        for v, mask in enumerate(watching.synthesis.silhouettes(scene)):
            view = outlines.views[v]
            if view is not None and view.silhouette is not None:
                unknown = sight.unknown(v)
                shares[k, v] = overlap(mask if unknown is None else mask & ~unknown, view.silhouette)
    return mean_known(shares)


def mean_known(shares: Array) -> Array:
    """Mean over the first axis of what is not NaN."""
    known = np.isfinite(shares)
    n = known.sum(axis=0)
    means: Array = np.where(n > 0, np.where(known, shares, 0.0).sum(axis=0) / np.maximum(n, 1), np.nan)
    return means


def check_overlaps(overlaps: Array, views: tuple[str, ...], settings: ViewSettings) -> None:
    """Refuses a model that does not cover the person.

    Raises:
        SequenceError: the mean intersection over union of the views that have a background is too small.
    """
    known = np.isfinite(overlaps)
    if known.any() and overlaps[known].mean() < settings.least_overlap:
        worst = int(np.nanargmin(overlaps))
        raise SequenceError(
            f"the fitted body covers {overlaps[known].mean():.0%} of the foreground (intersection over union), "
            f"expected at least {settings.least_overlap:.0%}; worst is view {views[worst]} with "
            f"{overlaps[worst]:.0%}: check the background plates and the start, or leave `background` out and let "
            "the person stand in T-pose"
        )
