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
from benchmarks.carried import Carried, ball, laden, racket, rucksack, skirt
from benchmarks.motion_files import MotionFile, read_cmu, read_deepmimic
from benchmarks.moved_scans import poses_like
from benchmarks.refilmed import Change, adapting, grey, grey_plates, refilmed, shaken, switched
from benchmarks.rooms import filmed_with, furnished, picture_of, turned_cameras
from rich.console import Console

from tracker.arrays import Array
from tracker.body import BodyModel
from tracker.body_files import load_body, read_description
from tracker.commands.terminal import ProgressBar
from tracker.config import read_config
from tracker.errors import ConfigError, TrackerError, nearest
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

    zoom: float = 1.0
    """How many times longer the lenses are than the room's: persons leave the pictures."""

    n_boxes: int = 0
    """Cupboards, each between the person and one of the first cameras."""

    repeats: bool = False
    """Whether the first view shows a frame twice, half-way, and is a frame behind from there on."""

    change: Change | None = None
    """What the cameras make of the images."""

    carried: Carried | None = None
    """What the person wears or carries that no model has."""

    with_partner: bool = False
    """Whether the person of another clip is there as well."""

    tells_of_all: bool = True
    """Whether all who are there are to be followed, not the first one alone."""


# The usual one films as the recordings of BODYTRACK_DATA/room are filmed.
_CONDITIONS = {
    "usual": _Condition(),
    "blurred": _Condition(Recipe(exposure_s=0.02)),
    "plain": _Condition(Recipe(wardrobe=2)),
    "three_views": _Condition(n_views=3),
    "two_views": _Condition(n_views=2),
    "half_rate": _Condition(Recipe(fps=12.5)),
    "double_rate": _Condition(Recipe(fps=50.0)),
    "high_rate": _Condition(Recipe(fps=200.0)),
    "small": _Condition(downscale=2),
    "grainy": _Condition(Recipe(noise_grey=6.0)),
    "noisy": _Condition(Recipe(noise_grey=10.0)),
    "dark": _Condition(Recipe(light=0.35)),
    "out_of_step": _Condition(Recipe(delays_s=(0.0, 0.013, -0.008, 0.019))),
    "compressed": _Condition(Recipe(constant_rate_factor=33)),
    "turned_cameras": _Condition(turned_deg=0.2),
    "repeated": _Condition(repeats=True),
    "zoomed": _Condition(zoom=1.6),
    "furnished": _Condition(n_boxes=1),
    "crammed": _Condition(n_boxes=2),
    "grey": _Condition(change=grey),
    "adapting": _Condition(change=adapting),
    "switched": _Condition(change=switched),
    "shaken": _Condition(change=shaken),
    "skirt": _Condition(carried=skirt),
    "rucksack": _Condition(carried=rucksack),
    "racket": _Condition(carried=racket),
    "ball": _Condition(carried=ball),
    "together": _Condition(with_partner=True),
    "bystander": _Condition(with_partner=True, tells_of_all=False),
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
    ahead_m: float = 0.0
    """How far the middle of the way lies behind that of the room, metres; before it is where somebody comes in from."""

    partner: str = ""
    """The clip whose person is there where there are two; empty for the first one of the other person."""


# Chosen by their names and lengths, before any was tracked; kick, punch and walks are left out, for recordings of
# BODYTRACK_DATA/room show some.
_CLIPS = {
    "dance": _Clip("deepmimic/humanoid3d_dance_b.txt", "theo", "V-Dance", partner="ballroom_1"),
    "spinkick": _Clip("deepmimic/humanoid3d_spinkick.txt", "rita", "K-Kick", heading_deg=60),
    "cartwheel": _Clip("deepmimic/humanoid3d_cartwheel.txt", "theo", "N-Stride", 0.0, 2.12, 120),
    "jump": _Clip("deepmimic/humanoid3d_jump.txt", "rita", "V-Dance", heading_deg=-30),
    "roll": _Clip("deepmimic/humanoid3d_roll.txt", "theo", "K-Kick", heading_deg=30),
    "get_up_from_back": _Clip("deepmimic/humanoid3d_getup_faceup.txt", "rita", "P-Floor", heading_deg=90),
    "get_up_from_front": _Clip(
        "deepmimic/humanoid3d_getup_facedown.txt", "theo", "N-Stride", heading_deg=-70, partner="jump"
    ),
    "crawl": _Clip("deepmimic/humanoid3d_crawl.txt", "rita", "V-Dance", heading_deg=150),
    "spin": _Clip("deepmimic/humanoid3d_spin.txt", "theo", "R-Turn", 0.0, 2.16),
    "martial_arts_1": _Clip("cmu/135_06-martialArts.amc", "theo", "K-Kick", 4.0, 6.4, partner="martial_arts_2"),
    "martial_arts_2": _Clip("cmu/135_06-martialArts.amc", "rita", "P-Floor", 12.0, 14.4, 45),
    "ballroom_1": _Clip("cmu/131_04-dance.amc", "rita", "N-Stride", 1.0, 3.4, 90),
    "ballroom_2": _Clip("cmu/131_04-dance.amc", "theo", "V-Dance", 5.0, 7.4, -120),
    # Chosen after the others, when there was nothing left to choose by them.
    "backflip": _Clip("deepmimic/humanoid3d_backflip.txt", "theo", "V-Dance", heading_deg=40),
    "dancing": _Clip("deepmimic/humanoid3d_dance_a.txt", "rita", "P-Floor", heading_deg=-30),
    "martial_arts_3": _Clip("cmu/135_06-martialArts.amc", "rita", "V-Dance", 8.0, 10.4, 110),
    "martial_arts_4": _Clip("cmu/135_06-martialArts.amc", "theo", "P-Floor", 18.0, 20.4, -60),
    "martial_arts_5": _Clip("cmu/135_06-martialArts.amc", "theo", "N-Stride", 22.0, 24.4, 200),
    "ballroom_3": _Clip("cmu/131_04-dance.amc", "theo", "K-Kick", 3.0, 5.4, 30),
    # These two are not by chance: nobody is in the pictures at first, or at last.
    "walking_in": _Clip("cmu/07_08-walk.amc", "rita", "V-Dance", heading_deg=30, ahead_m=-2.6),
    "walking_out": _Clip("cmu/07_05-walk.amc", "theo", "K-Kick", heading_deg=-70, ahead_m=2.6),
}
# Between the joints of two persons, metres.
_LEAST_APART_M = 0.3
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
    other = _CLIPS[clip.partner] if clip.partner else next(one for one in _CLIPS.values() if one.person != clip.person)
    clips = (clip, other) if condition.with_partner else (clip,)
    models = tuple(_scanned(one.person, data, folder.parent) for one in clips)
    simulation = _simulated(clips, condition, models, data)
    told = [
        {"subject": one.person, "id": one.person, "height_m": read_description(model).stature_m}
        for one, model in zip(clips, models, strict=True)
    ]
    told = told if condition.tells_of_all else told[:1]
    with whole_folder(folder) as unfinished:
        fill_folder(simulation, unfinished, unfinished / "config.toml", progress)
        if condition.change is grey:
            grey_plates(unfinished / "background")
        save_rig(turned_cameras(simulation.scene.rig, condition.turned_deg), unfinished / "rig.toml")
        (unfinished / "meta.json").write_text(json.dumps({"people": told}), encoding="utf-8")
        if condition.with_partner:
            (unfinished / "config.toml").unlink()  # it has the first one's model for both
        if simulation.fronts:
            _write_occluders(simulation, unfinished / "occluders")


def _write_occluders(simulation: Simulation, folder: Path) -> None:
    """What stands before the persons as a user paints it, a little larger than it is."""
    folder.mkdir()
    for name, front in zip(simulation.scene.rig.names, simulation.fronts, strict=True):
        grown = cv2.dilate(front.astype(np.uint8), np.ones((5, 5), np.uint8))
        cv2.imwrite(str(folder / f"{name}.png"), 255 * grown)


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


def _simulated(clips: tuple[_Clip, ...], condition: _Condition, models: tuple[Path, ...], data: Path) -> Simulation:
    folder = data / "room" / clips[0].room
    room = load_rig(folder / "calibration.json")
    pictures = [picture_of(folder / "background" / f"{one.name}.jpg", one.size) for one in room.cameras]
    films = [
        filmed_with(camera, picture, condition.downscale, condition.zoom)
        for camera, picture in zip(room.cameras[: condition.n_views], pictures, strict=False)
    ]
    rig = Rig(tuple(camera for camera, _ in films))
    bodies = [load_body(model) for model in models]
    filmed = condition.filmed
    poses = _side_by_side([_poses(*one, filmed.fps, data) for one in zip(clips, bodies, strict=True)], bodies)
    for one, body in zip(poses, bodies, strict=True):
        one[:, _on_floor(body)] += room.middle[:2]
    pictures, fronts = furnished(
        [picture for _, picture in films], rig, condition.n_boxes, poses[0][:, _on_floor(bodies[0])]
    )
    recipe = replace(
        filmed,
        model=str(models[0]),
        rig=rig,
        seconds=len(poses[0]) / filmed.fps,
        delays_s=filmed.delays_s[: len(rig)],
        repeats_from=(len(poses[0]) // 2, *[None] * (len(rig) - 1)) if condition.repeats else (),
    )
    persons = tuple(Person(clip.person, body, one[0]) for clip, body, one in zip(clips, bodies, poses, strict=True))
    simulation = Simulation(recipe, Scene(persons, rig), tuple(poses), tuple(map(Plate, pictures)), fronts)
    if condition.carried is not None:
        simulation = laden(simulation, condition.carried)
    return simulation if condition.change is None else refilmed(simulation, condition.change)


def _side_by_side(poses: list[Array], bodies: list[BodyModel]) -> list[Array]:
    """The movements as long as the shorter one, side by side as near as no joints meet."""
    if len(poses) == 1:
        return poses
    poses = [one[: min(map(len, poses))].copy() for one in poses]
    joints = [body.landmarks_in_world(one) for body, one in zip(bodies, poses, strict=True)]
    for apart_m in np.arange(0.6, 3.0, 0.1):
        way = joints[0][:, :, None] - joints[1][:, None] + (0, apart_m, 0)
        if np.linalg.norm(way, axis=-1).min() > _LEAST_APART_M:
            break
    for sign, one, body in zip((1, -1), poses, bodies, strict=True):
        one[:, body.names.index("torso_y")] += sign * apart_m / 2
    return poses


def _on_floor(body: BodyModel) -> list[int]:
    """Parameters of where it is."""
    return [body.names.index("torso_x"), body.names.index("torso_y")]


def _poses(clip: _Clip, body: BodyModel, fps: float, data: Path) -> Array:
    """Solved at the usual rate or more: what a joint may do from a frame to the next is told for that."""
    file = data / "motions" / clip.file
    motion = (read_cmu if file.suffix == ".amc" else read_deepmimic)(file).part(clip.from_s, clip.to_s)
    every = max(1, round(Recipe.fps / fps))
    poses = poses_like(_turned(motion, clip.heading_deg), body, fps * every)[::every]
    if clip.ahead_m:
        place = poses[:, _on_floor(body)]
        way = place[-1] - place[0]
        poses[:, _on_floor(body)] += clip.ahead_m * way / np.linalg.norm(way) - place.mean(axis=0)
    return poses


def _turned(motion: MotionFile, degrees: float) -> MotionFile:
    """Turned about the vertical."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return MotionFile(motion.times_s, motion.joints @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T)


if __name__ == "__main__":
    typer.run(main)
