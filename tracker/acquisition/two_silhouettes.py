"""Two orthogonal silhouettes -> a person's body model (Gavrila & Davis 1996, section 3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.acquisition.fit_task import FitSettings
from tracker.acquisition.fitting import Fit, fit
from tracker.acquisition.part_search import searched_parts
from tracker.acquisition.pictures import Pair, Silhouette, read_silhouette, scene_of
from tracker.acquisition.shape_space import space_of
from tracker.acquisition.silhouette_task import SilhouetteSettings, started
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription
from tracker.evidence.measures.outlines import overlap
from tracker.foundation.errors import ModelError, SequenceError
from tracker.foundation.progress import Progress, silent
from tracker.synthesis import Synthesis
from tracker.synthesis.cpu import CpuSynthesis

_MOST_TALLER = 0.08
"""How much a silhouette may differ from the stature told, as a share: hair and shoes count, and legs may be apart."""


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
        _check_sizes(front, side, stature_m)
    stature = stature_m or _measured_stature(silhouettes[0][0])
    if description.stature_m <= 0:
        raise ModelError(f'model "{description.name}" does not tell its stature_m: it cannot be scaled')
    space = space_of(description.scaled(stature / description.stature_m), settings.prior)
    task, poses = started(space, silhouettes, settings, synthesis)
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


def _check_sizes(front: Silhouette, side: Silhouette, stature_m: float | None) -> None:
    """Refuses a pair whose pictures cannot show front and side of one person, or of one of the stature told."""
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
    for one in (front, side):
        height_m = one.box[3] * 1000 / one.camera.matrix[1, 1] if one.orthographic else None
        if stature_m is not None and height_m is not None and abs(height_m / stature_m - 1) > _MOST_TALLER:
            raise SequenceError(
                f"the person is {height_m:.2f} m high in the {one.name} view by its px_per_m, and {stature_m:.2f} m by "
                "stature_m: check both"
            )


def _measured_stature(front: Silhouette) -> float:
    if not front.orthographic:
        raise SequenceError("a perspective picture does not tell the person's size: give stature_m")
    return float(front.box[3] * 1000 / front.camera.matrix[1, 1])


def _overlaps(found: Fit, silhouettes: Sequence[Silhouette], synthesis: Synthesis) -> tuple[float, ...]:
    return tuple(
        overlap(synthesis.silhouettes(scene_of(found.body, found.pose(k), one))[0], one.mask)
        for k, one in enumerate(silhouettes)
    )


def _turn_deg(body: BodyModel, found: Fit, pair: int) -> float:
    """Turn of the person between the two views, seen from the cameras, degrees."""
    angles = []
    for k in (2 * pair, 2 * pair + 1):
        # the line of sight, not the camera's axis: the person may stand beside the middle of the picture
        sight = found.pose(k)[body.root.shifts] - found.looks[k].rig.cameras[0].centre
        angles.append(found.pose(k)[body.root.turn] - np.arctan2(sight[1], sight[0]))
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
