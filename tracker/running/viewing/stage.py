"""The scene in space: the floor, the cameras with their images, the bodies."""

from __future__ import annotations

import contextlib
import importlib
import io
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tracker.bodies.body.surface import segments_in_world, surface_of
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import ConfigError
from tracker.tracking.estimate import Estimate, Status

LOOPBACK = "127.0.0.1"
"""Address of this machine only: the pictures show persons."""


@contextlib.contextmanager
def serving(port: int, wide: bool = False) -> Iterator[Any]:
    """A viser server on the loopback address, while it is used; on the next free port if this one is taken.

    Args:
        port: of the address.
        wide: whether the controls need much room.

    Raises:
        ConfigError: viser is not installed, or no port is free.
    """
    try:
        viser: Any = importlib.import_module("viser")
    except ImportError as error:
        raise ConfigError("bodytrack view needs the Python package viser: pip install viser") from error
    try:
        with _quiet():
            server = viser.ViserServer(host=LOOPBACK, port=port, label="bodytrack", verbose=False)
    except (OSError, RuntimeError) as error:
        raise ConfigError(f"--port {port}: cannot be listened to: {error}") from error
    # the button would open a tunnel to outside
    server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large" if wide else "medium")
    server.scene.set_up_direction("+z")
    try:
        yield server
    finally:
        with _quiet():
            server.stop()


def _quiet() -> contextlib.redirect_stdout[io.StringIO]:
    """Keeps viser from printing, which it does even if it is told not to."""
    return contextlib.redirect_stdout(io.StringIO())


BLUE, PALE, ORANGE, RED, GREY = (74, 134, 232), (150, 185, 235), (240, 140, 40), (220, 50, 50), (150, 150, 150)
"""Red, green, blue of sure, filled-in, unsure and lost bodies, and of other things."""

_N_ETA, _N_OMEGA = 9, 12
"""Latitudes and longitudes of a part's mesh, as in the report."""

_FRUSTUM_SHARE = 0.08
"""Length of a drawn camera over its distance from the middle of all of them."""


class Stage:
    """The nodes of a viser scene, called `/cameras/NAME` and `/persons/NAME/PART`; z is up, metres."""

    def __init__(self, server: Any, scene: Scene) -> None:
        self._server = server
        server.scene.add_grid("/floor", width=10, height=10, cell_size=0.5, cell_color=(225, 225, 225))
        _enter(server, scene)
        self._cameras = [_camera(server, camera, scene) for camera in scene.rig.cameras]
        self._persons: tuple[Person, ...] = ()
        self.embody(scene.persons)

    def embody(self, persons: tuple[Person, ...]) -> None:
        """Makes the bodies anew if they differ: a run fits them before its first frame."""
        if [id(one.body) for one in persons] != [id(one.body) for one in self._persons]:
            self._bodies = [_body(self._server, person) for person in persons]  # nodes of the same name are replaced
            self._persons = persons

    def show(self, estimates: Sequence[Estimate]) -> None:
        """Poses the bodies; lost persons are hidden."""
        for person, meshes, estimate in zip(self._persons, self._bodies, estimates, strict=True):
            _place(person, meshes, estimate.q)
            for mesh, colour in zip(meshes, colours_of_doubt(person, estimate), strict=True):
                mesh.visible, mesh.color = not estimate.lost, colour

    def pose(self, poses: Sequence[Array]) -> None:
        """Poses the bodies at given poses (dof,), without doubts."""
        for person, meshes, q in zip(self._persons, self._bodies, poses, strict=True):
            _place(person, meshes, q)
            for mesh in meshes:
                mesh.visible = True

    def show_images(self, images: Sequence[Image | None]) -> None:
        """Puts an image (h, w, 3) BGR, or none, before each camera."""
        for camera, image in zip(self._cameras, images, strict=True):
            camera.image = None if image is None else image[..., ::-1]


