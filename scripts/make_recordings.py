"""Makes recordings of movements that nothing was built on: scanned persons who move as motion files do.

Two persons of BODYTRACK_DATA/room, rigged from their scans, do what DeepMimic's and CMU's files show, rendered into the
empty rooms of other recordings there, with exact truth:

    python scripts/make_recordings.py /tmp/other
    BODYTRACK_DATA=/tmp/other python scripts/benchmark.py recordings --models human --starts 1

`--under` films them in another way: with a slow shutter, in clothes of one colour, by fewer cameras, ...
"""

from __future__ import annotations

import itertools
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from benchmarks.carried import laden
from benchmarks.clips import CLIPS, Clip, names_of, others
from benchmarks.films import CONDITIONS, Condition
from benchmarks.furniture import chair_below, cupboards, furnished
from benchmarks.laboratory import laboratory_poses
from benchmarks.motion_files import MotionFile, read_cmu, read_deepmimic
from benchmarks.moved_scans import poses_like
from benchmarks.refilmed import grey, grey_plates, refilmed
from benchmarks.rooms import filmed_with, picture_of, placed, turned_cameras

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body, read_description
from tracker.bodies.scene import Person, Scene
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig, save_rig
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.tables import read_config
from tracker.foundation.errors import ConfigError, TrackerError, nearest
from tracker.foundation.files import whole_folder
from tracker.foundation.progress import Progress
from tracker.images.plate import Plate
from tracker.running.commands import ProgressBar, print_error
from tracker.running.jobs.acquire import acquire_to, acquisition_from
from tracker.synthesis.simulation.sequence import Recipe, Simulation, fill_folder

# Between the joints of any two persons, metres.
_LEAST_APART_M = 0.3
_SCANS = {"theo": "R-Turn", "rita": "R-UpperBody"}


def main(
    output: Annotated[Path, typer.Argument(help="Folder to fill; recordings that are there already stay.")],
    only: Annotated[str, typer.Option(help="Part of the names of those to make.")] = "",
    under: Annotated[str, typer.Option(help=f"How they are filmed: {', '.join(CONDITIONS)}.")] = "usual",
) -> None:
    """Renders the recordings."""
    try:
        chosen = {name: clip for name, clip in CLIPS.items() if only in name}
        if not chosen:
            raise ConfigError(f"--only {only}: no such recording; {nearest(only, CLIPS)}")
        if under not in CONDITIONS:
            raise ConfigError(f"--under {under}: no such way; {nearest(under, CONDITIONS)}")
        if not os.environ.get("BODYTRACK_DATA"):
            raise ConfigError("BODYTRACK_DATA is not set: expected the folder with motions, scans and empty rooms")
        data = Path(os.environ["BODYTRACK_DATA"]).resolve()
        with ProgressBar() as progress:
            for name, clip in chosen.items():
                folder = output / (name if under == "usual" else f"{name}_{under}")
                if not folder.exists():
                    _make(clip, CONDITIONS[under], data, folder, progress)
    except (TrackerError, OSError) as error:
        print_error(error)
        raise typer.Exit(2) from None


def _make(clip: Clip, condition: Condition, data: Path, folder: Path, progress: Progress) -> None:
    """Writes one recording, complete or not at all."""
    clips = (clip, *others(clip, condition.n_others))
    names = names_of(clips)
    models = tuple(_scanned(one.person, data, folder.parent) for one in clips)
    simulation = _simulated(clips, condition, models, data)
    told = [
        {"subject": name, "id": name, "height_m": read_description(model).stature_m}
        for name, model in zip(names, models, strict=True)
    ]
    told = told if condition.tells_of_all else told[:1]
    with whole_folder(folder) as unfinished:
        fill_folder(simulation, unfinished, unfinished / "config.toml", progress)
        if condition.change is grey:
            grey_plates(unfinished / "background")
        save_rig(turned_cameras(simulation.scene.rig, condition.turned_deg), unfinished / "rig.toml")
        (unfinished / "meta.json").write_text(json.dumps({"people": told}), encoding="utf-8")
        if len(clips) > 1:
            (unfinished / "config.toml").unlink()  # it has the first one's model for all
        if condition.n_boxes:
            _write_occluders(simulation, unfinished / "occluders")


def _write_occluders(simulation: Simulation, folder: Path) -> None:
    """What stands before the first person all the time as a user paints it, a little larger than it is."""
    folder.mkdir()
    places = simulation.scene.persons[0].body.landmarks_in_world(simulation.poses[0]).mean(axis=1)
    for camera, away_m in zip(simulation.scene.rig.cameras, simulation.away_m, strict=True):
        front = away_m < camera.in_camera(places)[:, 2].min()
        grown = cv2.dilate(front.astype(np.uint8), np.ones((5, 5), np.uint8))
        cv2.imwrite(str(folder / f"{camera.name}.png"), 255 * grown)


