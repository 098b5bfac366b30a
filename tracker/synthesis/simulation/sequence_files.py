"""Synthetic recordings as folders: videos, plates, rig, model, exact truth and a ready configuration."""

from __future__ import annotations

import csv
import shutil
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
import tomli_w

from tracker.bodies.body.files import save_description
from tracker.cameras.rig_layouts import save_rig
from tracker.foundation.files import whole_folder
from tracker.foundation.progress import Progress, silent
from tracker.images.picture_files import film_writer
from tracker.synthesis.simulation.movements import movement_of
from tracker.synthesis.simulation.sequence import Recipe, Simulation, sensed, simulate


def write_sequence(recipe: Recipe, folder: Path, progress: Progress = silent) -> Path:
    """Writes a recording to a folder, complete or not at all.

    The folder holds `{view}.mp4`, `background/{view}.png`, `rig.toml`, `model.toml`, `truth_poses.csv`,
    `truth_joints.csv` and a ready `config.toml`.

    Args:
        recipe: what to simulate.
        folder: must not exist, or be empty.
        progress: told how far it is.

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
        progress: told how far it is.
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
    options = {"crf": str(recipe.constant_rate_factor), "preset": "veryfast"}
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
