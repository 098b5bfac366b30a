"""Synthetic recordings in memory: what they show, and their frames with exact truth."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from tracker.bodies.scene import Person, Scene
from tracker.bodies.subject import Subject
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Array32, Image
from tracker.foundation.errors import ConfigError
from tracker.foundation.resources import model_path
from tracker.images.plate import Plate
from tracker.synthesis.simulation.movements import poses_of
from tracker.synthesis.simulation.rendering import Mesh, draw_persons, mesh_of
from tracker.synthesis.simulation.room import Room, background_plates, default_rig, room_around

# Of an exposure: a hand at 5 m/s goes 13 mm between two of them in a fiftieth of a second, two pixels of a room.
_MOMENTS = 8


@dataclass(frozen=True)
class Recipe:
    """What a simulated recording shows."""

    movement: str = ""
    """Name in the model's file; empty for the first one there."""

    model: str = "gavrila22"
    """Bundled body model, or the path of a model file."""

    seconds: float = 3.0
    fps: float = 25.0
    size: tuple[int, int] = (720, 576)
    """Image size of the usual cameras, px."""

    heading_deg: float = -40.0
    """Direction the first person faces at the start, degrees from the x axis."""

    persons: int = 1
    """Persons, 1.6 m apart."""

    noise_grey: float = 3.0
    """Standard deviation of the sensor noise, grey levels."""

    blur_px: float = 0.6
    """Standard deviation of the lens blur, px."""

    light: float = 1.0
    """How bright it is, usually 1; noise and blur stay."""

    exposure_s: float = 0.0
    """How long the shutter is open, around a frame's time; what moves meanwhile is smeared. 0: no time at all."""

    delays_s: tuple[float, ...] = ()
    """How much later than told each view sees a frame; empty for cameras in step."""

    repeats_from: tuple[int | None, ...] = ()
    """Number of the frame from which on each view shows the frame before; None for none, empty for no view."""

    constant_rate_factor: int = 14
    """Of the videos' compression, 0 to 51: of 14 nothing is seen, 23 is usual, 35 coarse."""

    wardrobe: int = 0
    """Which clothes the first person wears, and the next ones from there on: 2 are of one dark colour."""

    seed: int = 0

    rig: Rig | None = None
    """Cameras; None for four of `size` in the corners of the usual room."""

    stature_m: float | None = None
    """Height that the model is scaled to, metres; None leaves it as it is."""

    place: tuple[float, float] = (0.0, 0.0)
    """x and y of the root at the start, metres; of several persons, of their middle."""

    @property
    def subject(self) -> Subject:
        """Model and stature."""
        return Subject(model=self.model_file, stature_m=self.stature_m)

    @property
    def model_file(self) -> Path:
        """The model's file.

        Raises:
            ModelError: no bundled model of that name.
        """
        return Path(self.model) if self.model.endswith(".toml") else model_path(self.model)

    @property
    def times(self) -> Array:
        """(T,) seconds.

        Raises:
            ConfigError: it is too short for a frame.
        """
        n_frames = round(self.seconds * self.fps)
        if n_frames < 1:
            raise ConfigError(
                f"{self.seconds:g} s at {self.fps:g} frames per second: no frame, expected {1 / self.fps:g} s or more"
            )
        return np.arange(n_frames) / self.fps


