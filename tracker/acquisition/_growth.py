"""How the numbers of a body model file change together when a body grows: each change is packed, per unit of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.acquisition._anatomy import SAME_M, Anatomy
from tracker.foundation.arrays import Array


def grown(anatomy: Anatomy) -> Array:
    """The whole body larger: change per relative unit."""
    change = replace(anatomy.still(), radii=np.ones_like(anatomy.radii))
    same = {name: getattr(anatomy, name) for name in ("joints", "starts", "ends", "landmarks")}
    return replace(change, **same).packed()


def fattened(anatomy: Anatomy) -> Array:
    """All radii larger: change per relative unit."""
    return replace(anatomy.still(), radii=np.ones_like(anatomy.radii)).packed()


def lengthened(anatomy: Anatomy, k: int) -> Array:
    """A segment longer along its axis: change per relative unit."""
    change, axis = anatomy.still(), anatomy.length_axis(k)
    assert axis is not None
    _stretch(anatomy, change, k, np.outer(axis, axis))
    return change.packed()


def widened(anatomy: Anatomy, k: int, axis: int) -> Array:
    """A segment with several joints larger along one axis of the reference pose: change per relative unit."""
    change, unit = anatomy.still(), np.eye(3)[axis]
    _stretch(anatomy, change, k, np.outer(unit, unit))
    for p, segment in enumerate(anatomy.part_segments):
        if segment == k:
            _, front, side = anatomy.part_axes(p)
            change.radii[p] += (front @ unit) ** 2, (side @ unit) ** 2
    return change.packed()


def shifted(anatomy: Anatomy, k: int, shift: Array) -> Array:
    """A joint elsewhere on its parent: change per metre; landmarks between it and its mate follow half."""
    change = anatomy.still()
    _carry(anatomy, change, k, shift)
    middle = (anatomy.joints[k] + anatomy.joints[anatomy.segment_mates[k]]) / 2
    for m, segment in enumerate(anatomy.landmark_segments):
        if segment == anatomy.parents[k] and np.linalg.norm(anatomy.landmarks[m] - middle) < SAME_M:
            change.landmarks[m] += shift / (1 if anatomy.segment_mates[k] == k else 2)
    return change.packed()


def end_moved(anatomy: Anatomy, p: int, end: str, shift: Array) -> Array:
    """One end of a part elsewhere: change per metre; landmarks there follow."""
    change, points = anatomy.still(), anatomy.starts if end == "start" else anatomy.ends
    (change.starts if end == "start" else change.ends)[p] += shift
    for m, segment in enumerate(anatomy.landmark_segments):
        if segment == anatomy.part_segments[p] and np.linalg.norm(anatomy.landmarks[m] - points[p]) < SAME_M:
            change.landmarks[m] += shift
    return change.packed()


def _carry(anatomy: Anatomy, change: Anatomy, k: int, shift: Array) -> None:
    """Moves segment k with all that hangs on it."""
    below = set(anatomy.below(k))
    for j in below:
        change.joints[j] += shift
    for p, segment in enumerate(anatomy.part_segments):
        if segment in below:
            change.starts[p] += shift
            change.ends[p] += shift
    for m, segment in enumerate(anatomy.landmark_segments):
        if segment in below:
            change.landmarks[m] += shift


def _stretch(anatomy: Anatomy, change: Anatomy, k: int, along: Array) -> None:
    joint = anatomy.joints[k]
    for j in anatomy.children(k):
        _carry(anatomy, change, j, along @ (anatomy.joints[j] - joint))
    for p, segment in enumerate(anatomy.part_segments):
        if segment == k:
            change.starts[p] += along @ (anatomy.starts[p] - joint)
            change.ends[p] += along @ (anatomy.ends[p] - joint)
    for m, segment in enumerate(anatomy.landmark_segments):
        if segment == k:
            change.landmarks[m] += along @ (anatomy.landmarks[m] - joint)
