"""Several persons without plates: found where something moves in the recording, refused where nothing does."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from recordings import cycle_for, small_simulation
from rounding import SINGLE, assert_alike

from tracker.bodies.scene import Person, Scene
from tracker.bodies.subject import Subject
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array
from tracker.foundation.errors import InitializationError
from tracker.foundation.resources import model_path
from tracker.images.reading.video import VideoReading
from tracker.kernels.pictures import covered_by_rods
from tracker.running.jobs.track import TrackJob
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.initialization import stance
from tracker.tracking.initialization._edge_ranking import Clues
from tracker.tracking.initialization._stance_search import NOTHING, direction_images, moved
from tracker.tracking.initialization.auto import AutoInitialization
from tracker.tracking.initialization.stance import StanceInitialization
from tracker.tracking.start import Start


def moved_by(scene: Scene, metres: float) -> Array:
    """The pose (dof,) of a scene's first person, carried aside."""
    person = scene.persons[0]
    q = person.q.copy()
    q[person.body.root.shifts[0]] += metres
    return q


def test_two_persons_are_told_to_be_looked_for_where_something_moves(truth: Scene) -> None:
    two = Scene(truth.persons * 2, truth.rig)
    assert "2 persons where something moves" in AutoInitialization().check(two, (None,) * 4)


def test_where_nothing_moves_two_persons_are_refused() -> None:
    simulation = small_simulation(n_frames=1)
    two = Scene(simulation.scene.persons * 2, simulation.scene.rig)
    cycle = cycle_for(simulation, plates=(None,) * 4)
    with pytest.raises(InitializationError, match="2 persons needs movement in two views, and there is none"):
        AutoInitialization().start(next(iter(simulation.frames())), two, cycle.stages)


def test_the_true_pose_covers_what_has_moved_and_another_one_does_not(truth: Scene) -> None:
    person = truth.persons[0]
    pixels = moved(CpuSynthesis().silhouettes(truth))
    poses = np.array([moved_by(truth, aside) for aside in (0.0, 0.15, 1.0)])
    there, near, away = pixels.covered(person.body, poses, truth.rig)
    assert there > 0.95
    assert there - 0.1 > near > 0.3
    assert away < 0.1


def test_pixels_inside_rods_are_those_that_arrays_find():
    """But for pixels on an edge; a part behind the camera, NaN, covers nothing, one seen from its end a disc."""
    rng = np.random.default_rng(3)
    starts, ends, pixels = (
        rng.uniform(0, 100, shape).astype(np.float32) for shape in ((40, 7, 2), (40, 7, 2), (90, 2))
    )
    reach_px = rng.uniform(2, 12, (40, 7)).astype(np.float32)
    starts[3, 2], ends[5, 1], pixels[0], reach_px[5, 1] = np.nan, starts[5, 1], starts[5, 1] + 3, 5
    found = np.empty(40)
    covered_by_rods(starts, ends - starts, reach_px, pixels, found)
    surely, perhaps = np.zeros((2, 40, 90), dtype=bool)
    for part in range(7):
        start, way = starts[:, None, part], ends[:, None, part] - starts[:, None, part]
        gaps = pixels - start
        share = np.clip((gaps * way).sum(axis=2) / np.maximum((way * way).sum(axis=2), np.float32(1e-6)), 0, 1)
        gaps -= share[..., None] * way
        away_px = np.sqrt((gaps * gaps).sum(axis=2))
        surely |= away_px < reach_px[:, None, part] - 100 * SINGLE
        perhaps |= away_px < reach_px[:, None, part] + 100 * SINGLE
    assert surely[5, 0]
    assert 0.05 < surely.mean() <= perhaps.mean() < surely.mean() + 0.001 < 0.95
    n_inside = np.round(90 * found)
    assert_alike(found, n_inside / 90)
    assert (surely.sum(axis=1) <= n_inside).all()
    assert (n_inside <= perhaps.sum(axis=1)).all()


