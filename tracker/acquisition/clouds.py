"""Surface points of one moment: read from a PLY file, thinned evenly, with the directions that the surface faces."""

from __future__ import annotations

import importlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pydantic
from scipy.spatial import cKDTree

from tracker.acquisition.pictures import Picture
from tracker.bodies.contours import Contours
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers, frozen
from tracker.foundation.configuration.components import FilePath, component
from tracker.foundation.errors import SequenceError
from tracker.images.sight import Observation

_LARGEST_BYTES = 2**30
"""Of a file: a cloud of ten million points has a third of it."""

_LEAST_POINTS = 60
"""Of a thinned cloud: a forearm alone has as many at 15 mm."""

_SMALLEST_M, _LARGEST_M = 0.1, 4.0
"""Extent of a cloud along its longest axis: less is no body, more is a room or not in metres."""

_AROUND = 12
"""Neighbours that a normal is estimated from: they lie within two spacings."""


@component
class MeasuredMoment:
    """One moment: points on the person's surface, and perhaps silhouettes; metres, z up, one world for all."""

    cloud: FilePath
    """PLY file of points, as `bodytrack surface` and `bodytrack follow` write it, or a scanned mesh; all of the person
    or a part, and nothing else."""

    silhouettes: tuple[Picture, ...] = ()
    """Pictures of the same moment, each with `rig` and `view`."""

    frame: pydantic.NonNegativeInt | None = None
    """Number among the frames of trajectories and start poses; None for the moment's place in the list."""


@dataclass(frozen=True)
class Cloud:
    """N surface points, evenly thinned."""

    points: Array
    """(N, 3) in the world, metres."""

    sigmas: Array
    """(N,) standard deviation along the normal, metres."""

    normals: Array
    """(N, 3) unit vectors across the surface; which way is not known."""

    spacing_m: float
    """Each point stands for a square of this length, metres."""


def read_cloud(path: Path, spacing_m: float) -> Cloud:
    """Reads the vertices of a PLY file: a measured cloud, or a scanned mesh.

    Args:
        path: the file, metres; a property `sigma`, as `bodytrack surface` writes it, is the points' error.
        spacing_m: distance of the points that are kept.

    Raises:
        SequenceError: it is missing, no PLY file, or no surface of a body in metres.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST_BYTES)
    except OSError as error:
        raise SequenceError(f"{path}: cannot read the points: {error.strerror or error}") from error
    if not content.startswith(b"ply"):
        raise SequenceError(f"{path}: expected a PLY file of surface points: it does not begin with ply")
    # a quarter of a second that nothing else has to wait for
    trimesh = importlib.import_module("trimesh")
    try:
        found = trimesh.load(io.BytesIO(content), file_type="ply", process=False)
        points = np.array(found.vertices, dtype=np.float64).reshape(-1, 3)
        raw = found.metadata.get("_ply_raw", {}).get("vertex", {}).get("data")
        named = () if raw is None else raw.dtype.names or ()
        # of three axes, of which one lies along the normal
        sigmas = np.asarray(raw["sigma"], np.float64) / np.sqrt(3) if "sigma" in named else np.zeros(len(points))
    except Exception as error:  # whatever a damaged file makes of the parser
        raise SequenceError(f"{path}: damaged PLY file: {str(error)[:100]}") from error
    good = np.isfinite(points).all(axis=1) & np.isfinite(sigmas)
    if not good.any():
        raise SequenceError(f"{path}: {len(points)} vertices, none of which is finite; expected surface points")
    extent = float(np.ptp(points[good], axis=0).max())
    if not _SMALLEST_M < extent < _LARGEST_M:
        hint = "are they in millimetres?" if extent > _LARGEST_M else "is it a part of a body?"
        raise SequenceError(f"{path}: points over {extent:.3g} m, expected those of one person in metres: {hint}")
    cloud = cloud_of(points[good], sigmas[good], spacing_m)
    if len(cloud.points) < _LEAST_POINTS:
        raise SequenceError(
            f"{path}: {len(cloud.points)} points {1000 * spacing_m:.0f} mm apart, expected at least {_LEAST_POINTS}"
        )
    return cloud


def cloud_of(points: Array, sigmas: Array, spacing_m: float) -> Cloud:
    """One point for each cube that holds some, their mean: all parts of the surface count alike.

    Args:
        points: (N, 3) metres.
        sigmas: (N,) standard deviations, metres.
        spacing_m: edge of the cubes.
    """
    _, cube, counts = np.unique(
        np.floor(points / spacing_m).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    cube = cube.ravel()
    mean = np.stack([np.bincount(cube, points[:, k]) for k in range(3)], axis=1) / counts[:, None]
    variances = np.bincount(cube, sigmas**2) / counts**2
    return Cloud(frozen(mean), frozen(np.sqrt(variances)), frozen(_normals(mean)), spacing_m)


def _normals(points: Array) -> Array:
    """(N, 3) directions in which the neighbours of each point extend the least."""
    n = min(_AROUND, len(points))
    _, near = cKDTree(points).query(points, k=n)
    around = points[np.asarray(near).reshape(len(points), n)]
    offsets = around - around.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets))
    normals: Array = axes[:, :, 0]
    return normals


# Looks: what the cameras of one moment show of a person.


@dataclass(frozen=True)
class Mark:
    """A joint clicked in a picture."""

    landmark: int
    view: int
    pixel: Array
    """(2,) px."""


@dataclass(frozen=True)
class Look:
    """Images of the person by the cameras of one moment."""

    rig: Rig
    columns: Integers
    """(dof,) where the pose is among all pose values: looks can share joint angles."""

    outlines: Observation | None = None
    """Outlines of the silhouettes."""

    edges: Callable[[Contours], Observation] | None = None
    """Edges that are accepted, given the expected contours."""

    marks: tuple[Mark, ...] = ()

    cloud: Cloud | None = None
    """Points measured on its surface."""
