"""Drawing parts with pyrender, which is loaded on first use, silently, and on one platform."""

from __future__ import annotations

import os
import sys
import threading
import warnings
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Image, Integers
from tracker.foundation.errors import RenderError
from tracker.foundation.geometry.superquadric_meshes import Meshes
from tracker.synthesis._graphics import library, unusable
from tracker.synthesis._meshes import NEAREST_M
from tracker.synthesis._pictures import Picture
from tracker.synthesis._pinhole import Pinhole, pinhole_of

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
        yield library("pyrender", "osmesa")


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