@dataclass(frozen=True)
class Simulation:
    """A recording in memory: rig, plates and true poses; the images are made while they are iterated."""

    recipe: Recipe
    scene: Scene
    """The persons at their first poses."""

    poses: tuple[Array, ...]
    """True poses (T, dof) of each person, rad and m."""

    plates: tuple[Plate, ...]
    """Free of noise."""

    away_m: tuple[Array32, ...] = ()
    """Of each plate, (h, w) how far along the camera's axis what stands in the room is, metres, infinite where nothing
    does; empty where all is behind the persons."""

    def meshes(self) -> tuple[Mesh, ...]:
        """The surface of each person, dressed."""
        return tuple(mesh_of(person, self.recipe.wardrobe + k) for k, person in enumerate(self.scene.persons))

    def frames(self) -> Iterator[Frame]:
        """All frames; the same for the same seed."""
        meshes = self.meshes()
        n_views = len(self.scene.rig)
        with ThreadPoolExecutor(2) as pool:
            for t, time_s in enumerate(self.recipe.times):

                def image(v: int, t: int = t) -> Image:
                    plate, camera = self.plates[v].picture, self.scene.rig.cameras[v]
                    away_m = self.away_m[v] if self.away_m else None
                    moments = self._exposed(t, v)
                    drawn = [draw_persons(plate, camera, scene, meshes, away_m)[0] for scene in moments]
                    return sensed(_mean(drawn), self.recipe, (t, v))

                yield Frame(t, float(time_s), tuple(pool.map(image, range(n_views))))

    def _exposed(self, t: int, v: int) -> tuple[Scene, ...]:
        """The scene at moments of frame `t`'s exposure in view `v`; poses change evenly from one frame to the next."""
        recipe = self.recipe
        delay_s = recipe.delays_s[v] if recipe.delays_s else 0.0
        repeats_from = recipe.repeats_from[v] if recipe.repeats_from else None
        if repeats_from is not None and t >= repeats_from:
            delay_s -= 1 / recipe.fps
        if recipe.exposure_s == delay_s == 0:
            return (self.scene.with_poses(tuple(poses[t] for poses in self.poses)),)
        n_moments = _MOMENTS if recipe.exposure_s else 1
        within_s = ((np.arange(n_moments) + 0.5) / n_moments - 0.5) * recipe.exposure_s + delay_s
        moments = np.clip(t + within_s * recipe.fps, 0, len(recipe.times) - 1)
        before = np.minimum(moments.astype(int), max(len(recipe.times) - 2, 0))
        after, part = np.minimum(before + 1, len(recipe.times) - 1), (moments - before)[:, None]
        between = [(1 - part) * poses[before] + part * poses[after] for poses in self.poses]
        return tuple(self.scene.with_poses(tuple(poses[k] for poses in between)) for k in range(n_moments))


def simulate(recipe: Recipe) -> Simulation:
    """Prepares a recording.

    Raises:
        ConfigError: no such movement, or too short for a frame.
        ModelError: no such model.
    """
    body = recipe.subject.body()
    rig = recipe.rig or default_rig(recipe.size)
    poses = tuple(
        poses_of(recipe.movement, body, recipe.times, recipe.heading_deg + 35 * k, _place(k, recipe))
        for k in range(recipe.persons)
    )
    persons = tuple(Person(f"person{k + 1}", body, poses[k][0]) for k in range(recipe.persons))
    if recipe.rig is None:
        plates = _of_usual_room(recipe.size, recipe.seed)
    else:
        plates = _plates(rig, recipe.seed, room_around(rig, recipe.place))
    return Simulation(recipe, Scene(persons, rig), poses, plates)


@lru_cache(maxsize=4)
def _of_usual_room(size: tuple[int, int], seed: int) -> tuple[Plate, ...]:
    """Its plates, which many recordings have in common: four views of 720x576 take 4 s."""
    return _plates(default_rig(size), seed, Room())


def _plates(rig: Rig, seed: int, room: Room) -> tuple[Plate, ...]:
    return tuple(Plate(picture) for picture in background_plates(rig, seed, room))


def _place(k: int, recipe: Recipe) -> tuple[float, float]:
    x, y = recipe.place
    return x + 1.6 * (k - (recipe.persons - 1) / 2), y


def _mean(pictures: list[Image]) -> Image:
    """What a sensor gathers from moments of the same length."""
    if len(pictures) == 1:
        return pictures[0]
    gathered: Image = np.round(np.mean(pictures, axis=0, dtype=np.float32)).astype(np.uint8)
    return gathered


def sensed(picture: Image, recipe: Recipe, key: tuple[int, int]) -> Image:
    """The picture (h, w, 3) as a camera delivers it: as dark as it is there, blurred and noisy.

    Args:
        picture: what is before the camera.
        recipe: its light, blur, noise and seed.
        key: numbers of the frame and the view; each has noise of its own, the same for the same seed.
    """
    rng = np.random.default_rng((recipe.seed, *key))
    if recipe.light != 1:
        picture = cv2.convertScaleAbs(picture, alpha=recipe.light)
    if recipe.blur_px > 0:
        picture = cv2.GaussianBlur(picture, (0, 0), recipe.blur_px)
    if recipe.noise_grey > 0:
        noise = rng.standard_normal(picture.shape, dtype=np.float32)
        picture = cv2.convertScaleAbs(np.maximum(picture + recipe.noise_grey * noise, 0))
    return picture
