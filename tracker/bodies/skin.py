"""Skins: a body's own surface as a triangle mesh that moves with its parts."""

from __future__ import annotations

import importlib
import io
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from tracker.foundation.arrays import Array, Array32, Integers, frozen, shape_fault
from tracker.foundation.errors import ModelError, nearest
from tracker.foundation.files import write_whole
from tracker.foundation.source_files import text_of

MOST_BONES = 4
"""Parts that move one vertex; in scans of two dressed persons none has more with over 1 % each."""


@dataclass(frozen=True)
class Skin:
    """A triangle mesh, also of several open patches, with the influence of each part of the body on its vertices.

    Smooth skinning blends the motions of several parts (`world_points`); with one part a vertex it is rigid.

    Raises:
        ModelError: numbers out of range, weights that are none, triangles that do not exist.
    """

    points: Array
    """(N, 3) vertices in the pose of the measurement, metres, in the body's model frame."""

    faces: Integers
    """(T, 3) vertex numbers, anticlockwise seen from outside."""

    weights: Array
    """(N, P) influence of each part of the body on a vertex, not negative; scaled to the sum 1."""

    part_from_rest: Array
    """(P, 4, 4) of each part, from the pose of the measurement."""

    def __post_init__(self) -> None:
        points, faces, weights = frozen(self.points), frozen(self.faces, np.int64), frozen(self.weights)
        if fault := shape_fault(points, None, 3) or shape_fault(weights, len(points), len(self.part_from_rest)):
            raise ModelError(f"skin: {fault}")
        if fault := shape_fault(faces, None, 3):
            raise ModelError(f"skin: triangles: {fault}")
        if not len(faces) or faces.min() < 0 or faces.max() >= len(points):
            raise ModelError(f"skin: {len(faces)} triangles of {len(points)} vertices, expected vertices that exist")
        if not np.isfinite(points).all() or not np.isfinite(weights).all() or weights.min() < 0:
            raise ModelError("skin: vertices and weights must be finite, and no weight negative")
        bare = np.flatnonzero(weights.sum(axis=1) <= 0)
        if len(bare):
            raise ModelError(f"skin: {len(bare)} vertices that no part moves, the first is number {bare[0]}")
        values = points, faces, frozen(_strongest(weights)), frozen(self.part_from_rest)
        for name, value in zip(("points", "faces", "weights", "part_from_rest"), values, strict=True):
            object.__setattr__(self, name, value)

    @cached_property
    def labels(self) -> Integers:
        """(N,) the part that moves each vertex most."""
        strongest: Integers = frozen(self.weights.argmax(axis=1), np.int64)
        return strongest

    @cached_property
    def face_parts(self) -> Integers:
        """(T,) the part of most corners of a face; of three different ones that of the first."""
        a, b, c = self.labels[self.faces].T
        found: Integers = frozen(np.where(b == c, b, a), np.int64)
        return found

    @cached_property
    def bones(self) -> tuple[Integers, Array32]:
        """Parts (N, K) that move each vertex, the strongest first, and their weights (N, K)."""
        n_bones = max(1, int((self.weights > 0).sum(axis=1).max()))
        order = np.argsort(-self.weights, axis=1, kind="stable")[:, :n_bones]
        return frozen(order, np.int64), frozen(np.take_along_axis(self.weights, order, axis=1), np.float32)

    @cached_property
    def normals(self) -> Array32:
        """(N, 3) unit normals of the vertices, those of the faces weighed by the angle in the corner.

        Vertices in one place count as one: patches that were cut from one another stay smooth.
        """
        corners = self.points[self.faces]
        ways = [corners[:, (k + 1) % 3] - corners[:, k] for k in range(3)]
        across = np.cross(ways[0], -ways[2])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
        _, places = np.unique(np.round(self.points, 6), axis=0, return_inverse=True)
        sums = np.zeros((places.max() + 1, 3))
        for k in range(3):
            one, other = ways[k], -ways[(k + 2) % 3]
            lengths = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
            cosine = (one * other).sum(axis=1) / np.maximum(lengths, 1e-12)
            angles = np.arccos(np.clip(cosine, -1, 1))
            np.add.at(sums, places.ravel()[self.faces[:, k]], angles[:, None] * across)
        found = sums[places.ravel()]
        unit: Array32 = frozen(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-12), np.float32)
        return unit

    @cached_property
    def borders(self) -> Integers:
        """(E, 4) edges of a single face: both ends, the third corner of the face, and the face."""
        n_faces = len(self.faces)
        edges = np.concatenate([self.faces[:, [k, (k + 1) % 3, (k + 2) % 3]] for k in range(3)])
        _, places = np.unique(np.round(self.points, 6), axis=0, return_inverse=True)
        ends = np.sort(places.ravel()[edges[:, :2]], axis=1)
        _, first, counts = np.unique(ends, axis=0, return_index=True, return_counts=True)
        single = first[counts == 1]
        found: Integers = frozen(np.column_stack([edges[single], single % n_faces]), np.int64)
        return found

    def world_points(self, world_from_part: Array) -> Array:
        """Vertices (*B, N, 3) in the world of parts placed at (*B, P, 4, 4), metres: linear blend skinning."""
        motions = world_from_part @ self.part_from_rest
        blended = np.einsum("np,...pij->...nij", self.weights, motions[..., :3, :])
        moved: Array = np.einsum("...nij,nj->...ni", blended[..., :3], self.points) + blended[..., 3]
        return moved