def _scanned(name: str, data: Path, output: Path) -> Path:
    """The model file of a person, rigged from a scan."""
    path = output / "models" / f"{name}.toml"
    if not path.exists():
        scan = data / "room" / _SCANS[name] / "surface"
        told = {"surface": scan / "scan.ply", "weights": scan / "rigging.npz", "joints": scan / "joints.json"}
        path.parent.mkdir(parents=True, exist_ok=True)
        config = path.with_name(f"{name}_scan.toml")
        lines = [f'name = "{name}"', 'model = "human"', "[scan]", *(f'{key} = "{file}"' for key, file in told.items())]
        config.write_text("\n".join(lines) + "\n")
        acquire_to(acquisition_from(read_config(config, []), config.name, config.parent, name), path)
    return path


def _simulated(clips: tuple[Clip, ...], condition: Condition, models: tuple[Path, ...], data: Path) -> Simulation:
    folder = data / "room" / clips[0].room
    room = load_rig(folder / "calibration.json")
    pictures = [picture_of(folder / "background" / f"{one.name}.jpg", one.size) for one in room.cameras]
    if condition.standpoints:
        room, pictures = placed(room, pictures, condition.standpoints)
    films = [
        filmed_with(camera, picture, condition.downscale, condition.zoom)
        for camera, picture in zip(room.cameras[: condition.n_views], pictures, strict=False)
    ]
    rig = Rig(tuple(camera for camera, _ in films))
    bodies = [load_body(model) for model in models]
    filmed = condition.filmed
    poses = _side_by_side([_poses(*one, filmed.fps, data) for one in zip(clips, models, strict=True)], bodies)
    for one, body in zip(poses, bodies, strict=True):
        one[:, _on_floor(body)] += room.middle[:2]
    boxes = cupboards(rig, condition.n_boxes, poses[0][:, _on_floor(bodies[0])])
    if condition.sits:
        boxes += chair_below(bodies[0], poses[0][0])
    pictures, away_m = furnished([picture for _, picture in films], rig, boxes)
    recipe = replace(
        filmed,
        model=str(models[0]),
        rig=rig,
        seconds=len(poses[0]) / filmed.fps,
        delays_s=filmed.delays_s[: len(rig)],
        repeats_from=(len(poses[0]) // 2, *[None] * (len(rig) - 1)) if condition.repeats else (),
    )
    persons = tuple(Person(name, body, one[0]) for name, body, one in zip(names_of(clips), bodies, poses, strict=True))
    simulation = Simulation(recipe, Scene(persons, rig), tuple(poses), tuple(map(Plate, pictures)), away_m)
    if condition.carried is not None:
        simulation = laden(simulation, condition.carried)
    return simulation if condition.change is None else refilmed(simulation, condition.change)


def _side_by_side(poses: list[Array], bodies: list[BodyModel]) -> list[Array]:
    """The movements as long as the shortest one, in a ring as narrow as no joints meet."""
    if len(poses) == 1:
        return poses
    poses = [one[: min(map(len, poses))].copy() for one in poses]
    joints = [body.landmarks_in_world(one) for body, one in zip(bodies, poses, strict=True)]
    angles = np.pi / 2 + 2 * np.pi * np.arange(len(poses)) / len(poses)
    ways = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(poses))], axis=1)
    for radius_m in np.arange(0.3, 1.5, 0.05):
        moved = [one + radius_m * way for one, way in zip(joints, ways, strict=True)]
        if all(_apart_m(one, other) > _LEAST_APART_M for one, other in itertools.combinations(moved, 2)):
            break
    for one, body, way in zip(poses, bodies, ways, strict=True):
        one[:, _on_floor(body)] += radius_m * way[:2]
    return poses


def _apart_m(one: Array, other: Array) -> float:
    """Between the nearest joints (T, L, 3) of two persons at any time."""
    return float(np.linalg.norm(one[:, :, None] - other[:, None], axis=-1).min())


def _on_floor(body: BodyModel) -> list[int]:
    """Parameters of where it is."""
    return [body.names.index("torso_x"), body.names.index("torso_y")]


def _poses(clip: Clip, model: Path, fps: float, data: Path) -> Array:
    """Solved at the usual rate or more: what a joint may do from a frame to the next is told for that."""
    if clip.movement:
        return laboratory_poses(clip.movement, model, fps, clip.heading_deg)
    body = load_body(model)
    file = data / "motions" / clip.file
    motion = (read_cmu if file.suffix == ".amc" else read_deepmimic)(file).part(clip.from_s, clip.to_s)
    every = max(1, round(Recipe.fps / fps))
    poses = poses_like(_turned(motion, clip.heading_deg), body, fps * every)[::every]
    if clip.ahead_m:
        place = poses[:, _on_floor(body)]
        way = place[-1] - place[0]
        poses[:, _on_floor(body)] += clip.ahead_m * way / np.linalg.norm(way) - place.mean(axis=0)
    still: Array = np.repeat(poses[:1], round(clip.waits_s * fps), axis=0)
    return np.concatenate([still, poses])


def _turned(motion: MotionFile, degrees: float) -> MotionFile:
    """Turned about the vertical."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return MotionFile(motion.times_s, motion.joints @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T)


if __name__ == "__main__":
    typer.run(main)
