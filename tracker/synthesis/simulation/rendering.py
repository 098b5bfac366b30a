"""Pictures of clothed, shaded persons, drawn over background plates."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import cycle

import cv2
import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.body.sections import Clothes
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask
from tracker.kernels.pictures import rasterize

# The chords of 36 faces lie at most 0.4 % of the radius inside the surface: 0.6 mm at a trunk.
_N_ETA, _N_OMEGA = 25, 36
# A pixel is the mean of four.
_SUPERSAMPLE = 2
# From above, a little from the front, as in a gym; a lamp straight above would hide the floor shadow.
_LIGHT = np.array([0.35, -0.2, 0.92]) / np.linalg.norm([0.35, -0.2, 0.92])

# BGR of the garments in the order of the model file; a body with more of them wears the first ones again. Sleeves
# contrast with the torso as in the paper's recordings, so that arms before the body show; the last one's do not.
_WARDROBES: tuple[tuple[tuple[int, int, int], ...], ...] = (
    ((128, 60, 38), (70, 170, 215), (62, 58, 60), (28, 26, 30)),
    ((52, 96, 46), (60, 60, 190), (120, 96, 70), (40, 44, 60)),
    ((66, 58, 56),),
)
# BGR.
_SKIN, _HAIR = (132, 160, 205), (30, 34, 44)


@dataclass(frozen=True)
class Mesh:
    """The triangulated surface of one person and the parts that move it."""

    points: Array
    """(N, 3) as they were measured, metres."""

    normals: Array | Array32
    """(N, 3) unit."""

    colours: Array32
    """(N, 3) BGR."""

    triangles: Integers
    """(T, 3) vertex numbers."""

    bones: Integers
    """(N, K) parts that move a vertex."""

    weights: Array32
    """(N, K) how much; they add up to 1."""

    part_from_rest: Array
    """(P, 4, 4) of each part, from where the points were measured."""

    def world(self, world_from_part: Array) -> tuple[Array, Array]:
        """Points and normals (N, 3) in the world of parts placed at (P, 4, 4)."""
        motions = (world_from_part @ self.part_from_rest)[self.bones, :3]
        blended = np.einsum("nk,nkij->nij", self.weights, motions)
        points = np.einsum("nij,nj->ni", blended[..., :3], self.points) + blended[..., 3]
        return points, np.einsum("nij,nj->ni", blended[..., :3], self.normals)


def mesh_of(person: Person, wardrobe: int = 0) -> Mesh:
    """The person's surface with clothes: the skin of a body that has one, else its superquadrics."""
    body = person.body
    if body.skin is None:
        return _mesh_of_parts(body, wardrobe)
    skin = body.skin
    bones, weights = skin.bones
    in_parts = np.einsum("nij,nj->ni", skin.part_from_rest[skin.labels][:, :3], np.insert(skin.points, 3, 1.0, axis=1))
    colours = np.zeros((len(skin.points), 3), dtype=np.float32)
    for k, part in enumerate(body.parts):
        worn = skin.labels == k
        if worn.any():
            colours[worn] = _dress(body.clothes, part.name, in_parts[worn], wardrobe)
    return Mesh(skin.points, skin.normals, colours, skin.faces, bones, weights, skin.part_from_rest)


def _mesh_of_parts(body: BodyModel, wardrobe: int) -> Mesh:
    eta = np.linspace(-np.pi / 2, np.pi / 2, _N_ETA)[:, None]
    omega = np.linspace(-np.pi, np.pi, _N_OMEGA, endpoint=False)[None, :]
    surfaces = [part.shape.surface(eta, omega) for part in body.parts]
    points = [found[0].reshape(-1, 3) for found in surfaces]
    colours = [_dress(body.clothes, part.name, p, wardrobe) for part, p in zip(body.parts, points, strict=True)]
    n_parts, per_part = len(points), _N_ETA * _N_OMEGA
    starts = per_part * np.arange(n_parts)
    return Mesh(
        np.concatenate(points),
        np.concatenate([found[1].reshape(-1, 3) for found in surfaces]),
        np.concatenate(colours).astype(np.float32),
        (starts[:, None, None] + _grid_triangles()).reshape(-1, 3).astype(np.int64),
        np.arange(n_parts).repeat(per_part)[:, None],
        np.ones((n_parts * per_part, 1), dtype=np.float32),
        np.broadcast_to(np.eye(4), (n_parts, 4, 4)),
    )


