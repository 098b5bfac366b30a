"""Reference pictures by pyrender: an independent renderer to hold the others against, and shaded figures."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
import warnings
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Image, Integers
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import RenderError
from tracker.foundation.geometry.superquadrics import Meshes, meshes_of
from tracker.synthesis._graphics import PictureSynthesis, library, unusable
from tracker.synthesis._pictures import NEAREST_M, Picture, before_cameras

# What every GL 4.3 can draw.
_LARGEST_PX = 8192


@dataclass(frozen=True)
class Pinhole:
    """A pinhole view with the centre and axes of a camera, and where it shows the camera's pixels."""

    size: tuple[int, int]
    """Width and height, px."""

    intrinsics: tuple[float, float, float, float]
    """fx, fy, cx, cy, px; pixel centres at integers."""

    positions: Array
    """(H, W, 2) x, y in the pinhole view of each pixel of the camera, px."""

    @property
    def nearest(self) -> tuple[Integers, Integers]:
        """Rows and columns (H, W) of the pinhole view's pixels nearest to the camera's."""
        rounded = np.rint(self.positions).astype(np.int64)
        columns, rows = (np.clip(rounded[..., i], 0, self.size[i] - 1) for i in range(2))
        return rows, columns


_CACHE: OrderedDict[tuple[bytes, bytes, tuple[int, int], int], Pinhole] = OrderedDict()


def pinhole_of(camera: Camera, enlarged: int) -> Pinhole:
    """The pinhole view around a camera's image, `enlarged` times as fine; kept for the cameras last used.

    Less fine where it would be larger than what can be drawn: 120 degrees of a lens fill 9300 px at 1920.
    """
    key = camera.matrix.tobytes(), camera.distortion.tobytes(), camera.size, enlarged
    if key not in _CACHE:
        _CACHE[key] = _around(camera, enlarged)
        while len(_CACHE) > 16:
            _CACHE.popitem(last=False)
    return _CACHE[key]


