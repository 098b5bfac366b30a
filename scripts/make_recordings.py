"""Makes recordings of movements that nothing was built on: scanned persons who move as motion files do.

Two persons of BODYTRACK_DATA/room, rigged from their scans, do what DeepMimic's and CMU's files show, rendered into the
empty rooms of other recordings there, with exact truth:

    python scripts/make_recordings.py /tmp/other
    BODYTRACK_DATA=/tmp/other python scripts/benchmark.py recordings --models human --starts 1

`--under` films them in another way: with a slow shutter, in clothes of one colour, by fewer cameras, ...
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from benchmarks.motion_files import MotionFile, read_cmu, read_deepmimic
from benchmarks.moved_scans import poses_like
from rich.console import Console
from scipy.spatial.transform import Rotation

from tracker.arrays import Array, Image
from tracker.body import BodyModel
from tracker.body_files import load_body, read_description
from tracker.commands.terminal import ProgressBar
from tracker.config import read_config
from tracker.errors import ConfigError, SequenceError, TrackerError, nearest
from tracker.files import whole_folder
from tracker.jobs.acquire import acquire_to, acquisition_from
from tracker.plate import Plate
from tracker.progress import Progress
from tracker.rig import Rig
from tracker.rig_layouts import load_rig, save_rig
from tracker.scene import Person, Scene
from tracker.simulation.sequence import Recipe, Simulation, fill_folder


@dataclass(frozen=True)
class _Condition:
    """How it is filmed."""

    filmed: Recipe = field(default_factory=Recipe)
    """Whose rate, shutter, clothes, light, noise, delays and compression are taken."""

    n_views: int = 9
    """Of the rig's cameras, the first ones."""

    downscale: int = 1
    """Pixels of the room's pictures, in both directions, to one."""

    turned_deg: float = 0.0
    """By how much each camera was turned, some way, after it was calibrated."""


# The usual one films as the recordings of BODYTRACK_DATA/room are filmed.
_CONDITIONS = {
    "usual": _Condition(),
    "blurred": _Condition(Recipe(exposure_s=0.02)),
    "plain": _Condition(Recipe(wardrobe=2)),
    "three_views": _Condition(n_views=3),
    "two_views": _Condition(n_views=2),
    "half_rate": _Condition(Recipe(fps=12.5)),
    "double_rate": _Condition(Recipe(fps=50.0)),
    "small": _Condition(downscale=2),
    "grainy": _Condition(Recipe(noise_grey=6.0)),
    "noisy": _Condition(Recipe(noise_grey=10.0)),
    "dark": _Condition(Recipe(light=0.35)),
    "out_of_step": _Condition(Recipe(delays_s=(0.0, 0.013, -0.008, 0.019))),
    "compressed": _Condition(Recipe(constant_rate_factor=33)),
    "turned_cameras": _Condition(turned_deg=0.2),
}


@dataclass(frozen=True)
class _Clip:
    """What is done by whom and where."""

    file: str
    """Below `motions`."""

    person: str
    room: str
    """The recording whose empty room it is."""

    from_s: float = 0.0
    to_s: float = 60.0
    heading_deg: float = 0.0


# Chosen by their names and lengths, before any was tracked; kick, punch and walks are left out, for recordings of
# BODYTRACK_DATA/room show some.
_CLIPS = {
    "dance": _Clip("deepmimic/humanoid3d_dance_b.txt", "theo", "V-Dance"),
    "spinkick": _Clip("deepmimic/humanoid3d_spinkick.txt", "rita", "K-Kick", heading_deg=60),
    "cartwheel": _Clip("deepmimic/humanoid3d_cartwheel.txt", "theo", "N-Stride", 0.0, 2.12, 120),
    "jump": _Clip("deepmimic/humanoid3d_jump.txt", "rita", "V-Dance", heading_deg=-30),
    "roll": _Clip("deepmimic/humanoid3d_roll.txt", "theo", "K-Kick", heading_deg=30),
    "get_up_from_back": _Clip("deepmimic/humanoid3d_getup_faceup.txt", "rita", "P-Floor", heading_deg=90),
    "get_up_from_front": _Clip("deepmimic/humanoid3d_getup_facedown.txt", "theo", "N-Stride", heading_deg=-70),
    "crawl": _Clip("deepmimic/humanoid3d_crawl.txt", "rita", "V-Dance", heading_deg=150),
    "spin": _Clip("deepmimic/humanoid3d_spin.txt", "theo", "R-Turn", 0.0, 2.16),
    "martial_arts_1": _Clip("cmu/135_06-martialArts.amc", "theo", "K-Kick", 4.0, 6.4),
    "martial_arts_2": _Clip("cmu/135_06-martialArts.amc", "rita", "P-Floor", 12.0, 14.4, 45),
    "ballroom_1": _Clip("cmu/131_04-dance.amc", "rita", "N-Stride", 1.0, 3.4, 90),
    "ballroom_2": _Clip("cmu/131_04-dance.amc", "theo", "V-Dance", 5.0, 7.4, -120),
}
_SCANS = {"theo": "R-Turn", "rita": "R-UpperBody"}


