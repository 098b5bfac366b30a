"""What every component found in a stage must do: a new file is tested without a word in here."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recordings import cycle_for, small_simulation
from renderers import working
from scipy.spatial import cKDTree
from sections import made

from tracker.components import available
from tracker.cycle import Cycle
from tracker.errors import InitializationError, TrackerError
from tracker.estimate import Estimate, Status
from tracker.frame import Frame
from tracker.objective import Objective
from tracker.observation import Observation
from tracker.recording import RunContext
from tracker.scene import Scene
from tracker.simulation.sequence import Simulation
from tracker.trajectory import History, Step


def each(stage: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("use", available(stage))


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation(n_frames=2)


@pytest.fixture(scope="module")
def scene(simulation: Simulation) -> Scene:
    """The person as it is in frame 0."""
    return simulation.scene


@pytest.fixture(scope="module")
def frame(simulation: Simulation) -> Frame:
    """Frame 0, its images read-only."""
    first = next(iter(simulation.frames()))
    for image in first.images:
        image.setflags(write=False)  # type: ignore[union-attr]
    return first


@pytest.fixture(scope="module")
def cycle(simulation: Simulation) -> Cycle:
    """The components around the one under test."""
    return cycle_for(simulation)


@pytest.fixture(scope="module")
def observation(scene: Scene, frame: Frame, cycle: Cycle) -> Observation:
    return cycle.analysis.observe(frame, cycle.synthesis.contours(scene), cycle.backgrounds)


def around(scene: Scene, n: int, off_deg: float, off_m: float) -> np.ndarray:
    """Poses (n, dof) scattered around the truth."""
    person = scene.persons[0]
    spread = np.where(person.body.rotates, np.radians(off_deg), off_m)
    return person.body.clamped(person.q + spread * np.random.default_rng(4).normal(size=(n, person.body.dof)))


@each("synthesis")
def test_contours_are_images_of_the_surface(use, scene):
    contours = working(use, scene).contours(scene)
    assert (contours.n_poses, contours.n_views) == (1, len(scene.rig))
    for v, camera in enumerate(scene.rig.cameras):
        view = contours.of(v)
        assert len(view.parts) > 50
        np.testing.assert_allclose(view.pixels, camera.project(view.points.astype(float)), atol=0.5)
        np.testing.assert_allclose(np.linalg.norm(view.normals, axis=1), 1, atol=1e-3)
        assert ((view.weights > 0) == ~view.between).all()
        assert set(view.parts) <= set(range(len(scene.shapes)))


@each("synthesis")
def test_contours_and_silhouettes_agree(use, scene):
    synthesis = working(use, scene)
    contours, masks = synthesis.contours(scene), synthesis.silhouettes(scene)
    for v, mask in enumerate(masks):
        assert mask.shape == scene.rig.cameras[v].size[::-1]
        padded = np.pad(mask, 1)
        inner = padded[2:, 1:-1] & padded[:-2, 1:-1] & padded[1:-1, 2:] & padded[1:-1, :-2]
        outline = np.argwhere(mask & ~inner)[:, ::-1]
        pixels = contours.of(v).pixels
        # Every outline lies on a contour, at most half a sample's 8 px away; every contour lies on the person.
        assert np.quantile(cKDTree(pixels).query(outline)[0], 0.98) < 6
        assert cKDTree(np.argwhere(mask)[:, ::-1]).query(pixels)[0].max() < 2


@each("synthesis")
def test_a_batch_is_its_poses_one_by_one(use, scene):
    synthesis, poses = working(use, scene), around(scene, 3, 10.0, 0.1)
    batch = synthesis.contours(scene, 0, poses)
    for b, q in enumerate(poses):
        single = synthesis.contours(scene.with_pose(0, q))
        for v in range(len(scene.rig)):
            for field in dataclasses.fields(single.of(v)):
                found, wanted = getattr(batch.of(v, b), field.name), getattr(single.of(v), field.name)
                np.testing.assert_allclose(found, wanted, atol=1e-3)


@each("analysis")
@pytest.mark.parametrize("predicted", [True, False])
def test_findings_are_edges_of_their_view(use, predicted, scene, frame, cycle):
    expected = cycle.synthesis.contours(scene) if predicted else None
    one_missing = replace(frame, images=(None, *frame.images[1:]))
    observation = made("analysis", use).observe(one_missing, expected, cycle.backgrounds)
    assert observation.views[0] is None
    assert len(observation.views) == len(frame.images)
    for view, camera in zip(observation.views[1:], scene.rig.cameras[1:], strict=True):
        n_edges, (height, width) = len(view.edges), view.distance.shape
        assert len(view.directions) == len(view.segments) == len(view.accepted) == n_edges > 50
        np.testing.assert_allclose(np.linalg.norm(view.directions, axis=1), 1, atol=1e-3)
        assert (view.edges > -1).all()
        assert (view.edges < camera.size).all()
        assert view.accepted[view.scene].all()
        assert (view.scene_weights > 0).all()
        # Segments are accepted as units, but for the points that the background explains.
        share = np.bincount(view.segments, view.accepted) / np.maximum(np.bincount(view.segments), 1)
        assert ((share == 0) | (share >= 0.5)).all()
        assert ((view.distance >= 0) & (view.distance <= view.reach)).all()
        x, y = (np.round(view.edges[view.scene]).astype(int) - view.origin).T
        assert ((x >= 0) & (x < width) & (y >= 0) & (y < height)).all()
        assert view.distance[y, x].max() < 1.5


@each("analysis")
def test_the_same_images_show_the_same(use, scene, frame, cycle):
    expected = cycle.synthesis.contours(scene)
    one, other = (made("analysis", use).observe(frame, expected, cycle.backgrounds) for _ in range(2))
    for mine, theirs in zip(one.packed, other.packed, strict=True):
        np.testing.assert_array_equal(mine, theirs)


@each("analysis")
def test_the_true_contours_are_found_in_the_images(use, scene, frame, cycle):
    contours = cycle.synthesis.contours(scene)
    found = made("analysis", use).observe(frame, contours, cycle.backgrounds)
    evidence = cycle.similarity.evidence(contours, found, len(scene.shapes))
    seen = evidence.visible_px > 0
    assert np.average(evidence.explained[seen], weights=evidence.visible_px[seen]) > 0.6


@each("similarity")
def test_a_distance_is_least_near_the_truth_whatever_else_is_in_the_batch(use, scene, observation, cycle):
    similarity = made("similarity", use)
    shifts = np.zeros((5, scene.persons[0].body.dof))
    shifts[:, 0] = [0.0, 0.05, -0.05, 0.1, -0.1]
    poses = scene.persons[0].q + shifts
    distances = similarity.distance(cycle.synthesis.contours(scene, 0, poses), observation)
    assert np.isfinite(distances).all()
    assert (distances >= 0).all()
    assert distances[0] < distances[1:3].min() < distances[3:].min()
    singles = [similarity.distance(cycle.synthesis.contours(scene, 0, q[None]), observation)[0] for q in poses]
    np.testing.assert_allclose(distances, singles, rtol=1e-5)


@each("similarity")
@pytest.mark.parametrize("n_missing", [0, 1, 4])
def test_evidence_explains_the_distance(use, n_missing, scene, observation, cycle):
    similarity, contours = made("similarity", use), cycle.synthesis.contours(scene)
    rest = Observation((None,) * n_missing + observation.views[n_missing:])
    evidence = similarity.evidence(contours, rest, len(scene.shapes))
    assert np.isfinite(evidence.distance_px)
    np.testing.assert_allclose(evidence.distance_px, similarity.distance(contours, rest)[0], rtol=1e-6)
    np.testing.assert_array_equal(np.isnan(evidence.per_view_px), np.arange(len(scene.rig)) < n_missing)
    if n_missing < len(scene.rig):
        np.testing.assert_allclose(np.nanmean(evidence.per_view_px), evidence.distance_px, rtol=1e-6)
    hidden = evidence.visible_px == 0
    np.testing.assert_array_equal(np.isnan(evidence.explained), hidden)
    np.testing.assert_array_equal(np.isnan(evidence.per_part_px), hidden)
    assert ((evidence.explained[~hidden] >= 0) & (evidence.explained[~hidden] <= 1)).all()


@each("prediction")
@pytest.mark.parametrize("n_frames", [1, 2, 3, 12])
def test_predictions_are_possible_poses(use, n_frames, scene):
    body = scene.persons[0].body
    history = History(0.04 * np.arange(n_frames), around(scene, n_frames, 40.0, 0.5))
    candidates = made("prediction", use).predict(body, history, 0.04 * n_frames)
    assert candidates.shape == (len(candidates), body.dof)
    assert len(candidates) >= 1
    np.testing.assert_array_equal(candidates, body.clamped(candidates))
    later = History(history.times + 100.0, history.poses)
    again = made("prediction", use).predict(body, later, 0.04 * n_frames + 100.0)
    np.testing.assert_allclose(again, candidates, atol=1e-8)


@each("prediction")
@pytest.mark.parametrize("n_frames", [1, 2, 12])
def test_who_stands_still_is_predicted_to(use, n_frames, scene):
    person = scene.persons[0]
    history = History(0.04 * np.arange(n_frames), np.tile(person.q, (n_frames, 1)))
    candidates = made("prediction", use).predict(person.body, history, 0.04 * n_frames)
    np.testing.assert_allclose(candidates, np.tile(person.q, (len(candidates), 1)), atol=1e-9)


@each("estimation")
def test_an_estimate_is_a_possible_pose_no_worse_than_the_starts(use, scene, observation, cycle):
    objective = Objective(scene, 0, cycle.synthesis, cycle.similarity, observation)
    body, starts = scene.persons[0].body, around(scene, 2, 3.0, 0.02)
    starts.setflags(write=False)
    estimate: Estimate = made("estimation", use).estimate(objective, starts)
    np.testing.assert_array_equal(estimate.q, body.clamped(estimate.q))
    assert estimate.covariance.shape == (body.dof, body.dof)
    assert estimate.per_view_px.shape == (len(scene.rig),)
    assert estimate.per_part_px.shape == (len(body.parts),)
    assert estimate.evaluations >= 1
    # reported are the distances of full contours; a search may work with fewer samples
    assert estimate.distance_px == pytest.approx(objective.evidence(estimate.q).distance_px)
    assert estimate.distance_px <= min(objective.evidence(q).distance_px for q in starts)
    np.testing.assert_array_equal(made("estimation", use).estimate(objective, starts).q, estimate.q)


@each("initialization")
def test_with_nothing_to_go_by_no_start_is_made_up(use, scene, frame, cycle):
    blind = replace(cycle.stages, backgrounds=(None,) * len(scene.rig))
    with pytest.raises(InitializationError) as caught:
        made("initialization", use).start(frame, scene, blind)
    assert "\n" not in str(caught.value)


@each("reading")
def test_an_absent_recording_is_one_clear_line(use):
    with pytest.raises(TrackerError) as caught:
        made("reading", use).open()
    assert "/nowhere/absent" in str(caught.value)
    assert "\n" not in str(caught.value)


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
def steps(scene: Scene, frame: Frame, cycle: Cycle, observation: Observation) -> list[Step]:
    """A frame found, one lost with a view missing, one found again."""
    found = Objective(scene, 0, cycle.synthesis, cycle.similarity, observation).estimate(
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
