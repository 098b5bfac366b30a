"""Bodies that a model file may describe and people have not: limbs without a landmark, limbs that hardly move."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from recordings import TrueStart, cycle_for, small_simulation

from tracker.body import BodyModel
from tracker.body.files import load_body
from tracker.frame import Frame
from tracker.initialization import Stages
from tracker.limbs import exchanged, taken_over
from tracker.resources import model_path
from tracker.scene import Person, Scene
from tracker.start import Start
from tracker.tracking.two_passes import track_twice
from tracker.trajectory import Step


def legs_unmarked(text: str) -> str:
    """A model file whose legs have no landmark; what names some is derived."""
    text = re.sub(r"(?m)^(left|right)_(hip|knee|ankle) = \{ segment.*\n", "", text)
    text = re.sub(r"(?m)^  \[[^\]]*(hip|knee|ankle)[^\]]*\],?\n", "", text)
    return re.sub(r"(?ms)^\[(joints|start|clothes|keypoints|movements)[^\n]*\]\n.*?(?=^\[|\Z)", "", text)


def legs_stiff(text: str) -> str:
    """A model file whose legs turn by less than what a limb is looked for anew in."""
    return re.sub(r'(?m)(name = "\w+_leg_\w+".*limits_deg = )\[[^\]]*\]', r"\1[-40, 40]", text)


class Clamped(TrueStart):
    """The true poses as far as another body reaches them."""

    def __init__(self, body: BodyModel, true: TrueStart) -> None:
        super().__init__(true.simulation)
        self.body = body

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        found = super().start(frame, self.simulation.scene, stages)
        return Start(tuple(self.body.clamped(q) for q in found.poses))


def changed(change: Callable[[str], str], folder: Path) -> BodyModel:
    file = folder / "model.toml"
    file.write_text(change(model_path("gavrila22").read_text()))
    return load_body(file)


def tracked(body: BodyModel) -> list[Step]:
    simulation = small_simulation("two_elbow_rotation", n_frames=4)
    scene = Scene((Person("one", body, body.rest()),), simulation.scene.rig)
    cycle = cycle_for(simulation, Clamped(body, TrueStart(simulation)))
    return list(track_twice(simulation.frames(), scene, cycle, {}, simulation.frames))


@pytest.mark.parametrize("change", [legs_unmarked, legs_stiff])
def test_they_are_tracked_both_ways(change: Callable[[str], str], tmp_path: Path) -> None:
    body = changed(change, tmp_path)
    assert body.limbs == ("left_arm", "right_arm", "left_leg", "right_leg")
    assert len(body.marked_limbs) == (2 if change is legs_unmarked else 4)
    assert not any(step.estimates[0].lost for step in tracked(body))


def test_what_has_no_landmark_changes_places_by_its_angles(tmp_path: Path) -> None:
    body = changed(legs_unmarked, tmp_path)
    q = body.rest()
    q[body.index("left_leg_elevation")] = 0.4
    assert exchanged(body, q, "left_leg", "right_leg")[body.index("right_leg_elevation")] == pytest.approx(0.4)
    assert taken_over(body, body.rest(), q, "left_leg")[body.index("left_leg_elevation")] == pytest.approx(0.4)
