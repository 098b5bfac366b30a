"""Acquisition from a robot's description, URDF or MJCF: a model with its meshes as a skin."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from tracker.acquisition.robot import RobotFile, body_of, stands_at
from tracker.bodies.robots import Robot
from tracker.bodies.robots.mjcf import read_mjcf
from tracker.bodies.robots.urdf import read_urdf
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ModelError
from tracker.foundation.files import write_json
from tracker.foundation.progress import WARNING, Progress
from tracker.foundation.source_files import xml_of
from tracker.running.jobs import ResultFolder, described
from tracker.running.jobs._acquisition import MODEL, AcquireOutcome
from tracker.running.jobs._persons import save_with_skin, skinned_outcome


@component
class RobotJob:
    """Makes a body model of a robot's description: `model.toml`, its skin, a picture and figures."""

    resumable: ClassVar[bool] = False

    robot: RobotFile
    """The description."""

    name: str = "model"
    """Name of the model."""

    def open(self, earlier: Path | None = None) -> Robot:
        """Reads the description; see `tracker.running.jobs.Job.open`."""
        tag = xml_of(self.robot.file, ModelError, "a robot").tag
        readers = {"robot": read_urdf, "mujoco": read_mjcf}
        if tag not in readers:
            raise ModelError(f"{self.robot.file}: <{tag}> found, expected <robot> of a URDF or <mujoco> of an MJCF")
        return readers[tag](self.robot.file)

    @property
    def model_name(self) -> str:
        """Name of the model."""
        return self.name

    def execute(self, opened: Robot, folder: ResultFolder, progress: Progress) -> AcquireOutcome:
        """Fits parts to the meshes; see `tracker.running.jobs.Job.execute`."""
        progress("fitting the parts")
        told = self.robot
        free = opened.free if told.base is None else told.base == "free"
        found = body_of(opened, self.name, free, stands_at(told.at, told.turn_deg))
        moves = "moves about" if free else f"stays where it is, at {', '.join(f'{x:g}' for x in told.at)} m"
        said = "" if told.base or opened.free else "; if it moves about: --set robot.base=free"
        for remark in (*opened.unread, f"{found.description.about}; its base {moves}{said}"):
            progress(f"{WARNING}{remark}")
        path = folder.path / MODEL
        skinned = found.description.model_copy(update={"skin": found.skin})
        description = save_with_skin(skinned, found.surface, found.rigging, path)
        outcome = skinned_outcome(found.fits, description, description, path)
        write_json(path.with_suffix(".json"), {**outcome.as_dict(), "unread": opened.unread, "config": described(self)})
        return outcome
