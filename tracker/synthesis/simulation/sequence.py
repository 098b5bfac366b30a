"""Synthetic recordings in memory: what they show, and their frames with exact truth."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import tomli_w

from tracker.bodies.body.description import save_description
from tracker.bodies.scene import Person, Scene
from tracker.bodies.subject import Subject
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import save_rig
from tracker.foundation.arrays import Array, Array32, Image
from tracker.foundation.errors import ConfigError
from tracker.foundation.files import whole_folder
from tracker.foundation.progress import Progress, silent
from tracker.foundation.resources import model_path
from tracker.images.film import film_writer
from tracker.images.plate import Plate
from tracker.synthesis.simulation.movements import movement_of, poses_of
from tracker.synthesis.simulation.rendering import Mesh, draw_persons, mesh_of
from tracker.synthesis.simulation.room import Room, background_plates, default_rig, room_around

# Of an exposure: a hand at 5 m/s goes 13 mm between two of them in a fiftieth of a second, two pixels of a room.
_MOMENTS = 8


@dataclass(frozen=True)
class Recipe:
    """Content of a simulated recording."""

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
    """Brightness, usually 1; noise and blur stay."""

    exposure_s: float = 0.0
    """Shutter time, around a frame's time; movements meanwhile are blurred. 0: no time at all."""

    delays_s: tuple[float, ...] = ()
    """Delay of each view; empty for cameras in step."""

    repeats_from: tuple[int | None, ...] = ()
    """Number of the frame from which on each view shows the frame before; None for none, empty for no view."""

    constant_rate_factor: int = 14
    """Of the videos' compression, 0 to 51: of 14 nothing is seen, 23 is usual, 35 coarse."""

    wardrobe: int = 0
    """Clothes of the first person, and the next ones from there on: 2 are of one dark colour."""

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


@lru_cache(maxsize=16)
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


# Synthetic recordings as folders: videos, plates, rig, model, exact truth and a ready configuration.


def write_sequence(recipe: Recipe, folder: Path, progress: Progress = silent) -> Path:
    """Writes a recording to a folder, complete or not at all.

    The folder holds `{view}.mp4`, `background/{view}.png`, `rig.toml`, `model.toml`, `truth_poses.csv`,
    `truth_joints.csv` and a ready `config.toml`.

    Args:
        recipe: what to simulate.
        folder: must not exist, or be empty.
        progress: gets the progress.

    Returns:
        The path of `config.toml`.

    Raises:
        ConfigError: the folder holds something.
    """
    with whole_folder(folder) as unfinished:
        fill_folder(simulate(recipe), unfinished, unfinished / "config.toml", progress)
    return folder / "config.toml"


def fill_folder(simulation: Simulation, folder: Path, config: Path, progress: Progress = silent) -> None:
    """Writes a recording as `write_sequence` does, into a folder that is there.

    Args:
        simulation: what to write.
        folder: where to.
        config: name of its configuration, in the folder.
        progress: gets the progress.
    """
    _write_plates(simulation, folder / "background")
    _write_videos(simulation, folder, progress)
    save_rig(simulation.scene.rig, folder / "rig.toml")
    description = simulation.recipe.subject.description()
    if simulation.recipe.stature_m is None and description.skin is None:
        shutil.copyfile(simulation.recipe.model_file, folder / "model.toml")
    else:
        save_description(description, folder / "model.toml", decimals=None)
    _write_truth(simulation, folder)
    _write_config(simulation, config)


def _write_plates(simulation: Simulation, folder: Path) -> None:
    folder.mkdir()
    for v, (name, plate) in enumerate(zip(simulation.scene.rig.names, simulation.plates, strict=True)):
        _, content = cv2.imencode(".png", sensed(plate.picture, simulation.recipe, (1_000_000, v)))
        (folder / f"{name}.png").write_bytes(content.tobytes())


def _write_videos(simulation: Simulation, folder: Path, progress: Progress) -> None:
    recipe, total = simulation.recipe, len(simulation.recipe.times)
    # the macroblock tree of x264 reads memory that nobody has written: the same pictures become other videos
    options = {"crf": str(recipe.constant_rate_factor), "preset": "veryfast", "x264-params": "mbtree=0"}
    with ExitStack() as films:
        names = simulation.scene.rig.names
        adds = [films.enter_context(film_writer(folder / f"{name}.mp4", recipe.fps, **options)) for name in names]
        for frame in simulation.frames():
            for add, image in zip(adds, frame.images, strict=True):
                if image is not None:
                    add(image)
            progress("simulating", frame.index + 1, total)


def _write_truth(simulation: Simulation, folder: Path) -> None:
    with (
        (folder / "truth_poses.csv").open("w", newline="") as poses_file,
        (folder / "truth_joints.csv").open("w", newline="") as joints_file,
    ):
        poses, joints = csv.writer(poses_file), csv.writer(joints_file)
        columns = [parameter.column for parameter in simulation.scene.persons[0].body.parameters]
        poses.writerow(["frame", "time_s", "person", "status", "distance_px", *columns])
        joints.writerow(["frame", "time_s", "person", "joint", "x_m", "y_m", "z_m"])
        for t, time_s in enumerate(simulation.recipe.times):
            for person, truth in zip(simulation.scene.persons, simulation.poses, strict=True):
                shown = np.where(person.body.rotates, np.degrees(truth[t]), truth[t])
                poses.writerow([t, f"{time_s:.6f}", person.name, "true", 0, *(f"{value:.6f}" for value in shown)])
                placed = person.body.landmarks_in_world(truth[t])
                for name, point in zip(person.body.landmark_names, placed, strict=True):
                    joints.writerow([t, f"{time_s:.6f}", person.name, name, *(f"{value:.6f}" for value in point)])


def _write_config(simulation: Simulation, path: Path) -> None:
    reading = {"use": "video", "path": "{view}.mp4", "rig": "rig.toml", "background": "background/{view}.png"}
    persons = [{"name": person.name, "model": "model.toml"} for person in simulation.scene.persons]
    name, _ = movement_of(simulation.recipe.movement, simulation.scene.persons[0].body)
    table = {"name": name, "reading": reading, "persons": persons}
    path.write_bytes(tomli_w.dumps(table).encode())