def test_where_nothing_is_known_to_have_moved_every_pose_covers_it(truth: Scene) -> None:
    poses = np.array([moved_by(truth, aside) for aside in (0.0, 1.0)])
    unknown = moved((None, np.zeros((4, 4), bool)))
    assert NOTHING.covered(truth.persons[0].body, poses, truth.rig).tolist() == [1.0, 1.0]
    assert unknown.covered(truth.persons[0].body, poses, truth.rig).tolist() == [1.0, 1.0]
    assert not unknown.known


def drawn(scene: Scene) -> Frame:
    """Silhouettes of a scene, white on black."""
    masks = CpuSynthesis().silhouettes(scene)
    return Frame(0, 0.0, tuple(np.repeat(np.uint8(255) * mask[..., None], 3, axis=2) for mask in masks))


def test_the_contour_of_somebody_else_does_not_count(truth: Scene) -> None:
    """Of two persons one is where nobody is: with the contours of both he would have half of the other's score."""
    other = Person("two", truth.persons[0].body, moved_by(truth, 1.2))
    edges = direction_images(drawn(truth), 0.035)
    q = truth.persons[0].q[None]
    alone = Clues(edges).scores(truth, q)
    together = Clues(edges).scores(Scene((other, *truth.persons), truth.rig), q)
    assert alone[0] > 0.3
    np.testing.assert_allclose(together, alone, atol=0.08)
    nobody = Clues(edges).scores(Scene((*truth.persons, other), truth.rig), other.q[None])
    assert nobody[0] < 0.1


def test_a_score_has_the_share_of_what_is_covered(truth: Scene) -> None:
    edges, q = direction_images(drawn(truth), 0.035), truth.persons[0].q[None]
    masks = CpuSynthesis().silhouettes(truth)
    beside = tuple(mask | np.roll(mask, mask.shape[1] // 3, axis=1) for mask in masks)
    whole, half = Clues(edges, moved(masks)).scores(truth, q), Clues(edges, moved(beside)).scores(truth, q)
    assert 0.3 * whole < half < 0.8 * whole


def found_in(folder: Path, frame: int) -> tuple[Scene, Start]:
    """The start of two rendered men without plates, who gesture where they stand; of few hypotheses, to take less."""
    reading = VideoReading(path=f"{folder}/{{view}}.mp4", rig=folder / "calibration.json", start=frame)
    persons = tuple(
        Subject(name=name, model=model_path("human"), stature_m=height)
        for name, height in (("dan", 1.8), ("omar", 1.74))
    )
    few = AutoInitialization(stance=StanceInitialization(hypotheses=2, finalists=1, step_m=0.4, step_deg=60.0))
    job = TrackJob(reading=reading, persons=persons, initialization=few, estimation=TwistIcpEstimation())
    opened = job.open()
    cycle = job.cycle(opened)
    start = cycle.initialization.start(next(opened.sequence.frames()), opened.scene, cycle.stages)
    return opened.scene.with_poses(start.poses), start


def test_two_men_who_stand_in_one_place_are_found(data: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """Backdrops show most of them: before, two persons without plates were refused."""
    folder = data("room/DO-Two")
    # two thirds of the time, and arms are not judged below
    monkeypatch.setattr(stance, "limbs_anew", lambda *_: [])
    monkeypatch.setattr(stance, "ROUNDS", ())
    monkeypatch.setattr(stance, "_AGAIN", 20)
    scene, _ = found_in(folder, 0)
    with (folder / "gt_joints.csv").open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["frame"] == "0"]
    for number, person in enumerate(scene.persons, start=1):
        truth = {row["joint"]: [float(row[a]) for a in "xyz"] for row in rows if row["person"] == str(number)}
        marks = dict(zip(person.body.landmark_names, person.body.landmarks_in_world(person.q), strict=True))
        gaps = {
            name: 1000 * float(np.linalg.norm(place - truth[key]))
            for name, place in marks.items()
            if (key := name.replace("left_", "l_").replace("right_", "r_")) in truth
        }
        assert len(gaps) >= 10
        # trunk and legs; an arm that reaches forwards is mistaken in this frame
        lower = [gap for name, gap in gaps.items() if name.endswith(("hip", "knee", "ankle"))]
        assert len(lower) == 6
        assert np.mean(lower) < 100
