"""A simulated person before one's own cameras: where to stand, what to expect, and a recording to try the rest on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import smallness
from tracker.bodies.scene import Person, Scene
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.foundation.errors import CalibrationError, ConfigError
from tracker.foundation.files import replacing, whole_folder, write_json
from tracker.foundation.progress import Progress, silent
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.common_volume import (
    Floor,
    best_heading_deg,
    best_place,
    check_asked,
    check_floor,
    floor_seen,
    middle_of,
    seen_whole,
    start_of,
)
from tracker.synthesis.simulation.movements import movement_of, poses_of
from tracker.synthesis.simulation.prospect import Prospect, prospect, volume_figure
from tracker.synthesis.simulation.sequence import Recipe, fill_folder, simulate


@dataclass(frozen=True)
class Plan:
    """Recipe of a simulated recording: movement and place."""

    recipe: Recipe
    body: BodyModel
    rig: Rig
    floor: Floor
    poses: Array
    """(T, dof) of the movement, in its place."""

    place: tuple[float, float]
    """Middle of the way on the floor, metres."""

    @property
    def whole(self) -> int:
        """Cameras that see a whole person in the middle of the way."""
        stature_m, share = float(self.floor.heights[-1]), smallness(self.body)
        return int(seen_whole(self.rig, np.array(self.place), stature_m, share))

    def prospect(self, edge_px: float) -> Prospect:
        """Expected errors for edges of a standard deviation, px."""
        scene = Scene((Person("person1", self.body, self.poses[0]),), self.rig)
        return prospect(scene, self.poses, CpuSynthesis(), edge_px)


def plan(recipe: Recipe, rig: Rig, place: tuple[float, float] | None = None, heading_deg: float | None = None) -> Plan:
    """Places a person where the cameras see.

    Args:
        recipe: movement, model, stature and time; its rig, place and heading are replaced.
        rig: two cameras or more.
        place: x and y of the middle of the way, metres; None for the middle of what most cameras see.
        heading_deg: direction faced at the start, degrees from the x axis; None for the one that keeps most of the way
            in most pictures.

    Raises:
        CalibrationError: there is one camera only, one is below the floor, or no place is seen by two.
        ConfigError: no such movement, a place or a heading that cannot be, or too short for a frame.
        ModelError: no such model.
    """
    if len(rig) < 2:
        raise CalibrationError(f'one camera, "{rig.names[0]}": expected two or more that see the same place')
    check_floor(rig)
    check_asked(rig, place, heading_deg)
    body = recipe.subject.body()
    movement, _ = movement_of(recipe.movement, body)
    poses = poses_of(movement, body, recipe.times)
    floor = floor_seen(rig, float(body.landmarks_in_world(poses)[..., 2].max()), smallness(body))
    if body.stays:
        if place is not None or heading_deg is not None:
            raise ConfigError(f'model "{body.name}" stays in its place: leave out --place and --heading-deg')
        where = middle_of(body, poses)
        planned = replace(recipe, movement=movement, rig=rig, place=where, heading_deg=0.0)
        return Plan(planned, body, rig, floor, poses, where)
    where = best_place(floor)
    middle = where if place is None else place
    heading = best_heading_deg(rig, body, poses, middle) if heading_deg is None else heading_deg
    start = start_of(body, poses, heading, middle)
    planned = replace(recipe, movement=movement, rig=rig, place=start, heading_deg=heading)
    return Plan(planned, body, rig, floor, poses_of(movement, body, recipe.times, heading, start), middle)


def film(plan: Plan, expected: Prospect, folder: Path, progress: Progress = silent) -> Path:
    """Writes the recording, `prospect.json` and `volume.png` to a folder, complete or not at all.

    Args:
        plan: what to film.
        expected: what to expect of it.
        folder: must not exist, or be empty.
        progress: gets the progress.

    Returns:
        The path of the recording's `run.toml`.

    Raises:
        ConfigError: the folder holds something.
    """
    with whole_folder(folder) as unfinished:
        x, y = plan.place
        told = {
            "movement": plan.recipe.movement,
            "place_m": [x, y],
            "heading_deg": plan.recipe.heading_deg,
            "floor_m2": {str(n): plan.floor.area_m2(n) for n in range(1, len(plan.rig) + 1)},
            "volume_m3": {str(n): plan.floor.volume_m3(n) for n in range(1, len(plan.rig) + 1)},
        }
        write_json(unfinished / "prospect.json", told | expected.as_dict())
        title = f"{plan.recipe.movement.replace('_', ' ')} before {len(plan.rig)} cameras"
        with replacing(unfinished / "volume.png") as picture:
            volume_figure(plan.rig, plan.floor, plan.body, plan.poses, title).savefig(picture, dpi=100)
        fill_folder(simulate(plan.recipe), unfinished, unfinished / "run.toml", progress)
    return folder / "run.toml"
