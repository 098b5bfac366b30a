"""What an acquisition leaves: the model file with its standard deviations, and residuals part by part."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from tracker.acquisition._variants import heights
from tracker.acquisition.fitting import Fit
from tracker.acquisition.variations import variations_of
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription
from tracker.foundation.arrays import Array


@dataclass(frozen=True)
class PartResidual:
    """How one part fits."""

    part: str
    rms_mm: float
    """Weighted root mean square distance between model contour and image contour, millimetres."""

    bias_mm: float
    """Weighted mean, positive where the model is too large, millimetres."""

    contour_m: float
    """Contour that was compared, metres over all views; 0 if the part was never seen."""

    size_mm: tuple[float, float, float]
    """Depth, width and length of the part, millimetres."""

    sigma_mm: tuple[float, float, float]
    """Their standard deviations."""


@dataclass(frozen=True)
class BoneLength:
    """Distance of two joints."""

    bone: str
    length_mm: float
    sigma_mm: float
    before_mm: float
    """In the model begun with, scaled by the stature."""


def part_residuals(found: Fit) -> tuple[PartResidual, ...]:
    """Residuals and sizes of all parts, in the model's order."""
    body = found.body
    sizes = 2000 * body.shapes[:, :3]
    near = 2000 * found.space.neighbours(found.shape).shapes[..., :3]
    sigmas = _sigmas(found, near.reshape(len(near), -1), sizes.ravel()).reshape(-1, 3)
    table = []
    for p, part in enumerate(body.parts):
        weights = np.concatenate([rows.weights[rows.parts == p] for rows in found.rows])
        gaps = np.concatenate([rows.residuals[rows.parts == p] for rows in found.rows])
        lengths = np.concatenate([rows.lengths_m[rows.parts == p] for rows in found.rows])
        total = max(float(weights.sum()), 1e-12)
        table.append(
            PartResidual(
                part=part.name,
                rms_mm=1000 * float(np.sqrt((weights * gaps**2).sum() / total)),
                bias_mm=1000 * float((weights * gaps).sum() / total),
                contour_m=float(lengths.sum()) / 2,
                size_mm=_three(sizes[p]),
                sigma_mm=_three(sigmas[p]),
            )
        )
    return tuple(table)


def _three(values: Array) -> tuple[float, float, float]:
    a, b, c = values.tolist()
    return a, b, c


def bone_lengths(found: Fit) -> tuple[BoneLength, ...]:
    """Lengths of all links of the model."""
    body, general = found.body, found.space.description.build()
    lengths, before = _links(body, _points(body)), _links(general, _points(general))
    sigmas = _sigmas(found, _links(body, found.space.neighbours(found.shape).landmarks), lengths)
    return tuple(
        BoneLength("-".join(link), 1000 * length, 1000 * sigma, 1000 * old)
        for link, length, sigma, old in zip(body.links, lengths.tolist(), sigmas.tolist(), before.tolist(), strict=True)
    )


def _links(body: BodyModel, landmarks: Array) -> Array:
    """Lengths (..., N) of the links, metres, where the landmarks are at (..., L, 3)."""
    ends = np.array([[body.landmark_names.index(name) for name in link] for link in body.links], dtype=np.int64)
    ends = ends.reshape(-1, 2)  # a model may have no links
    lengths: Array = np.linalg.norm(landmarks[..., ends[:, 0], :] - landmarks[..., ends[:, 1], :], axis=-1)
    return lengths


def _points(body: BodyModel) -> Array:
    """(L, 3) landmarks in the reference pose."""
    return np.array([mark.point for mark in body.landmarks]).reshape(-1, 3)


def _sigmas(found: Fit, near: Array, here: Array) -> Array:
    """Standard deviations (N,) of what is measured on the body, from the covariance of the shape.

    Args:
        found: the fit.
        near: (S, N) measured on the neighbours in the shape space.
        here: (N,) measured on the body.
    """
    jacobian = (near - here).T / found.space.steps(found.shape)
    variances: Array = np.einsum("ij,jk,ik->i", jacobian, found.covariance, jacobian)
    return np.sqrt(np.maximum(variances, 0.0))


def stature_of(body: BodyModel, carried: Collection[str] = ()) -> float:
    """Height of the body in the reference pose, from the lowest to the highest point of its parts, metres.

    Args:
        body: the body.
        carried: parts that are not of the body itself.
    """
    own = np.array([part.name not in carried for part in body.parts])
    return float(heights(body.shapes[own], body.model_from_parts[own]))


def model_of(found: Fit, name: str, about: str, carried: Collection[str] = ()) -> BodyDescription:
    """The content of the person's model file, with the standard deviations of lengths (m) and sizes (m).

    Args:
        found: the fit.
        name: of the model.
        about: how it came about.
        carried: parts that the person carries, which do not make it taller.
    """
    bones = {f"{bone.bone}.length": bone.sigma_mm / 1000 for bone in bone_lengths(found)}
    parts = {
        f"{one.part}.{what}": sigma / 1000
        for one in part_residuals(found)
        for what, sigma in zip(("depth", "width", "length"), one.sigma_mm, strict=True)
    }
    poses = [found.pose(k) for k in range(len(found.looks))]
    changes = {
        "name": name,
        "about": about,
        "stature_m": stature_of(found.body, carried),
        "sigmas": bones | parts,
        "variations": variations_of(found.space, found.shape, found.covariance, poses),
    }
    return found.space.described(found.shape).model_copy(update=changes)


def contour_rms_mm(residuals: Sequence[PartResidual]) -> float:
    """Root mean square over all parts, weighted by the contour compared, millimetres."""
    weights = np.array([one.contour_m for one in residuals])
    squares = np.array([one.rms_mm**2 for one in residuals])
    return float(np.sqrt((weights * squares).sum() / max(weights.sum(), 1e-12)))
