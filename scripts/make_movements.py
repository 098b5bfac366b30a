"""Makes models/movements, the library of movements that comes with the package.

From the movements that body models simulate, and from the clips of DeepMimic (motions in BODYTRACK_DATA): their zlib
licence permits it. CMU's recordings, whose terms forbid to resell them even converted, are left to
`benchmark.py recognition`.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from benchmarks.everyday import everyday
from benchmarks.motion_files import read_deepmimic

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.foundation.resources import model_path
from tracker.results.recognition import Course, course, course_of
from tracker.results.recognition.library import Description, add_performance, bundled_library
from tracker.running.commands import print_error
from tracker.synthesis.simulation.movements import poses_of

_CLIPS = {
    "walk": ("walk", "walking", True),
    "run": ("run", "running", True),
    "crawl": ("crawl", "on the belly, pulled along by arms and legs", True),
    "jump": ("jump", "a jump from standing, with both feet", False),
    "kick": ("kick", "a kick from a fighter's stance", False),
    "punch": ("punch", "a punch from a fighter's stance", False),
    "cartwheel": ("cartwheel", "a wheel sideways over the hands", False),
    "backflip": ("backflip", "a somersault backwards from standing", False),
    "roll": ("roll", "a roll forwards over the shoulder", False),
    "spin": ("spin", "a turn in the air, one leg raised", False),
    "spinkick": ("spinkick", "a kick out of a turn", False),
    "getup_facedown": ("get_up_from_front", "from lying face down to standing", False),
    "getup_faceup": ("get_up_from_back", "from lying on the back to standing", False),
    "dance_a": ("dance", "a dancer's leap", False),
    "dance_b": ("dance", "a dancer's leap", False),
}
_SIMULATED = {
    "two_elbow_rotation": (0.0, 4.0, False),
    "walk": (0.6, 4.0, True),
    "walking_on_the_spot": (0.6, 4.0, True),
    "arm_swing": (0.6, 7.0, True),
    "squat": (0.0, 2.64, False),
    "turn": (1.0, 4.4, True),
}
"""Movement of gavrila22 -> what is taken of it, seconds, and whether it repeats."""

_TOLD_BY = {"squat": ("left_thigh", "left_shin", "right_thigh", "right_shin", "vertical")}
"""What counts of a movement in which the arms may do anything: people squat with arms raised, crossed or hanging."""

_STAYING = ("walking_on_the_spot",)
"""What is done in one place."""

_STANCES: dict[str, dict[str, float]] = {
    "upright": {"arm_abduction": 8, "arm_extension": 10},
    "astride": {"arm_abduction": 12, "arm_extension": 15, "leg_abduction": 15},
    "at_ease": {"arm_abduction": 10, "arm_extension": 25, "leg_abduction": 8, "leg_elevation": 12, "leg_extension": 20},
}
"""How people stand, degrees."""

_DEEPMIMIC = (
    "DeepMimic's clips in pybullet_data 3.2.7 (zlib licence, Bullet Physics), altered: directions of the limbs only, "
    "25 a second"
)
_OWN = "simulated from models/gavrila22.toml"


def main(output: Annotated[Path, typer.Option(help="Library to replace.")] = bundled_library()) -> None:  # noqa: B008
    """Writes the library anew; the old one stays until the new one is whole."""
    motions = Path(os.environ.get("BODYTRACK_DATA", "")) / "motions"
    if not (motions / "deepmimic").is_dir():
        print_error(f"{motions}/deepmimic: no such folder, expected in BODYTRACK_DATA")
        raise typer.Exit(2)
    output.absolute().parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=output.absolute().parent) as unfinished:
        made = Path(unfinished) / output.name
        _fill(made, motions)
        shutil.rmtree(output, ignore_errors=True)
        made.replace(output)
    typer.echo(f"{len(list(output.glob('*/*.csv')))} performances in {output}")


def _fill(output: Path, motions: Path) -> None:
    clips = motions / "deepmimic"
    output.mkdir()
    shutil.copy(motions / "LICENSE_pybullet.txt", output / "DEEPMIMIC_LICENSE.txt")
    for clip, (name, about, repeats) in _CLIPS.items():
        motion = read_deepmimic(clips / f"humanoid3d_{clip}.txt")
        told = Description(about=about, repeats=repeats, source=_DEEPMIMIC)
        add_performance(output, name, f"deepmimic_{clip}", course(motion.times_s, motion.joints), told)
    body = load_body(model_path("gavrila22"))
    for name, (from_s, to_s, repeats) in _SIMULATED.items():
        times = np.arange(from_s, to_s, 0.02)
        about = body.movements[name].about
        stays, told_by = name in _STAYING, _TOLD_BY.get(name, ())
        told = Description(about=about, repeats=repeats, told_by=told_by, stays=stays, source=_OWN)
        add_performance(output, name, "gavrila22", course_of(body, times, poses_of(name, body, times)), told)
    for name, one in everyday().items():
        # of what repeats, two rounds and a half hold the one that is kept
        times = np.arange(0.0, (2.5 if one.repeats else 1.0) * one.seconds, 0.02)
        told = Description(about=one.about, repeats=one.repeats, source=_OWN)
        add_performance(output, name, "gavrila22", course_of(body, times, one.poses(body, times)), told)
    told = Description(about="standing still, the arms hanging", repeats=True, source=_OWN)
    for stance, angles_deg in _STANCES.items():
        add_performance(output, "standing", f"gavrila22_{stance}", _standing(body, angles_deg), told)


def _standing(body: BodyModel, angles_deg: dict[str, float]) -> Course:
    """Half a second of a person who stands."""
    pose = body.rest()
    for name, angle in angles_deg.items():
        pose[body.columns(name)] = np.radians(angle)
    times = np.arange(12) / 25
    return course_of(body, times, np.tile(pose, (len(times), 1)))


if __name__ == "__main__":
    typer.run(main)