def _grid_triangles() -> Integers:
    """(T, 3) of a part's grid of points."""
    rows, columns = np.meshgrid(np.arange(_N_ETA - 1), np.arange(_N_OMEGA), indexing="ij")
    a, b = rows * _N_OMEGA + columns, rows * _N_OMEGA + (columns + 1) % _N_OMEGA
    halves = (a, b, a + _N_OMEGA), (b, b + _N_OMEGA, a + _N_OMEGA)
    triangles: Integers = np.concatenate([np.stack(half, -1).reshape(-1, 3) for half in halves])
    return triangles


def _dress(clothes: Clothes, part: str, points: Array, wardrobe: int) -> Array:
    """Colours (N, 3) of a part's surface: its garment's, a weak weave, perhaps a hair cap."""
    palette = cycle(_WARDROBES[wardrobe % len(_WARDROBES)])
    worn = {name: colour for parts, colour in zip(clothes.garments.values(), palette, strict=False) for name in parts}
    colours = np.tile(np.array(worn.get(part, _SKIN), dtype=np.float64), (len(points), 1))
    if part in clothes.hair:
        high = points[:, 2] / np.abs(points[:, 2]).max()
        colours[(high > 0.35) | ((points[:, 0] < -0.02) & (high > -0.3))] = _HAIR
    weave = 1 + 0.05 * np.sin(90 * points[:, :1]) * np.sin(70 * points[:, 2:])
    woven: Array = colours * weave
    return woven


def draw_persons(
    plate: Image, camera: Camera, scene: Scene, meshes: tuple[Mesh, ...], away_m: Array32 | None = None
) -> tuple[Image, Mask]:
    """Draws the scene's persons over a background plate, with anti-aliased edges and a soft shadow.

    Triangles that reach behind the camera, or to where its lens images nothing, are left out.

    Args:
        plate: BGR background.
        camera: its camera.
        scene: the persons at their poses.
        meshes: one a person.
        away_m: (h, w) how far along the camera's axis what stands on the floor is, metres, infinite where nothing does.

    Returns:
        The picture and the mask (h, w) of pixels that the persons cover by half or more.
    """
    placed = [_placed(camera, p, m) for p, m in zip(scene.persons, meshes, strict=True)]
    pixels, depths, colours, triangles = _joined(placed, meshes)
    picture = _shadowed(plate, camera, scene)
    if away_m is not None:
        # shadows are of the floor
        picture[np.isfinite(away_m)] = plate[np.isfinite(away_m)]
    mask = np.zeros(plate.shape[:2], dtype=np.bool_)
    inside: Mask = np.asarray(np.isfinite(pixels).all(axis=1))
    if not inside.any():
        return picture, mask
    triangles = triangles[inside[triangles].all(axis=1)]
    low = np.maximum(np.floor(pixels[inside].min(axis=0)) - 2, 0).astype(int)
    high = np.minimum(np.ceil(pixels[inside].max(axis=0)) + 3, camera.size).astype(int)
    if (high <= low).any():
        return picture, mask
    area = slice(low[1], high[1]), slice(low[0], high[0])
    shown = None if away_m is None else away_m[area]
    shade, cover = _shade(pixels, depths, colours, triangles, (low, high), shown)
    blended = picture[area] * (1 - cover[..., None]) + shade
    picture[area] = np.clip(blended, 0, 255).astype(np.uint8)
    mask[area] = cover >= 0.5
    return picture, mask