def _place(person: Person, meshes: Sequence[Any], q: Array) -> None:
    """Puts the parts of a person where a pose (dof,) has them."""
    placed = segments_in_world(person.body, q)
    turns = _wxyz(placed[:, :3, :3])
    for mesh, segment in zip(meshes, person.body.segments_of_parts, strict=True):
        mesh.position, mesh.wxyz = placed[segment, :3, 3], turns[segment]


def colours_of_doubt(person: Person, estimate: Estimate) -> list[tuple[int, int, int]]:
    """The colour (red, green, blue) of each part: doubtful persons and ambiguous limbs are orange."""
    usual = PALE if estimate.status is Status.FILLED else ORANGE if estimate.doubtful else BLUE
    colours = [usual for _ in person.body.parts]
    for group in estimate.ambiguous:
        for p in np.flatnonzero(person.body.parts_of(group)):
            colours[p] = ORANGE
    return colours


def _enter(server: Any, scene: Scene) -> None:
    """First viewpoint of a visitor: behind the first two cameras and above them, facing the middle."""
    centres = np.array([camera.centre for camera in scene.rig.cameras])
    middle = np.append(centres[:, :2].mean(axis=0), 0.9)
    outwards = centres[:2].mean(axis=0) - middle
    outwards /= max(float(np.linalg.norm(outwards[:2])), 1e-6)
    reach = float(np.linalg.norm(centres - middle, axis=1).max())
    server.initial_camera.position = middle + 1.1 * reach * np.array([outwards[0], outwards[1], 0.6])
    server.initial_camera.look_at = middle


def _body(server: Any, person: Person) -> list[Any]:
    """A mesh for each part, in the axes of its segment."""
    surface, meshes = surface_of(person.body, _N_ETA, _N_OMEGA), []
    for p, part in enumerate(person.body.parts):
        used, corners = np.unique(surface.faces[surface.parts[surface.faces[:, 0]] == p], return_inverse=True)
        joint = person.body.segments[person.body.segments_of_parts[p]].joint
        mesh = server.scene.add_mesh_simple(
            f"/persons/{person.name}/{part.name}",
            (surface.points[used] - joint).astype(np.float32),
            corners.reshape(-1, 3).astype(np.uint32),
            color=BLUE,
            visible=False,
        )
        meshes.append(mesh)
    return meshes


def _camera(server: Any, camera: Camera, scene: Scene) -> Any:
    """A camera's pyramid; a click on it takes the visitor there."""
    centres = np.array([one.centre for one in scene.rig.cameras])
    reach = float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max()) or 1.0
    world_from_camera = np.linalg.inv(camera.camera_from_world)
    fov = 2 * float(np.arctan2(camera.size[1] / 2, camera.matrix[1, 1]))
    frustum = server.scene.add_camera_frustum(
        f"/cameras/{camera.name}",
        fov=fov,
        aspect=camera.size[0] / camera.matrix[0, 0] / (camera.size[1] / camera.matrix[1, 1]),
        scale=max(_FRUSTUM_SHARE * reach, 0.1),
        color=GREY,
        thickness=0.004,
        cast_shadow=False,
        receive_shadow=False,
        wxyz=_wxyz(world_from_camera[None, :3, :3])[0],
        position=camera.centre,
        format="jpeg",
    )

    def look_through(event: Any) -> None:
        visitor = event.client.camera
        with event.client.atomic():
            visitor.position, visitor.wxyz, visitor.fov = camera.centre, frustum.wxyz, fov

    frustum.on_click(look_through)
    server.scene.add_label(f"/cameras/{camera.name}/name", camera.name)
    return frustum


def _wxyz(turns: NDArray[np.floating]) -> Array:
    """Quaternions (N, 4), w first, of rotations (N, 3, 3)."""
    return np.asarray(Rotation.from_matrix(turns).as_quat(scalar_first=True), dtype=np.float64)
