"""Outcome of a frame: persons in view, and overlap of the models with the images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Mask, frozen
from tracker.images.sight import Sight
from tracker.synthesis import Synthesis
from tracker.tracking.clock import Clock
from tracker.tracking.estimate import Estimate
from tracker.tracking.overlap import judged_in_space
from tracker.tracking.trajectory import Step
from tracker.tracking.visibility import judged_in_view


def finished(
    sight: Sight,
    scene: Scene,
    synthesis: Synthesis,
    estimates: tuple[Estimate, ...],
    clock: Clock,
    least_views: int,
) -> Step:
    """The step of a frame from its estimates.

    Args:
        sight: the images.
        scene: the persons at the poses of the estimates.
        synthesis: draws them.
        estimates: one a person.
        clock: with the time spent on the frame.
        least_views: number of views that must show a person.
    """
    with clock("synthesis"):
        fitted: Contours = synthesis.contours(scene)
        foregrounds = [sight.silhouette(v) for v in range(len(scene.rig))]
        looked = bool(sight.untrusted) or any(mask is not None for mask in foregrounds)
        models = synthesis.silhouettes(scene) if looked else ()
        own = _own(scene, synthesis, models)
        estimates = judged_in_view(sight, scene, estimates, own, least_views)
        estimates = judged_in_space(scene, estimates)
    there = _of_those_found(own, estimates) if any(one.lost for one in estimates) else models
    overlap = _overlap(there, foregrounds, [sight.unknown(v) for v in range(len(foregrounds))]) if looked else None
    step = Step(sight.held, scene, estimates, fitted, clock.seconds, overlap)
    step = replace(step, model_px=covered_px(models, estimates))
    return replace(step, untrusted=sight.untrusted, strangers=sight.strangers)


def still_lost(
    sight: Sight,
    scene: Scene,
    synthesis: Synthesis,
    estimates: Sequence[Estimate],
    frames_lost: Sequence[int],
    least_views: int,
) -> list[Estimate]:
    """The estimates; persons who were lost before, and whom too few views show, stay lost.

    Args:
        sight: the images.
        scene: the persons at the poses of the estimates.
        synthesis: draws them.
        estimates: one a person.
        frames_lost: number of frames before this one in which each of them was lost.
        least_views: number of views that must show a person.
    """
    if all(one.lost or not since for one, since in zip(estimates, frames_lost, strict=True)):
        return list(estimates)
    own = [synthesis.silhouettes(replace(scene, persons=(person,))) for person in scene.persons]
    shown = judged_in_view(sight, scene, tuple(estimates), own, least_views)
    pairs = zip(frames_lost, estimates, shown, strict=True)
    return [judged if since and judged.lost else one for since, one, judged in pairs]


def _own(scene: Scene, synthesis: Synthesis, models: tuple[Mask, ...]) -> Sequence[tuple[Mask, ...]]:
    """The silhouettes of each person; empty if they are not needed."""
    if not models or len(scene.persons) == 1:
        return (models,) if models else ()
    return [synthesis.silhouettes(replace(scene, persons=(person,))) for person in scene.persons]


def covered_px(models: Sequence[Mask], estimates: Sequence[Estimate]) -> Array | None:
    """Pixels (V,) of the model's silhouettes; None without a foreground, or with a lost person."""
    if not models or any(estimate.lost for estimate in estimates):
        return None
    return frozen([np.count_nonzero(mask) for mask in models])


def _of_those_found(own: Sequence[Sequence[Mask]], estimates: Sequence[Estimate]) -> Sequence[Mask]:
    """Silhouettes (H, W) of the persons who are not lost, in each view; empty if all are lost."""
    found = [masks for masks, estimate in zip(own, estimates, strict=False) if not estimate.lost]
    return [np.any(masks, axis=0) for masks in zip(*found, strict=True)]


def _overlap(models: Sequence[Mask], foregrounds: Sequence[Mask | None], unknown: Sequence[Mask | None]) -> Array:
    """Intersection over union (V,) of the models' and the foreground's silhouettes, if the background is known.

    NaN if it is unknown, and without a model: a pose of no person covers nothing.
    """
    shares = np.full(len(foregrounds), np.nan)
    if not models:
        return frozen(shares)
    for v, (mask, foreground, hidden) in enumerate(zip(models, foregrounds, unknown, strict=True)):
        if foreground is not None:
            mask = mask if hidden is None else mask & ~hidden
            union = np.count_nonzero(mask | foreground)
            shares[v] = np.count_nonzero(mask & foreground) / union if union else np.nan
    return frozen(shares)