def _strongest(weights: Array) -> Array:
    """The weights (N, P) with all but the `MOST_BONES` largest of each vertex left out, adding up to 1."""
    kept = weights.copy()
    if kept.shape[1] > MOST_BONES:
        weakest = np.argsort(-kept, axis=1, kind="stable")[:, MOST_BONES:]
        np.put_along_axis(kept, weakest, 0.0, axis=1)
    total: Array = kept / kept.sum(axis=1, keepdims=True)
    return total


# Surfaces of skins as files: PLY or OBJ, and tables of labels or weights.

_LARGEST_BYTES = 2**28
"""Largest file of a surface: a scan of a million triangles has a tenth of it."""

_MOST_VERTICES = 2**31
"""More than a file of that size can have."""

_NO_ARCHIVE = TypeError, ValueError, EOFError, KeyError, AttributeError, zipfile.BadZipFile, zipfile.LargeZipFile
"""Errors of numpy for other files, or for one array alone."""


@dataclass(frozen=True)
class ScannedSurface:
    """A triangle mesh as a file holds it."""

    points: Array
    """(N, 3) in the unit of the file."""

    faces: Integers
    """(T, 3) vertex numbers."""

    groups: tuple[str, ...] = ()
    """(T,) name of the group of each triangle; empty where the file has none."""


@dataclass(frozen=True)
class Rigging:
    """Influence of segments on the vertices of a surface."""

    segments: tuple[str, ...]
    """(S,) names of segments or parts."""

    weights: Array
    """(N, S) influence of each of them on a vertex."""

    def rigid(self) -> Rigging:
        """Every vertex moved by its strongest segment alone."""
        alone = np.eye(len(self.segments))[self.weights.argmax(axis=1)]
        return Rigging(self.segments, alone)


def read_surface(path: Path) -> ScannedSurface:
    """Reads a triangle mesh.

    Raises:
        ModelError: the file is missing, not a mesh of triangles, or neither PLY nor OBJ.
    """
    readers = {".ply": _read_ply, ".obj": _read_obj}
    if path.suffix.lower() not in readers:
        raise ModelError(f"{path}: expected a surface in a .ply or .obj file")
    try:
        surface = readers[path.suffix.lower()](path)
    except OSError as error:
        raise ModelError(f"{path}: cannot read the surface: {error.strerror or error}") from error
    n_points = len(surface.points)
    if not n_points or not len(surface.faces):
        raise ModelError(f"{path}: {n_points} vertices and {len(surface.faces)} triangles, expected a surface")
    if surface.faces.min() < 0 or surface.faces.max() >= n_points or not np.isfinite(surface.points).all():
        raise ModelError(f"{path}: a triangle of vertices that do not exist, or a vertex that is not finite")
    return surface


def _read_ply(path: Path) -> ScannedSurface:
    with path.open("rb") as file:
        content = file.read(_LARGEST_BYTES)
    if not content.startswith(b"ply"):
        raise ModelError(f"{path}: not a PLY file: it does not begin with ply")
    # a quarter of a second that bodies without a skin need not wait
    trimesh = importlib.import_module("trimesh")
    try:
        mesh = trimesh.load(io.BytesIO(content), file_type="ply", process=False)
        points, faces = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)
    except Exception as error:  # whatever a damaged file makes of the parser
        raise ModelError(f"{path}: damaged PLY file, or no mesh of triangles: {str(error)[:100]}") from error
    return ScannedSurface(points.reshape(-1, 3), faces.reshape(-1, 3))


def _read_obj(path: Path) -> ScannedSurface:
    points: list[list[float]] = []
    faces: list[list[int]] = []
    groups: list[str] = []
    group = ""
    for n, line in enumerate(text_of(path, ModelError, "the surface", _LARGEST_BYTES).splitlines(), start=1):
        words = line.split()
        try:
            if words[:1] == ["v"]:
                points.append([float(word) for word in words[1:4]])
            elif words[:1] in (["g"], ["o"]):
                group = words[1] if len(words) > 1 else ""
            elif words[:1] == ["f"]:
                corners = [int(word.partition("/")[0]) for word in words[1:]]
                if not all(0 < abs(one) < _MOST_VERTICES for one in corners):
                    raise ModelError(f"{path}: line {n}: vertices {corners}, expected 1 and on, or -1 and back")
                corners = [one - 1 if one > 0 else len(points) + one for one in corners]
                # a polygon as a fan of triangles
                for k in range(1, len(corners) - 1):
                    faces.append([corners[0], corners[k], corners[k + 1]])
                    groups.append(group)
        except ValueError as error:
            raise ModelError(f"{path}: line {n}: {error}") from error
    if any(len(point) != 3 for point in points):
        raise ModelError(f"{path}: a vertex without three coordinates")
    named = tuple(groups) if any(groups) else ()
    return ScannedSurface(np.array(points).reshape(-1, 3), np.array(faces, dtype=np.int64).reshape(-1, 3), named)