def _around(camera: Camera, enlarged: int) -> Pinhole:
    width, height = camera.size
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    pixels = np.stack([columns, rows], axis=-1)
    if camera.distortion.any() or camera.matrix[0, 1] != 0:
        plane, focal = camera.undistort(pixels), enlarged * np.diag(camera.matrix)[:2]
        spans = focal * (np.nanmax(plane, axis=(0, 1)) - np.nanmin(plane, axis=(0, 1)))
        focal *= min(1.0, (_LARGEST_PX - 4) / float(spans.max()))
        positions = plane * focal
        low = np.floor(np.nanmin(positions, axis=(0, 1))) - 1
        # what the lens images nothing to shows a corner beside all that it images
        positions = np.where(np.isfinite(positions), positions, low)
        extent = np.ceil(positions.max(axis=(0, 1)) - low) + 2
        shift = -low
    else:
        # a pixel becomes a square of pixels
        enlarged = max(min(enlarged, _LARGEST_PX // max(width, height)), 1)
        focal = enlarged * np.diag(camera.matrix)[:2]
        shift = (camera.matrix[:2, 2] + 0.5) * enlarged - 0.5
        positions = (pixels + 0.5) * enlarged - 0.5 - shift
        extent = np.array([enlarged * width, enlarged * height])
    size = np.minimum(extent, _LARGEST_PX).astype(np.int64).tolist()
    fx, fy, cx, cy = (float(value) for value in (*focal, *shift))
    return Pinhole((size[0], size[1]), (fx, fy, cx, cy), positions + shift)


# Farther than the far wall of a gym.
_FARTHEST_M = 60.0
# OpenGL's camera looks along -z, with y up.
_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
# Times the pixels of the image, so that the lens can be bent afterwards.
_FINE = 2


@dataclass(frozen=True)
class Drawing:
    """What a picture is to show."""

    meshes: Meshes
    placements: Array
    """(P, 4, 4) world_from_part, metres."""

    shown: Integers
    """Numbers of the parts to draw."""

    camera: Camera


def drawn(drawing: Drawing, platform: str) -> Picture:
    """The whole image with part numbers and depths.

    Raises:
        RenderError: pyrender cannot work here.
    """
    bent = bool(drawing.camera.distortion.any()) or drawing.camera.matrix[0, 1] != 0
    pinhole = pinhole_of(drawing.camera, _FINE if bent else 1)
    with _pyrender(platform) as pyrender:
        scene, nodes = _scene(pyrender, drawing, pinhole)
        # flat colours are neither lit nor blended: red and green hold the number, counted from 1
        colours = {node: [(p + 1) % 256, (p + 1) // 256, 0] for p, node in zip(drawing.shown, nodes, strict=True)}
        colour, depths = _rendered(pyrender, pinhole.size, scene, pyrender.RenderFlags.SEG, colours)
    ids = colour[..., :2].astype(np.int64) @ (1, 256) - 1
    rows, columns = pinhole.nearest
    return Picture(ids[rows, columns], np.ascontiguousarray(depths[rows, columns], dtype=np.float32))


def shaded(drawing: Drawing, platform: str) -> Image:
    """A lit picture (H, W, 3) RGB on white.

    Raises:
        RenderError: pyrender cannot work here.
    """
    pinhole = pinhole_of(drawing.camera, _FINE)
    with _pyrender(platform) as pyrender:
        scene, _ = _scene(pyrender, drawing, pinhole)
        light = pyrender.DirectionalLight(color=np.ones(3), intensity=3.0)
        scene.add(light, pose=_pose(drawing.camera))
        colour, _ = _rendered(pyrender, pinhole.size, scene, pyrender.RenderFlags.NONE, None)
    x, y = (pinhole.positions[..., i].astype(np.float32) for i in range(2))
    softened = cv2.blur(np.ascontiguousarray(colour), (_FINE, _FINE), anchor=(0, 0))
    picture: Image = cv2.remap(softened, x - 0.5, y - 0.5, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return picture


def _scene(pyrender: Any, drawing: Drawing, pinhole: Pinhole) -> tuple[Any, list[Any]]:
    """A scene as pyrender has it, and its nodes of the parts shown."""
    scene = pyrender.Scene(bg_color=np.ones(4), ambient_light=0.35 * np.ones(3))
    nodes = []
    for p in drawing.shown:
        material = pyrender.MetallicRoughnessMaterial(
            baseColorFactor=(*_colour(int(p)), 1.0), metallicFactor=0.0, roughnessFactor=0.8
        )
        points, normals = (a[p].astype(np.float32) for a in (drawing.meshes.points, drawing.meshes.normals))
        indices = drawing.meshes.triangles.astype(np.uint32)
        primitive = pyrender.Primitive(positions=points, normals=normals, indices=indices, material=material, mode=4)
        nodes.append(scene.add(pyrender.Mesh([primitive]), pose=drawing.placements[p]))
    fx, fy, cx, cy = pinhole.intrinsics
    # a pixel's centre is an integer here and a half there
    lens = pyrender.IntrinsicsCamera(fx, fy, cx + 0.5, cy + 0.5, znear=NEAREST_M, zfar=_FARTHEST_M)
    scene.add(lens, pose=_pose(drawing.camera))
    return scene, nodes


def _pose(camera: Camera) -> Array:
    """World from camera in OpenGL's axes: y up, looking along -z."""
    return np.asarray(np.linalg.inv(camera.camera_from_world) @ _FROM_OPENGL, dtype=np.float64)


def _colour(part: int) -> tuple[float, float, float]:
    """A colour that differs from those of neighbouring numbers."""
    hue = int(180 * (0.618034 * part % 1.0))
    r, g, b = cv2.cvtColor(np.array([[[hue, 150, 190]]], dtype=np.uint8), cv2.COLOR_HSV2RGB)[0, 0].tolist()
    return r / 255, g / 255, b / 255


_HELD = threading.local()


def _rendered(pyrender: Any, size: tuple[int, int], scene: Any, flags: int, colours: Any) -> tuple[Any, Any]:
    """Colours (h, w, 3) and depths (h, w) of a picture; contexts are kept for the sizes last used."""
    # a context belongs to a thread and does not survive a fork
    if getattr(_HELD, "process", None) != os.getpid():
        _HELD.process, _HELD.renderers = os.getpid(), OrderedDict()
    renderers: OrderedDict[tuple[int, int], Any] = _HELD.renderers
    if size not in renderers:
        try:
            renderers[size] = pyrender.OffscreenRenderer(*size)
        except Exception as error:
            raise unusable("osmesa", error) from error
        while len(renderers) > 8:
            renderers.popitem(last=False)[1].delete()
    colour, depths = renderers[size].render(scene, flags, colours)
    return colour, depths


@contextmanager
def _pyrender(platform: str) -> Iterator[Any]:
    """The library on a platform, its warnings silenced."""
    _claim(platform)
    # pyrender 0.1 still asks for the name that numpy 2 dropped
    vars(np).setdefault("infty", np.inf)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pyrender = library("pyrender", "osmesa")
        if platform == "osmesa":
            # as a number: a pointer is another object at each call, and shaders would be compiled anew for each part
            sys.modules["OpenGL.platform"].PLATFORM.GetCurrentContext.restype = ctypes.c_void_p
        yield pyrender


def _claim(platform: str) -> None:
    """PyOpenGL chooses its platform once, when it is imported."""
    loaded = getattr(sys.modules.get("OpenGL.platform"), "PLATFORM", None)
    found = type(loaded).__name__.removesuffix("Platform").lower()
    if loaded is not None and found != platform:
        raise RenderError(
            f'synthesis "osmesa": platform = "{platform}" was asked for, but PyOpenGL already works through {found} '
            "in this process; start another one"
        )
    os.environ["PYOPENGL_PLATFORM"] = platform


@component
class OsmesaSynthesis(PictureSynthesis):
    """Pictures of part numbers by pyrender; slow. Distorted views are looked up in enlarged undistorted pictures."""

    platform: Literal["osmesa", "egl"] = "osmesa"
    """How pyrender reaches OpenGL: in memory or through EGL. A process can use one of them only."""

    def picture(self, scene: Scene, view: int) -> Image:
        """A shaded picture (H, W, 3) RGB of the scene in a view, every part in a colour of its own, on white."""
        return shaded(self._drawing(scene, scene.world_from_parts()[0], view), self.platform)

    def _pictures(self, scene: Scene, placements: Array) -> list[list[Picture]]:
        views = range(len(scene.rig))
        return [[drawn(self._drawing(scene, placed, v), self.platform) for v in views] for placed in placements]

    def _drawing(self, scene: Scene, placements: Array, view: int) -> Drawing:
        meshes = meshes_of(scene.shapes, self.n_eta, self.n_omega)
        shown = before_cameras(scene, placements[None], meshes.widths)[0, view]
        return Drawing(meshes, placements, np.flatnonzero(shown), scene.rig.cameras[view])
