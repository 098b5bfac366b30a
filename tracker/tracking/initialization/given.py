"""Start poses from a file of poses or of joints."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import turned_round
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import FilePath, component
from tracker.foundation.errors import ConfigError, nearest, shortened
from tracker.foundation.source_files import number_in, rows_of
from tracker.images.plate import Plate
from tracker.tracking.hypotheses import beside_turned
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._joint_tables import is_joint_table, pose_from_joints
from tracker.tracking.initialization._person_sized import check_size
from tracker.tracking.start import Start


@component
class GivenInitialization:
    """Takes the start poses from a CSV in the layout of poses.csv or of joints.csv: any earlier result can start a run.

    So can the joint centres of a marker system or of another program.
    """

    poses: FilePath
    """CSV with the columns `frame`, `person` and every parameter with its unit (`torso_x_m`, ...); or with `frame`,
    `joint`, `x`, `y`, `z` (metres) and, for several persons, `person`: the bodies are fitted to the joints."""

    def check(self, scene: Scene, plates: tuple[Plate | None, ...]) -> str:
        """Reads every pose or joint that may be used; see `tracker.tracking.initialization.Initialization.check`."""
        check_size(scene)
        rows = _rows(self.poses)
        if is_joint_table(rows):
            for person in scene.persons:
                self._from_joints(rows, person, scene, 0)
            return f"given, joints in {self.poses}"
        for person in scene.persons:
            for row in _rows_of(rows, person, self.poses):
                _number(row, "frame", self.poses)
                _parameters(row, person.body, self.poses)
        return f"given, poses in {self.poses}"

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """The row of each person with the frame's number, or that of the nearest earlier frame, or of the first one.

        It compares each pose with the same turned round: tables of other programs may have left and right, or front and
        back, exchanged.
        """
        scene = scene.with_poses(self.poses_of(scene, frame.index))
        poses = tuple(person.q for person in scene.persons)
        if stages.seen_before:
            return Start(poses)
        # a body fixed to the floor, as an arm of a robot, cannot face the other way
        hypotheses = tuple(
            beside_turned(frame, scene, k, turned_round(person.body, person.q), stages)
            if person.body.start.turn
            else ()
            for k, person in enumerate(scene.persons)
        )
        return Start(poses, (), hypotheses)

    def poses_of(self, scene: Scene, index: int) -> tuple[Array, ...]:
        """The start poses (dof,) of all persons in a frame.

        Raises:
            ConfigError: the file has none.
        """
        rows = _rows(self.poses)
        if is_joint_table(rows):
            return tuple(self._from_joints(rows, person, scene, index) for person in scene.persons)
        return tuple(self._pose(rows, person, index) for person in scene.persons)

    def _from_joints(self, rows: list[dict[str, str]], person: Person, scene: Scene, index: int) -> Array:
        alone = len(scene.persons) == 1 and len({row.get("person") for row in rows}) == 1
        mine = rows if alone else _rows_of(rows, person, self.poses)
        return pose_from_joints(mine, person.body, index, self.poses)

    def _pose(self, rows: list[dict[str, str]], person: Person, index: int) -> Array:
        mine = sorted(_rows_of(rows, person, self.poses), key=lambda row: _number(row, "frame", self.poses))
        earlier = [row for row in mine if _number(row, "frame", self.poses) <= index]
        return _parameters(earlier[-1] if earlier else mine[0], person.body, self.poses)


def _rows_of(rows: list[dict[str, str]], person: Person, path: Path) -> list[dict[str, str]]:
    """The poses of one person, without lost frames."""
    if "person" not in rows[0]:
        raise ConfigError(f'{path}: no column "person"; {nearest("person", rows[0])}')
    found = [row for row in rows if row.get("status") != "lost"]
    mine = [row for row in found if row["person"] == person.name]
    if not mine:
        names = {row["person"] for row in found}
        raise ConfigError(f'{path}: no start pose of person "{person.name}"; {nearest(person.name, names)}')
    return mine


def _rows(path: Path) -> list[dict[str, str]]:
    if not path.is_file():
        beside = [other.name for other in path.parent.glob("*.csv")] if path.parent.is_dir() else []
        raise ConfigError(f"{path}: no such file of start poses; {nearest(path.name, beside)}")
    return rows_of(path, ConfigError)


def _parameters(row: dict[str, str], body: BodyModel, path: Path) -> Array:
    values = []
    for parameter in body.parameters:
        if parameter.column not in row:
            raise ConfigError(
                f'{path}: no column "{parameter.column}" of model "{body.name}"; {nearest(parameter.column, row)}'
            )
        value = _number(row, parameter.column, path)
        values.append(math.radians(value) if parameter.rotates else value)
    pose = np.array(values)
    outside = (pose < body.limits[:, 0] - 1e-6) | (pose > body.limits[:, 1] + 1e-6)
    if outside.any():
        parameter = body.parameters[int(np.flatnonzero(outside)[0])]
        low, high = (math.degrees(end) if parameter.rotates else end for end in parameter.limits)
        raise ConfigError(
            f'{path}: frame {row["frame"]}: "{parameter.column}" is {row[parameter.column]}, outside the limits '
            f'{low:g} to {high:g} {parameter.unit} of model "{body.name}"'
        )
    return pose


def _number(row: dict[str, str], column: str, path: Path) -> float:
    try:
        return number_in(row, column, path, ConfigError)
    except ConfigError as error:
        raise ConfigError(
            f'{error} (frame {shortened(row.get("frame", "?"))}); delete the row, or give it the status "lost"'
        ) from error