def read_rigging(path: Path, n_points: int) -> Rigging:
    """Reads the influence of segments: an .npz archive of `segments` and `weights` (N, S) or `label` (N,).

    Args:
        path: the archive, as `numpy.savez` writes it.
        n_points: number of vertices that it must be for.

    Raises:
        ModelError: the file is missing or damaged, or for another surface.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            found = {name: archive[name] for name in archive.files if name in ("segments", "weights", "label")}
            names = list(archive.files)
    except OSError as error:
        raise ModelError(f"{path}: cannot read the weights: {error.strerror or error}") from error
    except _NO_ARCHIVE as error:
        raise ModelError(f"{path}: not an archive of numpy: {str(error)[:100]}") from error
    if "segments" not in found or not {"weights", "label"} & set(found):
        raise ModelError(
            f'{path}: expected "segments", and "weights" or "label"; found {", ".join(names) or "nothing"}'
        )
    segments = tuple(str(name) for name in found["segments"].ravel())
    name = "weights" if "weights" in found else "label"
    if found[name].dtype.kind not in "biuf":
        raise ModelError(f'{path}: "{name}" are of type {found[name].dtype}, expected numbers')
    if name == "weights":
        weights = np.asarray(found["weights"], dtype=np.float64)
    else:
        if not np.array_equal(found["label"], np.floor(found["label"])):
            raise ModelError(f'{path}: "label" has values that are no whole numbers, expected those of segments')
        labels = np.asarray(found["label"], dtype=np.int64).ravel()
        if len(labels) and not 0 <= labels.min() <= labels.max() < len(segments):
            raise ModelError(f"{path}: labels {labels.min()} to {labels.max()}, expected 0 to {len(segments) - 1}")
        weights = np.eye(len(segments))[labels]
    if weights.shape != (n_points, len(segments)):
        raise ModelError(f"{path}: weights {weights.shape}, expected ({n_points}, {len(segments)}): vertices, segments")
    return Rigging(segments, weights)


def rigging_of_groups(surface: ScannedSurface, path: Path) -> Rigging:
    """Groups of an OBJ file as labels of their vertices; a vertex of several groups belongs to the first.

    Raises:
        ModelError: there are no groups, or vertices of none.
    """
    if not surface.groups:
        raise ModelError(f'{path}: has no groups: name the parts in lines "g PART", or give `weights`, an .npz file')
    segments = tuple(dict.fromkeys(surface.groups))
    weights = np.zeros((len(surface.points), len(segments)))
    for k in range(len(segments) - 1, -1, -1):
        own = surface.faces[[group == segments[k] for group in surface.groups]].ravel()
        weights[own] = 0.0
        weights[own, k] = 1.0
    # a vertex of no triangle is never seen
    weights[weights.sum(axis=1) == 0, 0] = 1.0
    return Rigging(segments, weights)


def write_surface(surface: ScannedSurface, path: Path) -> None:
    """Writes a mesh as binary PLY, metres; replaced as a whole."""
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(surface.points)}"]
    header += [f"property float {axis}" for axis in "xyz"]
    header += [f"element face {len(surface.faces)}", "property list uchar int vertex_indices", "end_header"]
    faces = np.zeros(len(surface.faces), dtype=[("n", "u1"), ("corners", "<i4", 3)])
    faces["n"], faces["corners"] = 3, surface.faces
    content = surface.points.astype("<f4").tobytes() + faces.tobytes()
    write_whole(path, ("\n".join(header) + "\n").encode("ascii") + content)


def write_rigging(rigging: Rigging, path: Path) -> None:
    """Writes names and weights as an archive of numpy, the same bytes for the same content; replaced as a whole."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, segments=np.array(rigging.segments), weights=rigging.weights.astype(np.float32))
    write_whole(path, buffer.getvalue())


def columns_of(rigging: Rigging, parts: tuple[str, ...], segments: tuple[str, ...]) -> Integers:
    """(S,) number of the part for each name of a rigging: a part, or the only part of a segment.

    Args:
        rigging: names and weights.
        parts: (P,) names of the body's parts.
        segments: (P,) the segment that each of them belongs to.

    Raises:
        ModelError: a name with influence is neither.
    """
    found = np.full(len(rigging.segments), -1, dtype=np.int64)
    for k, name in enumerate(rigging.segments):
        own = [p for p, segment in enumerate(segments) if segment == name]
        if name in parts:
            found[k] = parts.index(name)
        elif len(own) == 1:
            found[k] = own[0]
        elif rigging.weights[:, k].any():
            raise ModelError(f'skin: no part "{name}"; {nearest(name, parts)}')
    return found
