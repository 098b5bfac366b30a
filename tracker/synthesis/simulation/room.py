"""A cluttered room and four cameras in its corners, like the HIA recordings of the paper (section 5, figure 7)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image


@dataclass(frozen=True)
class Room:
    """A box with furniture along its walls; its floor is z = 0."""

    centre: tuple[float, float] = (0.0, 0.0)
    """Of the floor, metres."""

    half: tuple[float, float] = (4.6, 4.2)
    """Half width and half depth, metres."""

    height: float = 3.4
    """Metres."""

    texel: float = 160.0
    """Pixels a metre of its textures."""


_USUAL = Room()
_Box = tuple[Array, Array, Image]
"""Lowest and highest corner, metres, and a texture."""

# Metres: what lies between a camera and the wall behind it, and furniture that would stand before a lens.
_BEHIND_CAMERAS, _BEFORE_LENS = 1.3, 1.2
# Pixels along the longest wall: textures of the six faces then take 100 MB at most.
_LONGEST_TEXTURE = 3000.0


def room_around(rig: Rig, place: tuple[float, float]) -> Room:
    """A room that holds cameras and what they film, at least as large as the usual one.

    Args:
        rig: cameras above the floor.
        place: x and y of the middle of what is filmed, metres.
    """
    inside = np.array([*(camera.centre for camera in rig.cameras), (*place, 0.0)])
    low, high = inside.min(axis=0), inside.max(axis=0)
    usual = Room()
    half = np.maximum((high - low)[:2] / 2 + _BEHIND_CAMERAS, usual.half)
    x, y = ((low + high) / 2)[:2].tolist()
    texel = min(usual.texel, _LONGEST_TEXTURE / (2 * float(half.max())))
    return Room((x, y), (float(half[0]), float(half[1])), max(usual.height, float(high[2]) + 0.5), texel)


def default_rig(size: tuple[int, int] = (720, 576)) -> Rig:
    """FRONT, RIGHT, BACK and LEFT, 5.2 m from the centre of the room and 2.3 m high."""
    focal = 850.0 * size[0] / 720
    target = np.array([0.0, 0.0, 0.95])
    places = {"FRONT": (3.8, -3.3, 2.3), "RIGHT": (-3.7, -3.4, 2.5), "BACK": (-3.8, 3.2, 2.2), "LEFT": (3.7, 3.4, 2.4)}
    return Rig(tuple(Camera.looking_at(name, size, focal, place, target) for name, place in places.items()))


def background_plates(rig: Rig, seed: int = 0, room: Room = _USUAL) -> tuple[Image, ...]:
    """What each camera sees of the empty room, BGR.

    Args:
        rig: cameras inside the room.
        seed: chooses the room's textures.
        room: its place and size.
    """
    rng = np.random.default_rng(seed)
    faces = _faces(rng, room)
    boxes = [box for box in _furniture(rng, room) if not _before_a_lens(box, rig)]
    return tuple(_render(camera, room, faces, boxes) for camera in rig.cameras)


def _before_a_lens(box: _Box, rig: Rig) -> bool:
    """Whether a box stands where it would fill a picture; never so in the usual room."""
    middle = (box[0] + box[1])[:2] / 2
    return any(float(np.linalg.norm(camera.centre[:2] - middle)) < _BEFORE_LENS for camera in rig.cameras)


def _faces(rng: np.random.Generator, room: Room) -> dict[tuple[int, int], Image]:
    """Textures of the six faces of the room by axis and side."""
    width, depth = (round(2 * half * room.texel) for half in room.half)
    height = round(room.height * room.texel)
    return {
        (2, 0): _floor(rng, depth, width, room.texel),
        (2, 1): _plain(rng, depth, width, (205, 208, 210)),
        (0, 0): _wall(rng, height, depth, room.texel),
        (0, 1): _wall(rng, height, depth, room.texel),
        (1, 0): _wall(rng, height, width, room.texel),
        (1, 1): _wall(rng, height, width, room.texel),
    }


def _plain(rng: np.random.Generator, rows: int, columns: int, colour: tuple[int, int, int]) -> Image:
    """A surface with soft stains and grain."""
    stains = cv2.resize(
        rng.normal(0, 7, (rows // 60 + 2, columns // 60 + 2)), (columns, rows), interpolation=cv2.INTER_CUBIC
    )
    grain = rng.normal(0, 2.5, (rows, columns))
    plain: Image = np.clip(np.array(colour) + (stains + grain)[..., None], 0, 255).astype(np.uint8)
    return plain


def _floor(rng: np.random.Generator, rows: int, columns: int, texel: float) -> Image:
    """Tiles with joints."""
    picture = _plain(rng, rows, columns, (104, 116, 124))
    for at in range(0, max(rows, columns), round(0.6 * texel)):
        cv2.line(picture, (at, 0), (at, rows), (78, 86, 92), 2)
        cv2.line(picture, (0, at), (columns, at), (78, 86, 92), 2)
    return picture


def _wall(rng: np.random.Generator, rows: int, columns: int, texel: float) -> Image:
    """Paint, posters, bars and a highly textured rack; row 0 is the floor."""
    colour = tuple(int(c) for c in rng.integers(140, 190, 3))
    picture = _plain(rng, rows, columns, (colour[0], colour[1], colour[2]))
    for _ in range(7):
        x, y = _below(rng, 0, columns - 120), _below(rng, rows // 3, rows - 150)
        w, h = int(rng.integers(60, 220)), int(rng.integers(60, 150))
        _poster(rng, picture[y : y + h, x : x + w])
    for _ in range(9):
        x, wide = int(rng.integers(0, columns)), int(rng.integers(4, 14))
        shade = tuple(int(c) for c in rng.integers(20, 110, 3))
        if rng.random() < 0.65:
            cv2.rectangle(picture, (x, 0), (x + wide, rows), shade, -1)
        else:
            y = int(rng.integers(rows // 4, rows))
            cv2.rectangle(picture, (0, y), (columns, y + wide), shade, -1)
    x = _below(rng, 0, columns - 300)
    _rack(rng, picture[40 : round(1.9 * texel), x : x + 260])
    return picture


def _below(rng: np.random.Generator, low: int, high: int) -> int:
    """A number from low to high - 1; low where a wall of a hall, whose texels are large, has no room for more."""
    return int(rng.integers(low, max(high, low + 1)))


def _poster(rng: np.random.Generator, area: Image) -> None:
    area[:] = rng.integers(40, 240, 3)
    for _ in range(8):
        centre = tuple(int(v) for v in rng.integers(0, max(area.shape[:2]), 2))
        colour = tuple(int(c) for c in rng.integers(0, 256, 3))
        cv2.circle(area, centre, int(rng.integers(4, 40)), colour, int(rng.choice([-1, 3])))


def _rack(rng: np.random.Generator, area: Image) -> None:
    """Shelves of narrow books."""
    area[:] = (38, 44, 52)
    for y in range(8, area.shape[0] - 40, 52):
        x = 6
        while x < area.shape[1] - 14:
            wide, high = int(rng.integers(4, 13)), int(rng.integers(28, 42))
            cv2.rectangle(area, (x, y), (x + wide - 2, y + high), tuple(int(c) for c in rng.integers(30, 230, 3)), -1)
            x += wide


def _furniture(rng: np.random.Generator, room: Room) -> list[_Box]:
    """Boxes along the walls: lowest and highest corner, metres, and a texture."""
    boxes = []
    for k in range(7):
        angle = 2 * np.pi * (k + rng.uniform(-0.3, 0.3)) / 7
        reach = np.array(room.half) - (0.9, 0.8)
        centre = room.centre + reach * (np.cos(angle), np.sin(angle))
        half, high = rng.uniform(0.2, 0.45, 2), rng.uniform(0.4, 1.1)
        colour = tuple(int(c) for c in rng.integers(50, 190, 3))
        texture = _plain(rng, 160, 160, (colour[0], colour[1], colour[2]))
        cv2.rectangle(texture, (8, 8), (151, 151), tuple(int(c * 0.6) for c in colour), 5)
        boxes.append((np.array([*(centre - half), 0.0]), np.array([*(centre + half), high]), texture))
    return boxes


def _render(camera: Camera, room: Room, faces: dict[tuple[int, int], Image], boxes: list[_Box]) -> Image:
    """Ray casting at twice the resolution, averaged, some rows at a time: a large picture has 33 million rays."""
    width, height = camera.size
    plate = np.zeros((height, width, 3), dtype=np.uint8)
    origin = camera.centre[:, None]
    for top in range(0, height, _ROWS):
        n_rows = min(_ROWS, height - top)
        columns, rows = np.meshgrid(
            (np.arange(2 * width) - 0.5) / 2, (np.arange(2 * top, 2 * (top + n_rows)) - 0.5) / 2
        )
        # what the lens images nothing to shows what lies at its end
        rays = camera.rays(np.stack([columns, rows], axis=-1).reshape(-1, 2), clamped=True)
        rays = np.ascontiguousarray(np.where(np.abs(rays) < 1e-12, 1e-12, rays).T)
        colours = _cast_room(origin, rays, room, faces)
        nearest = np.full(rays.shape[1], np.inf)
        for box in boxes:
            _cast_box(origin, rays, box, colours, nearest)
        picture = colours.reshape(2 * n_rows, 2 * width, 3)
        plate[top : top + n_rows] = cv2.resize(picture, (width, n_rows), interpolation=cv2.INTER_AREA)
    return plate


# Rows of a picture that are cast together: 50 MB of rays at 4K.
_ROWS = 128


def _cast_room(origin: Array, rays: Array, room: Room, faces: dict[tuple[int, int], Image]) -> Image:
    """Colour (N, 3) of the inner faces that rays (3, N) from inside the room meet."""
    bounds = np.array(
        [*([c - half, c + half] for c, half in zip(room.centre, room.half, strict=True)), [0, room.height]]
    )
    side = (rays > 0).astype(int)
    reach = np.stack([(bounds[k][side[k]] - origin[k]) / rays[k] for k in range(3)])
    axis = reach.argmin(axis=0)
    hits = origin + reach.min(axis=0) * rays - bounds[:, :1]
    colours = np.zeros((rays.shape[1], 3), dtype=np.uint8)
    for (normal, which), texture in faces.items():
        met = np.flatnonzero((axis == normal) & (side[normal] == which))
        u, v = (k for k in range(3) if k != normal)
        colours[met] = _texels(texture, hits[u, met] * room.texel, hits[v, met] * room.texel)
    return colours


def _cast_box(origin: Array, rays: Array, box: _Box, colours: Image, nearest: Array) -> None:
    """Paints the pixels whose rays (3, N) meet a box before anything nearer."""
    low, high, texture = box[0][:, None], box[1][:, None], box[2]
    first, second = (low - origin) / rays, (high - origin) / rays
    entry, leave = np.minimum(first, second), np.maximum(first, second).min(axis=0)
    axis, reach = entry.argmax(axis=0), entry.max(axis=0)
    met = np.flatnonzero((reach < leave) & (reach > 0) & (reach < nearest))
    where = (origin + reach[met] * rays[:, met] - low) / (high - low) * 159
    across = np.where(axis[met] == 0, 1, 0)
    upward = np.where(axis[met] == 2, 1, 2)
    column = np.arange(len(met))
    shade = np.array([0.75, 0.9, 1.1])[axis[met], None]
    texels = _texels(texture, where[across, column], where[upward, column])
    colours[met] = np.clip(texels * shade, 0, 255).astype(np.uint8)
    nearest[met] = reach[met]


def _texels(texture: Image, columns: Array, rows: Array) -> Image:
    u = np.clip(columns.astype(int), 0, texture.shape[1] - 1)
    v = np.clip(rows.astype(int), 0, texture.shape[0] - 1)
    picked: Image = texture[v, u]
    return picked
