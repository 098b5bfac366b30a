"""What every component that reads or writes files must do: a new file is tested without a word in here."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sections
from osim_samples import osim_like_rajagopals
from recordings import cycle_for, small_simulation
from sections import each, made

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.errors import TrackerError
from tracker.images.analysis.contours import ContourAnalysis
from tracker.images.sight import Sight
from tracker.results.recording import RunContext
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.estimate import Status
from tracker.tracking.objective import Objective
from tracker.tracking.trajectory import Step


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation(n_frames=2)


@pytest.fixture(scope="module")
def scene(simulation: Simulation) -> Scene:
    """The person as it is in frame 0."""
    return simulation.scene


@pytest.fixture(scope="module", autouse=True)
def osim(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A model of OpenSim that a recording moves."""
    path = osim_like_rajagopals(tmp_path_factory.mktemp("osim"))
    sections.GIVEN["recording", "opensim"] = {"model": str(path)}
    yield
    del sections.GIVEN["recording", "opensim"]


@each("reading")
def test_an_absent_recording_is_one_clear_line(use):
    with pytest.raises(TrackerError) as caught:
        made("reading", use, rig="absent.toml").open()
    assert "/nowhere/absent" in str(caught.value)
    assert "\n" not in str(caught.value)


@each("reading")
def test_cameras_without_a_calibration_are_read_by_their_names(use):
    with pytest.raises(TrackerError, match='key "rig" is missing'):
        made("reading", use).open()
    if use == "live":
        with pytest.raises(TrackerError, match="cameras are calibrated from a recording"):
            made("reading", use).open_uncalibrated()
        return
    with pytest.raises(TrackerError, match="expected the names of the cameras"):
        made("reading", use).open_uncalibrated()
    with pytest.raises(TrackerError, match="expected different names"):
        made("reading", use, views=["left", "left"]).open_uncalibrated()
    with pytest.raises(TrackerError, match="/nowhere/absent/left"):
        made("reading", use, views=["left", "right"]).open_uncalibrated()


class BlankViews:
    """Two views of nothing."""

    names, sizes, n_frames = ("left", "right"), ((96, 64), (96, 64)), 4

    def frames(self) -> Iterator[Frame]:
        return (Frame(k, 0.04 * k, (np.full((64, 96, 3), 90, np.uint8),) * 2) for k in range(self.n_frames))


@each("calibration")
def test_nothing_is_calibrated_from_nothing(use):
    with pytest.raises(TrackerError) as caught:
        made("calibration", use).calibrate(BlankViews(), lambda what, done, total: None)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def steps(simulation: Simulation, scene: Scene) -> list[Step]:
    """A frame found, one lost with a view missing, one found again."""
    frame, cycle = next(iter(simulation.frames())), cycle_for(simulation)
    observation = ContourAnalysis().observe(Sight(frame, cycle.plates), cycle.synthesis.contours(scene))
    found = Objective(Comparison(scene, 0, cycle.synthesis, observation), ContourEvidence()).estimate(
        scene.persons[0].q, np.full((22, 22), np.nan), 1
    )
    fitted = cycle.synthesis.contours(scene)
    states = (
        (Status.BOOTSTRAPPED, frame.images),
        (Status.LOST, (None, *frame.images[1:])),
        (Status.RECOVERED, frame.images),
    )
    return [
        Step(Frame(10 + k, 0.4 + 0.04 * k, images), scene, (replace(found, status=status),), fitted, {"analysis": 0.01})
        for k, (status, images) in enumerate(states)
    ]


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@each("recording")
def test_a_recording_leaves_files_and_replaces_those_of_the_run_before(use, scene, steps, tmp_path):
    context = RunContext("test", tmp_path, scene, fps=25.0, interval_s=0.04, n_frames=len(steps))
    for part in (steps[:1], steps):
        recorder = made("recording", use).begin(context)
        for step in part:
            recorder.write(step)
        told = recorder.finish()
        assert all(contents(tmp_path).values())
        assert contents(tmp_path)
        assert sorted(told) == sorted(tmp_path.iterdir())
    names = set(contents(tmp_path))
    assert not any(name.endswith((".part", ".tmp")) for name in names)


@each("recording")
def test_a_run_without_a_frame_is_finished_too(use, scene, tmp_path):
    recorder = made("recording", use).begin(RunContext("test", tmp_path, scene, fps=25.0, interval_s=0.04, n_frames=3))
    assert sorted(recorder.finish()) == sorted(tmp_path.iterdir())