def main(
    output: Annotated[Path, typer.Argument(help="Folder to fill; recordings that are there already stay.")],
    only: Annotated[str, typer.Option(help="Part of the names of those to make.")] = "",
    under: Annotated[str, typer.Option(help=f"How they are filmed: {', '.join(_CONDITIONS)}.")] = "usual",
) -> None:
    """Renders the recordings."""
    try:
        chosen = {name: clip for name, clip in _CLIPS.items() if only in name}
        if not chosen:
            raise ConfigError(f"--only {only}: no such recording; {nearest(only, _CLIPS)}")
        if under not in _CONDITIONS:
            raise ConfigError(f"--under {under}: no such way; {nearest(under, _CONDITIONS)}")
        if not os.environ.get("BODYTRACK_DATA"):
            raise ConfigError("BODYTRACK_DATA is not set: expected the folder with motions, scans and empty rooms")
        data = Path(os.environ["BODYTRACK_DATA"]).resolve()
        with ProgressBar() as progress:
            for name, clip in chosen.items():
                folder = output / (name if under == "usual" else f"{name}_{under}")
                if not folder.exists():
                    _make(clip, _CONDITIONS[under], data, folder, progress)
    except TrackerError as error:
        Console(stderr=True).print(f"[red]error:[/] {error}", soft_wrap=True)
        raise typer.Exit(2) from None


def _make(clip: _Clip, condition: _Condition, data: Path, folder: Path, progress: Progress) -> None:
    """Writes one recording, complete or not at all."""
    model = _scanned(clip.person, data, folder.parent)
    simulation = _simulated(clip, condition, model, data)
    told = {"subject": clip.person, "id": clip.person, "height_m": read_description(model).stature_m}
    with whole_folder(folder) as unfinished:
        fill_folder(simulation, unfinished, unfinished / "config.toml", progress)
        save_rig(_turned_cameras(simulation.scene.rig, condition.turned_deg), unfinished / "rig.toml")
        (unfinished / "meta.json").write_text(json.dumps({"people": [told]}), encoding="utf-8")


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


def _simulated(clip: _Clip, condition: _Condition, model: Path, data: Path) -> Simulation:
    folder = data / "room" / clip.room
    room = load_rig(folder / "calibration.json")
    rig = Rig(tuple(replace(one.downscaled(condition.downscale), downscale=1) for one in room.cameras))
    rig = rig.select(rig.names[: condition.n_views])
    body = load_body(model)
    filmed = condition.filmed
    poses = _poses(clip, body, filmed.fps, data)
    poses[:, [body.names.index("torso_x"), body.names.index("torso_y")]] += room.middle[:2]
    delays_s = filmed.delays_s[: len(rig)]
    recipe = replace(filmed, model=str(model), rig=rig, seconds=len(poses) / filmed.fps, delays_s=delays_s)
    plates = tuple(Plate(_picture(folder / "background" / f"{one.name}.jpg", one.size)) for one in rig.cameras)
    return Simulation(recipe, Scene((Person(clip.person, body, poses[0]),), rig), (poses,), plates)


def _turned_cameras(rig: Rig, degrees: float) -> Rig:
    """The rig as if each camera had been turned about an axis across its view since."""
    ways = np.random.default_rng(0).uniform(0, 2 * np.pi, len(rig))
    cameras = []
    for camera, way in zip(rig.cameras, ways, strict=True):
        motion = np.eye(4)
        motion[:3, :3] = Rotation.from_rotvec(
            degrees * np.array([np.cos(way), np.sin(way), 0]), degrees=True
        ).as_matrix()
        cameras.append(replace(camera, camera_from_world=motion @ camera.camera_from_world))
    return Rig(tuple(cameras))


def _poses(clip: _Clip, body: BodyModel, fps: float, data: Path) -> Array:
    """Solved at the usual rate or more: what a joint may do from a frame to the next is told for that."""
    file = data / "motions" / clip.file
    motion = (read_cmu if file.suffix == ".amc" else read_deepmimic)(file).part(clip.from_s, clip.to_s)
    every = max(1, round(Recipe.fps / fps))
    return poses_like(_turned(motion, clip.heading_deg), body, fps * every)[::every]


def _picture(path: Path, size: tuple[int, int]) -> Image:
    found = cv2.imread(str(path))
    if found is None:
        raise SequenceError(f"{path}: no picture of the empty room")
    return np.asarray(cv2.resize(found, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _turned(motion: MotionFile, degrees: float) -> MotionFile:
    """Turned about the vertical."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return MotionFile(motion.times_s, motion.joints @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T)


if __name__ == "__main__":
    typer.run(main)
