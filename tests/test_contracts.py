"""What every component found in a stage must do: a new file is tested without a word in here.

Those that read and write files have `test_file_contracts.py`, those that predict `test_prediction.py`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
import sections
from detected import detected, written
from followed import followed
from recordings import around, cycle_for, small_simulation
from renderers import working
from rounding import SINGLE
from scipy.spatial import cKDTree
from sections import each, made

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence import GUESSED, Evidence
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.regions import RegionEvidence
from tracker.foundation.configuration.components import available
from tracker.foundation.errors import ConfigError, InitializationError
from tracker.images.analysis.contours import ContourAnalysis
from tracker.images.sight import Observation, Sight
from tracker.kernels.contours import directed_distances
from tracker.kernels.regions import Lines
from tracker.synthesis._pictures import misfits_of
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimate import Estimate
from tracker.tracking.objective import Objective

HINTS = {"departures", "motion"}
"""Evidence that is used beside other evidence only: of limbs that are missing (tests/test_departures.py), of what has
moved since the frame before (tests/test_motion_evidence.py), no pose."""

whole_evidence = pytest.mark.parametrize("use", sorted(set(available("evidence")) - HINTS))


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation(n_frames=2)


@pytest.fixture(scope="module")
def scene(simulation: Simulation) -> Scene:
    """The person as it is in frame 0."""
    return simulation.scene


@pytest.fixture(scope="module", autouse=True)
def keypoints(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Files of what a detector would have found in frame 0."""
    pattern = written(detected(scene, noise_px=1.0), scene.rig.names, tmp_path_factory.mktemp("keypoints"))
    sections.GIVEN["evidence", "keypoints"] = {"path": pattern}
    yield
    del sections.GIVEN["evidence", "keypoints"]


