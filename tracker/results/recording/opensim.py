"""A model of OpenSim's, such as Rajagopal's, moved as the person moved: markers, set-up files, and the run."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import pydantic

from tracker.bodies.subject import Mass
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError, ModelError, nearest
from tracker.foundation.files import write_whole
from tracker.results.recording import RunContext
from tracker.results.recording._anatomical import leaning_limb
from tracker.results.recording._motion import Y_UP, Motion, Motions, exported_name, trc_text
from tracker.results.recording._osim_model import OsimMarker, OsimModel, OsimName, markers_on, read_osim, write_turning
from tracker.results.recording._osim_run import (
    opensim_installed,
    run_opensim,
    write_kinematics,
    write_markers,
    write_outcome,
    write_scaling,
)
from tracker.tracking.trajectory import Step

log = logging.getLogger("tracker")

_MODELS_APART_M = 0.01
"""Distance between the joints of two models of one person besides our sigma, metres: 8 to 13 mm on two recordings.
Without it a marker known to a millimetre would outweigh all others, and no model can follow it so closely."""


@component
class Opensim:
    """`NAME_MODEL*` for each person: files with which OpenSim moves its model as the person moved.

    `.trc` and `_static.trc` hold the markers in the movement and in the reference pose, `_markers.xml` their bodies;
    `_scale.xml` sets up scaling of the model, `_unscaled.osim`, and `_ik.xml` inverse kinematics. If the Python package
    `opensim` is installed, both are run: `.osim` is the scaled model, `.mot` its movement, `.json` how well it fits. y
    is up.
    """

    model: Annotated[Path, pydantic.Field(strict=False), OsimName()] = pydantic.Field(
        examples=['"rajagopal", or a path to an .osim file']
    )
    """The model to move, from your own installation: `rajagopal`, `laiuhlrich` or `pose2sim` in the usual folders of
    OpenSim and Pose2Sim, or a path that ends in .osim."""

    mass_kg: Mass | dict[str, Mass] | None = None
    """Mass of the person, or of each person by name, kg; None for the masses in `persons`."""

    def begin(self, run: RunContext) -> OpensimRecorder:
        """Collects the poses; the files are written at the end.

        Raises:
            ConfigError: the model cannot be read, or a mass has no person.
            ModelError: a body has no legs, or does not hang down in its reference pose.
        """
        return OpensimRecorder(run, read_osim(self.model), _masses(self.mass_kg, run))


def _masses(told: float | Mapping[str, float] | None, run: RunContext) -> dict[str, float]:
    """Person -> mass, kg, if it is known."""
    names = [person.name for person in run.scene.persons]
    if isinstance(told, Mapping):
        if unknown := next((name for name in told if name not in names), None):
            raise ConfigError(f'mass_kg: no person is called "{unknown}"; {nearest(unknown, names)}')
        return dict(told)
    if told is not None:
        if len(names) > 1:
            raise ConfigError(
                f"mass_kg = {told:g}: for which person? expected one mass a person, as {{ {names[0]} = {told:g} }}"
            )
        return {names[0]: told}
    persons = run.details.get("config", {}).get("persons", ())
    return {one["name"]: float(one["mass_kg"]) for one in persons if "mass_kg" in one}


class OpensimRecorder:
    """Writes the files of each person at the end."""

    def __init__(self, run: RunContext, model: OsimModel, masses: Mapping[str, float]) -> None:
        self._folder, self._motions, self._model, self._masses = run.folder, Motions(run), model, masses
        self._markers = [markers_on(person.body, model) for person in run.scene.persons]
        for person in run.scene.persons:
            if limb := leaning_limb(person.body):
                raise ModelError(
                    f'opensim: {limb} of the model "{person.body.name}" does not hang down in its reference pose, '
                    "where angles of OpenSim's models are zero; leave opensim out"
                )

    def write(self, step: Step) -> None:
        """Adds one frame."""
        self._motions.add(step)

    def finish(self) -> tuple[Path, ...]:
        """Writes the set-up files, and runs OpenSim if it is installed."""
        files: list[Path] = []
        for motion, markers in zip(self._motions.all(), self._markers, strict=False):
            if motion.lost.all():
                log.warning("%s is lost in all %d frames: no files for OpenSim", motion.name, len(motion.lost))
                continue
            with tempfile.TemporaryDirectory(prefix=".opensim-", dir=self._folder) as unfinished:
                made = self._written(motion, markers, Path(unfinished))
                files += [path.replace(self._folder / path.name) for path in made]
        if files and not opensim_installed():
            log.warning('OpenSim is not installed: run the set-up files in its own program, or "pip install opensim"')
        return tuple(files)

    def _written(self, motion: Motion, markers: Sequence[OsimMarker], folder: Path) -> Iterator[Path]:
        name = f"{motion.name}_{exported_name(self._model.path.stem)}"
        of = {kind: folder / f"{name}{kind}" for kind in (*_SET_UP, *_OUTCOME)}
        marks, names = [marker.mark for marker in markers], [marker.name for marker in markers]

        def write_points(kind: str, times_s: Array, interval_s: float, points: Array) -> None:
            write_whole(of[kind], trc_text(of[kind].name, names, times_s, interval_s, points @ Y_UP.T))

        upright = motion.points(np.zeros((2, motion.body.dof)), marks)
        upright[..., 2] -= upright[..., 2].min()  # on the floor, as OpenSim's models stand
        write_points("_static.trc", np.array([0.0, 1.0]), 1.0, upright)
        # OpenSim stops at a frame without markers: frames in which the person is lost are left out.
        times_s = motion.times_s[~motion.lost]
        write_points(".trc", times_s, motion.interval_s, motion.points(motion.q[~motion.lost], marks))
        write_turning(of["_unscaled.osim"], self._model)
        write_markers(of["_markers.xml"], markers)
        write_scaling(of["_scale.xml"], self._model, markers, self._masses.get(motion.name))
        write_kinematics(of["_ik.xml"], _weights(motion, markers), (float(times_s[0]), float(times_s[-1])))
        if opensim_installed():
            if fault := run_opensim(folder, name):
                log.warning("%s: OpenSim did not move %s: %s", motion.name, self._model.path.name, fault)
            else:
                write_outcome(of[".json"], motion, of[".mot"], of["_ik_marker_errors.sto"])
        return (path for path in of.values() if path.is_file())


_SET_UP = (".trc", "_static.trc", "_unscaled.osim", "_markers.xml", "_scale.xml", "_ik.xml")
_OUTCOME = (".osim", ".mot", "_ik_marker_errors.sto", ".json")
"""Endings of our files, and of OpenSim's."""


def _weights(motion: Motion, markers: Sequence[OsimMarker]) -> dict[str, float]:
    """Marker -> weight in inverse kinematics: the inverse variance of its position, 1 for an exact one."""
    sigmas = motion.sigmas([marker.mark for marker in markers])[~motion.lost]
    usual_m = np.median(np.nan_to_num(sigmas, nan=0.0), axis=0)
    weights = _MODELS_APART_M**2 / (_MODELS_APART_M**2 + usual_m**2)
    return {marker.name: float(weight) for marker, weight in zip(markers, weights, strict=True)}