def _placed(camera: Camera, person: Person, mesh: Mesh) -> tuple[Array, Array, Array]:
    """Pixels (N, 2), depths (N,) and shaded colours (N, 3) of a person's vertices."""
    world, normals = mesh.world(person.body.world_from_part(person.q))
    light = 0.55 + 0.45 * np.clip(normals @ _LIGHT, -0.35, 1)
    return camera.project(world), camera.in_camera(world)[:, 2], mesh.colours * light[:, None]


def _joined(placed: list[tuple[Array, Array, Array]], meshes: tuple[Mesh, ...]) -> tuple[Array, Array, Array, Integers]:
    """All persons' vertices together, with all their triangles."""
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    triangles = [start + mesh.triangles for start, mesh in zip(starts, meshes, strict=False)]
    pixels, depths, colours = (np.concatenate(parts) for parts in zip(*placed, strict=True))
    return pixels, depths, colours, np.concatenate(triangles)


def _shade(
    pixels: Array,
    depths: Array,
    colours: Array,
    triangles: Integers,
    box: tuple[Array, Array],
    away_m: Array32 | None,
) -> tuple[Array32, Array32]:
    """Premultiplied colour (h, w, 3) and coverage (h, w) of the persons inside a box of the image."""
    low, high = box
    size = (high - low) * _SUPERSAMPLE
    buffers = np.zeros((size[1], size[0], 4), dtype=np.float32)
    if away_m is not None:
        buffers[..., 0] = (1 / away_m).repeat(_SUPERSAMPLE, axis=0).repeat(_SUPERSAMPLE, axis=1)
    before = buffers[..., 0].copy()
    fine = (pixels - low + 0.5) * _SUPERSAMPLE - 0.5
    rasterize(fine, depths, triangles, (0, 0), buffers)
    covered = buffers[..., 0] > before
    corners = triangles[buffers[..., 1][covered].astype(np.int64)]
    u, v = buffers[..., 2][covered][:, None], buffers[..., 3][covered][:, None]
    shade = np.zeros((size[1], size[0], 3), dtype=np.float32)
    shade[covered] = u * colours[corners[:, 0]] + v * colours[corners[:, 1]] + (1 - u - v) * colours[corners[:, 2]]
    target = int(high[0] - low[0]), int(high[1] - low[1])
    colour = cv2.resize(shade, target, interpolation=cv2.INTER_AREA)
    coverage = cv2.resize(covered.astype(np.float32), target, interpolation=cv2.INTER_AREA)
    return colour, coverage


def _shadowed(plate: Image, camera: Camera, scene: Scene) -> Image:
    """The plate with soft shadows below the persons' parts."""
    # A shadow has no detail: a quarter of the resolution is enough.
    size = plate.shape[1] // 4, plate.shape[0] // 4
    darkness = np.zeros(size[::-1], dtype=np.float32)
    circle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    for person in scene.persons:
        for placement, part in zip(person.body.world_from_part(person.q), person.body.parts, strict=True):
            height = max(float(placement[2, 3]), 0.0)
            centre = placement[:3, 3] - height / _LIGHT[2] * _LIGHT
            radius = float(np.sort(part.shape.size)[1]) + 0.12 * height
            rim = np.stack([radius * np.cos(circle), radius * np.sin(circle), 0 * circle], axis=1) + centre * (1, 1, 0)
            outline = camera.project(rim) / 4
            if np.isfinite(outline).all():
                blob = np.zeros_like(darkness)
                cv2.fillConvexPoly(blob, np.round(outline).astype(np.int32), 0.3 / (1 + 1.5 * height))
                darkness += blob
    soft = np.minimum(cv2.GaussianBlur(darkness, (0, 0), max(plate.shape) / 480), 0.5)
    light = 1 - cv2.resize(soft, plate.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    shaded: Image = cv2.multiply(plate, cv2.merge([light, light, light]), dtype=cv2.CV_8U)
    return shaded