@pytest.fixture(scope="module", autouse=True)
def points(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Tables of points on the person that each view shows in frame 0."""
    person = scene.persons[0]
    path = followed(person.body, person.q[None], scene.rig, tmp_path_factory.mktemp("points"))
    sections.GIVEN["evidence", "points"] = {"path": path}
    yield
    del sections.GIVEN["evidence", "points"]


@pytest.fixture(scope="module", autouse=True)
def stances(scene: Scene) -> Iterator[None]:
    """Persons are looked for in few stances, not far away: `test_low_persons.py` tries all of them."""
    few = {"stances_deg": scene.persons[0].body.start.stances_deg[:2], "farthest_m": 6.0, "hypotheses": 3}
    sections.GIVEN.update({("initialization", "stance"): few, ("initialization", "auto"): {"stance": few}})
    yield
    del sections.GIVEN["initialization", "stance"], sections.GIVEN["initialization", "auto"]


@pytest.fixture(scope="module")
def frame(simulation: Simulation) -> Frame:
    """Frame 0, its images read-only."""
    first = next(iter(simulation.frames()))
    for image in first.images:
        image.setflags(write=False)  # type: ignore[union-attr]
    return first


@pytest.fixture(scope="module")
def cycle(simulation: Simulation) -> Cycle:
    return cycle_for(simulation)


@pytest.fixture(scope="module")
def observation(scene: Scene, frame: Frame, cycle: Cycle) -> Observation:
    return ContourAnalysis().observe(Sight(frame, cycle.plates), cycle.synthesis.contours(scene))


def one_line(text: str) -> str:
    return " ".join(text.split())


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
    observation = made("analysis", use).observe(Sight(one_missing, cycle.plates), expected)
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
    one, other = (made("analysis", use).observe(Sight(frame, cycle.plates), expected) for _ in range(2))
    for mine, theirs in zip(one.packed, other.packed, strict=True):
        np.testing.assert_array_equal(mine, theirs)


@each("analysis")
def test_the_true_contours_are_found_in_the_images(use, scene, frame, cycle):
    evidence = ContourEvidence(analysis=made("analysis", use))
    found = evidence.observe(Sight(frame, cycle.plates), cycle.synthesis.contours(scene))
    asked = Comparison(scene, 0, cycle.synthesis, found)
    assert evidence.account(asked, scene.persons[0].q).explained > 0.6


@each("analysis")
def test_what_was_looked_at_ahead_is_what_is_seen(use, scene, frame, cycle):
    contours, analysis = cycle.synthesis.contours(scene), made("analysis", use)
    ahead, fresh = Sight(frame, cycle.plates), Sight(frame, cycle.plates)
    analysis.look(ahead, contours)
    one, other = analysis.observe(ahead, contours), analysis.observe(fresh, contours)
    for mine, theirs in zip(one.views, other.views, strict=True):
        near = cKDTree(mine.edges[mine.accepted]).query(theirs.edges[theirs.accepted])[0]
        assert np.quantile(near, 0.98) < 0.5


@each("synthesis")
def test_the_service_of_searches_says_what_the_contours_say(use, scene, observation):
    """One pose, one number: batched and compiled, or contour by contour."""
    synthesis, poses = working(use, scene), around(scene, 3, 8.0, 0.05)
    edges, drawn = observation.packed, synthesis.contours(scene, 0, poses, coarse=True)
    for reject in (False, True):
        plain = directed_distances(drawn.positions, drawn.counts, *edges[:4], 40.0, reject)
        found = synthesis.directed_distances(scene, 0, poses, observation, 40.0, reject)
        np.testing.assert_allclose(found, plain, rtol=0.02 if use == "egl" else SINGLE)


@each("synthesis")
def test_the_service_of_colours_says_what_the_contours_say(use, scene, frame, cycle):
    synthesis, q = working(use, scene), scene.persons[0].q
    poses = np.tile(q, (3, 1))
    poses[1:, scene.persons[0].body.group("left_arm")] += np.array([[0.1], [-0.2]])
    evidence, sight = RegionEvidence(), Sight(frame, cycle.plates)
    known = evidence.learned(
        None, sight, scene, cycle.synthesis.contours(scene), np.ones((len(scene.rig), len(scene.shapes)), dtype=bool)
    )
    picture = evidence.observe(sight, cycle.synthesis.contours(scene), known).picture
    lines = Lines(picture, known.looks, np.ones(len(scene.shapes), dtype=bool), evidence.rule())
    found = synthesis.region_misfits(scene, 0, poses, lines)
    drawn = synthesis.contours(scene, 0, poses, coarse=True)
    plain = misfits_of(scene, scene.world_from_parts(0, poses), drawn, lines)
    assert found.shape == plain.shape == (3, len(scene.rig), len(scene.shapes), 3)
    # a ray that grazes a part meets it or not as its bounds are drawn
    np.testing.assert_allclose(found.sum(axis=2), plain.sum(axis=2), rtol=0.02)


@each("similarity")
def test_a_distance_is_least_near_the_truth_whatever_else_is_in_the_batch(use, scene, observation, cycle):
    similarity, asked = made("similarity", use), Comparison(scene, 0, cycle.synthesis, observation)
    shifts = np.zeros((5, scene.persons[0].body.dof))
    shifts[:, 0] = [0.0, 0.05, -0.05, 0.1, -0.1]
    poses = scene.persons[0].q + shifts
    distances = similarity.distances(asked, poses)
    assert distances.shape == (5, len(scene.rig))
    assert (distances >= 0).all()
    mean = distances.mean(axis=1)
    assert mean[0] < mean[1:3].min() < mean[3:].min()
    singles = [similarity.distances(asked, q[None])[0] for q in poses]
    np.testing.assert_allclose(distances, singles, rtol=SINGLE)


@each("similarity")
@pytest.mark.parametrize("n_missing", [0, 1, 4])
def test_missing_views_have_no_distance(use, n_missing, scene, observation, cycle):
    rest = Observation((None,) * n_missing + observation.views[n_missing:])
    found = made("similarity", use).distances(Comparison(scene, 0, cycle.synthesis, rest), scene.persons[0].q[None])
    np.testing.assert_array_equal(np.isnan(found[0]), np.arange(len(scene.rig)) < n_missing)


@pytest.fixture(scope="module")
def observed(scene: Scene, frame: Frame, cycle: Cycle) -> Callable[..., Comparison]:
    """What a kind of evidence is asked when it has seen the frame near the true pose."""

    def ask(evidence: Evidence, n_missing: int = 0, **changes: object) -> Comparison:
        images = (None,) * n_missing + frame.images[n_missing:]
        sight = Sight(replace(frame, images=images), cycle.plates)
        contours = cycle.synthesis.contours(scene)
        # what is learned from a frame is known in the next one
        memory = evidence.learned(
            None, Sight(frame, cycle.plates), scene, contours, np.ones((len(scene.rig), len(scene.shapes)), dtype=bool)
        )
        return Comparison(scene, 0, cycle.synthesis, evidence.observe(sight, contours, memory))

    return ask


@each("evidence")
@pytest.mark.parametrize("n_missing", [0, 1, 4])
def test_one_pose_has_one_number(use, n_missing, scene, observed):
    evidence = made("evidence", use)
    asked, poses = observed(evidence, n_missing), around(scene, 3, 5.0, 0.03)
    distances = evidence.distances(asked, poses)
    assert distances.shape == (3,)
    assert np.isfinite(distances).all()
    for q, distance in zip(poses, distances, strict=True):
        account = evidence.account(asked, q)
        assert account.distance_px == pytest.approx(distance, rel=SINGLE)
        missing = np.arange(len(scene.rig)) < n_missing
        assert np.isnan(account.per_view_px[missing]).all()
        n_parts = len(scene.persons[0].body.parts)
        for lengths in (account.visible_px, account.explained_px, account.missed_px, account.per_part_px):
            assert lengths.shape == (n_parts,)
        assert (account.explained_px >= 0).all()
        assert (account.explained_px <= account.visible_px * (1 + 1e-9)).all()
        assert (account.missed_px >= 0).all()
        assert (np.isnan(account.per_part_px) == (account.visible_px == 0)).all()
        if account.by_view_px is not None:
            totals = account.visible_px, account.explained_px, account.missed_px
            np.testing.assert_allclose(account.by_view_px.sum(axis=1), totals, rtol=1e-9, atol=1e-9)
            assert not account.by_view_px[:, missing].any()


@each("evidence")
def test_a_guess_is_a_question_like_any_other(use, scene, frame, cycle):
    evidence, poses = made("evidence", use), around(scene, 3, 5.0, 0.03)
    seen = evidence.observe(Sight(frame, cycle.plates), cycle.synthesis.contours(scene), GUESSED)
    asked = Comparison(scene, 0, cycle.synthesis, seen)
    distances = evidence.distances(asked, poses)
    assert np.isfinite(distances).all()
    for q, distance in zip(poses, distances, strict=True):
        assert evidence.account(asked, q).distance_px == pytest.approx(distance, rel=1e-5)


@whole_evidence
def test_evidence_is_for_the_truth(use, scene, observed):
    evidence = made("evidence", use)
    asked, q = observed(evidence), scene.persons[0].q
    shifts = np.zeros((5, len(q)))
    shifts[:, 0] = [0.0, 0.06, -0.06, 0.15, -0.15]
    distances = evidence.distances(asked, q + shifts)
    assert distances[0] < distances[1:3].min() < distances[3:].min()
    accounts = [evidence.account(asked, pose) for pose in (q, q + shifts[3])]
    assert accounts[0].explained > accounts[1].explained
    assert accounts[0].left_over < accounts[1].left_over


@whole_evidence
def test_its_equations_lead_back_to_the_truth(use, scene, observed):
    evidence, body = made("evidence", use), scene.persons[0].body
    asked, truth = observed(evidence), scene.persons[0].q
    shift = np.zeros(body.dof)
    shift[:3] = 0.03, -0.02, 0.01
    q = truth + shift
    for _ in range(6):
        found = evidence.equations(asked, q, 25.0)
        np.testing.assert_allclose(found.matrix, found.matrix.T, atol=1e-9 * np.abs(found.matrix).max())
        assert found.total > 0
        assert found.squares >= 0
        # the root alone: everything else holds
        q = q.copy()
        q[:3] -= np.linalg.solve(found.matrix[:3, :3] + 1e-6 * np.eye(3), found.vector[:3])
    assert np.linalg.norm((q - truth)[:3]) < 0.4 * np.linalg.norm(shift)


@each("evidence")
def test_without_images_evidence_says_nothing(use, scene, observed):
    evidence = made("evidence", use)
    found = evidence.equations(observed(evidence, n_missing=4), scene.persons[0].q, 25.0)
    assert not found.matrix.any()
    assert not found.vector.any()
    assert found.total == 0


@each("evidence")
def test_what_is_learned_is_learned_again(use, scene, frame, cycle):
    """A resumed run learns from the same frames the same."""
    evidence, contours = made("evidence", use), cycle.synthesis.contours(scene)
    for trusted in (np.full((len(scene.rig), len(scene.shapes)), known) for known in (True, False)):
        once, again = (evidence.learned(None, Sight(frame, cycle.plates), scene, contours, trusted) for _ in range(2))
        poses = scene.persons[0].q[None]
        seen = [
            Comparison(scene, 0, cycle.synthesis, evidence.observe(Sight(frame, cycle.plates), contours, memory))
            for memory in (once, again)
        ]
        np.testing.assert_array_equal(*(evidence.distances(asked, poses) for asked in seen))


@each("estimation")
def test_an_estimate_is_a_possible_pose_no_worse_than_the_starts(use, scene, observation, cycle):
    objective = Objective(Comparison(scene, 0, cycle.synthesis, observation), ContourEvidence())
    body, starts = scene.persons[0].body, around(scene, 2, 3.0, 0.02)
    starts.setflags(write=False)
    estimate: Estimate = made("estimation", use).estimate(objective, starts)
    np.testing.assert_array_equal(estimate.q, body.clamped(estimate.q))
    assert estimate.covariance.shape == (body.dof, body.dof)
    assert estimate.account.per_view_px.shape == (len(scene.rig),)
    assert estimate.account.per_part_px.shape == (len(body.parts),)
    assert estimate.evaluations >= 1
    # reported is the number that the search ranked by
    assert estimate.distance_px == pytest.approx(objective(estimate.q[None])[0], rel=SINGLE)
    assert estimate.distance_px <= objective(starts).min() * (1 + SINGLE)
    np.testing.assert_array_equal(made("estimation", use).estimate(objective, starts).q, estimate.q)


@each("initialization")
def test_without_plates_or_a_start_file_a_start_is_refused_at_once_or_found(use, scene, frame, cycle):
    """Never made up: the person's pose is found, or among those that one frame cannot tell apart."""
    blind = replace(cycle.stages, plates=(None,) * len(scene.rig))
    initialization = made("initialization", use)
    try:
        told = initialization.check(scene, blind.plates)
    except ConfigError as refused:
        told = str(refused)
        assert told == one_line(told)
        return
    assert told == one_line(told)
    grey = replace(frame, images=tuple(np.full_like(image, 90) for image in frame.images))
    with pytest.raises(InitializationError) as caught:
        initialization.start(grey, scene, blind)
    assert "\n" not in str(caught.value)
    (person,), start = scene.persons, initialization.start(frame, scene, blind)
    found = np.array([one.q for one in start.hypotheses[0]]) if start.hypotheses else start.poses[0][None]
    gaps = person.body.landmarks_in_world(found) - person.body.landmarks_in_world(person.q)
    assert np.linalg.norm(gaps, axis=2).mean(axis=1).min() < 0.1
