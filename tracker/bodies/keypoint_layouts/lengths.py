"""Whether keypoints are what their number says they are: limbs in space are as long as the body's."""

from __future__ import annotations

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.keypoint_layouts.views import KeypointFiles, KeypointViews
from tracker.bodies.keypoints import limbs, meant, swapped_sides
from tracker.bodies.skeletons import skeletons
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array

_BONES = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
"""Ends of what a limb of a person is made of, on both sides."""

_N_FRAMES = 3
"""Frames that are looked at, spread over all."""

_OTHER, _SAME = 0.3, 0.15
"""Natural logarithm of how much longer or shorter limbs are, on average, from where on keypoints are others than they
are taken for, and up to which they are the same. BlazePose's on seven recordings have 0.03 to 0.25, taken for another
layout 0.37 to 1.05."""


def fitting_layout(files: KeypointFiles, rig: Rig, body: BodyModel) -> str | None:
    """The layout as which keypoints fit a body, where their number alone told another one, as which they do not fit.

    None where all is well, and where no layout fits: few views show the same person at the same number.

    Raises:
        SequenceError: a file is none of keypoints.
    """
    views = files.opened(rig)
    if not views.order.by_number or not views.order.others or _off(views, files, rig, body) <= _OTHER:
        return None
    others = {other: KeypointViews.open(files.path, rig.names, layout=other) for other in views.order.others}
    return next((other for other, read in others.items() if _off(read, files, rig, body) < _SAME), None)


def _off(views: KeypointViews, files: KeypointFiles, rig: Rig, body: BodyModel) -> float:
    """How far lengths of limbs are from the body's in some frames, mean logarithm; NaN where none is seen."""
    other_side, groups = swapped_sides(views.names, body.mirror), limbs(views.names, body)
    numbers = views.sources[0].numbers
    lengths = [np.zeros(0)]
    for number in numbers[:: max(1, len(numbers) // _N_FRAMES)][:_N_FRAMES]:
        frame = Frame(number, 0.0, (None,) * len(rig))
        for person in skeletons(rig, files.found(views, frame, rig), other_side, groups, 1):
            lengths.append(_log_ratios(views.names, person.points, body))
    off = np.abs(np.concatenate(lengths))
    return float(np.mean(off)) if len(off) else np.nan


def _log_ratios(names: tuple[str, ...], points: Array, body: BodyModel) -> Array:
    """Of the lengths of limbs whose ends are seen to the body's."""
    known = meant(names, body)
    place = {names[row]: k for k, row in enumerate(known.rows)}
    ends = [(f"{side}_{upper}", f"{side}_{lower}") for side in ("left", "right") for upper, lower in _BONES]
    pairs = [(place[one], place[two]) for one, two in ends if one in place and two in place]
    if not pairs:
        return np.zeros(0)
    first, last = np.array(pairs).T
    seen = np.linalg.norm(points[known.rows[last]] - points[known.rows[first]], axis=1)
    ratios: Array = np.log(seen / np.linalg.norm(known.points[last] - known.points[first], axis=1))
    return ratios[np.isfinite(ratios)]
