"""Bodies fitted to the recording before it is tracked: who is, from which frames, and that it brings them nearer."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from doubted import in_doubt
from recordings import TrueStart, cycle_for, small_simulation
from test_run import killed_after
from test_shape_space import some_shape, space

import tracker.acquisition.body_fit as body_fit
from tracker.acquisition.body_fit import best_seen, fit_bodies
from tracker.acquisition.calibrated_views import ViewSettings, Watching, fit_to_views, view_overlaps
from tracker.acquisition.fitting import FitSettings
from tracker.acquisition.shape_space import ShapePrior, space_of
from tracker.bodies.body.description import BodyDescription, read_description, save_description
from tracker.bodies.scene import Person, Scene
from tracker.foundation.errors import InitializationError
from tracker.foundation.progress import silent
from tracker.foundation.resources import model_path
from tracker.images.plate import Plate
from tracker.running.jobs import execute, load_job
from tracker.running.jobs._persons import _unlike
from tracker.running.jobs.track import TrackJob
from tracker.running.programs import Run
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Recipe, Simulation, write_sequence
from tracker.tracking.bootstrapping import first_start
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.found_before import FoundBefore
from tracker.tracking.initialization import Initialization
from tracker.tracking.loss import LossRule
from tracker.tracking.objective import Objective
from tracker.tracking.other_places import in_likeliest_places
from tracker.tracking.start import Start
from tracker.tracking.trajectory import Step
from tracker.tracking.windows import there

QUICK = ViewSettings(frames=4, rounds=1, fit=FitSettings(iterations=6, pose_deg=8.0, pose_m=0.05, rigid_share=0.2))
N_FRAMES = 8

pytestmark = pytest.mark.usefixtures("limbs_stay")


@pytest.fixture(scope="module")
def general() -> BodyDescription:
    return read_description(model_path("gavrila22"))


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    """Somebody with a body of her own."""
    of = space()
    path = tmp_path_factory.mktemp("models") / "herself.toml"
    save_description(of.described(some_shape(of, seed=3, share=0.8)), path, decimals=None)
    return small_simulation("two_elbow_rotation", n_frames=N_FRAMES, model=str(path))


@pytest.fixture(scope="module")
def as_general(filmed: Simulation, general: BodyDescription) -> Scene:
    """The scene as it is tracked: with the general body."""
    body = general.build()
    return Scene((Person("person1", body, body.rest()),), filmed.scene.rig)


def refining(simulation: Simulation, start: Initialization, **changes: object) -> Cycle:
    """A cycle without searches, which take most of the time: true starts are near enough."""
    return cycle_for(simulation, start, estimation=TwistIcpEstimation(), **changes)


def girths(scene: Scene) -> np.ndarray:
    return np.asarray(2000 * scene.persons[0].body.shapes[:, :2])


def test_a_body_comes_nearer_to_the_person_who_is_filmed(
    filmed: Simulation, as_general: Scene, general: BodyDescription
) -> None:
    cycle = refining(filmed, TrueStart(filmed))
    spaces = {0: space_of(general, ShapePrior())}
    found = fit_bodies(spaces, as_general, cycle, filmed.frames, N_FRAMES, QUICK)
    assert found.told == {0: "fitted to 4 of the first 8 frames"}
    fitted = as_general.with_bodies({0: found.fits[0].body})
    before, after = (np.abs(girths(scene) - girths(filmed.scene)).mean() for scene in (as_general, fitted))
    assert after < 0.6 * before

    def off_mm(scene: Scene) -> float:
        steps, _ = there(list(filmed.frames()), scene, cycle)
        ours = [step.scene.persons[0].body.landmarks_in_world(step.estimates[0].q) for step in steps]
        true = [filmed.scene.persons[0].body.landmarks_in_world(q) for q in filmed.poses[0]]
        return float(np.linalg.norm(np.array(ours) - true, axis=-1).mean())

    assert off_mm(fitted) < 0.8 * off_mm(as_general)


def half_known(filmed: Simulation) -> tuple[Plate, ...]:
    """Plates that do not know what is behind a strip of each view, a quarter to two fifths of the person in it."""
    person = CpuSynthesis().silhouettes(filmed.scene.with_poses(tuple(poses[0] for poses in filmed.poses)))
    found = []
    for k, (plate, mask) in enumerate(zip(filmed.plates, person, strict=True)):
        rows, unknown = np.flatnonzero(mask.any(axis=1)), np.zeros(mask.shape, dtype=bool)
        top = rows[0] + (k % 3) * (rows[-1] - rows[0]) // 4
        unknown[top : top + (rows[-1] - rows[0]) // 3] = True
        assert plate is not None
        found.append(replace(plate, unknown=unknown))
    return tuple(found)


def test_plates_that_do_not_know_all_make_a_body_too(
    filmed: Simulation, as_general: Scene, general: BodyDescription
) -> None:
    """Views with more than a fiftieth unknown were left out, which is most before backdrops of the recording's own."""
    cycle = refining(filmed, TrueStart(filmed), plates=half_known(filmed))
    found = fit_bodies({0: space_of(general, ShapePrior())}, as_general, cycle, filmed.frames, N_FRAMES, QUICK)
    assert found.told == {0: "fitted to 4 of the first 8 frames"}
    fitted = as_general.with_bodies({0: found.fits[0].body})
    before, after = (np.abs(girths(scene) - girths(filmed.scene)).mean() for scene in (as_general, fitted))
    assert after < 0.7 * before


def test_what_is_not_known_counts_neither_for_nor_against_a_model(filmed: Simulation) -> None:
    cycle = refining(filmed, TrueStart(filmed))
    steps, _ = there(list(filmed.frames()), filmed.scene, cycle)
    seen = best_seen(steps, 0, N_FRAMES, 2)
    herself = space_of(read_description(Path(filmed.recipe.model)), ShapePrior())
    shares = []
    for plates in (filmed.plates, half_known(filmed)):
        watching = Watching(filmed.scene.rig, cycle.synthesis, QUICK.analysis, plates)
        fit = fit_to_views(herself, (np.zeros(len(herself.names)), 0), seen, watching, QUICK)
        shares.append(view_overlaps(fit, seen, watching))
    np.testing.assert_allclose(*shares, atol=0.1)


def test_of_each_stretch_the_frame_is_kept_that_leaves_least_over(filmed: Simulation) -> None:
    steps, _ = there(list(filmed.frames()), filmed.scene, refining(filmed, TrueStart(filmed)))
    assert [one.frame.index for one in best_seen(steps, 0, N_FRAMES, 12)] == list(range(N_FRAMES))
    kept = [one.frame.index for one in best_seen(steps, 0, N_FRAMES, 3)]
    left_over = [step.estimates[0].account.left_over for step in steps]
    stretches = [[k for k in range(N_FRAMES) if k * 3 // N_FRAMES == n] for n in range(3)]
    assert kept == [min(stretch, key=left_over.__getitem__) for stretch in stretches]


def test_who_is_in_doubt_keeps_the_body_of_the_model(
    filmed: Simulation, as_general: Scene, general: BodyDescription
) -> None:
    cycle = refining(filmed, TrueStart(filmed), loss=LossRule(doubtful_above=0.0, again_after=100))
    found = fit_bodies({0: space_of(general, ShapePrior())}, as_general, cycle, filmed.frames, N_FRAMES, QUICK)
    assert not found.fits
    assert found.told == {0: "as the model has them: 0 of the first 8 frames without doubt"}
    steps, _ = there(list(filmed.frames()), as_general, cycle)
    assert not best_seen(steps, 0, N_FRAMES, 4)
    assert len(best_seen(steps, 0, N_FRAMES, 4, doubted_too=True)) == 4


def test_who_is_in_doubt_all_the_way_there_is_followed_back_first(
    filmed: Simulation, as_general: Scene, general: BodyDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    def there_in_doubt(*asked: object) -> tuple[list[Step], State]:
        steps, state = there(*asked)  # type: ignore[arg-type]
        return [replace(one, estimates=(in_doubt(one.estimates[0], whole=True),)) for one in steps], state

    monkeypatch.setattr(body_fit, "there", there_in_doubt)
    cycle, spaces = refining(filmed, TrueStart(filmed)), {0: space_of(general, ShapePrior())}
    found = fit_bodies(spaces, as_general, cycle, filmed.frames, N_FRAMES, QUICK)
    assert found.told == {0: "fitted to 4 of the first 8 frames"}
    assert [step.estimates[0].doubtful for step in found.steps] == [False] * (N_FRAMES - 1) + [True]


@pytest.fixture(scope="module")
def heavy(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    """Somebody whose radii are 40 % larger than those of the general body."""
    of = space()
    path = tmp_path_factory.mktemp("models") / "heavy.toml"
    thick = np.where([name == "girth" for name in of.names], 0.4, 0.0)
    save_description(of.described(thick), path, decimals=None)
    return small_simulation("two_elbow_rotation", n_frames=N_FRAMES, model=str(path))


@pytest.fixture(scope="module")
def doubting(heavy: Simulation, as_general: Scene) -> Cycle:
    """In which every frame is doubtful with the general body, and none with their own."""
    cycle = refining(heavy, TrueStart(heavy))
    general, own = (
        [step.estimates[0].account.left_over for step in there(list(heavy.frames()), scene, cycle)[0]]
        for scene in (as_general, heavy.scene)
    )
    assert max(own) < min(general)
    between = 0.5 * (max(own) + min(general))
    return replace(cycle, loss=LossRule(doubtful_above=between, ambiguous_above=9.0, again_after=100))


def test_who_is_in_doubt_is_fitted_all_the_same_if_that_ends_the_doubts(
    heavy: Simulation, as_general: Scene, general: BodyDescription, doubting: Cycle
) -> None:
    found = fit_bodies({0: space_of(general, ShapePrior())}, as_general, doubting, heavy.frames, N_FRAMES, QUICK)
    assert found.told == {0: "fitted to 4 of the first 8 frames, which were in doubt before"}
    fitted = as_general.with_bodies({0: found.fits[0].body})
    before, after = (np.abs(girths(scene) - girths(heavy.scene)).mean() for scene in (as_general, fitted))
    assert after < 0.5 * before
    assert sum(step.estimates[0].doubtful for step in found.steps) <= N_FRAMES // 2


def test_who_was_not_found_for_sure_is_not_fitted_in_spite_of_doubts(
    heavy: Simulation, as_general: Scene, general: BodyDescription, doubting: Cycle
) -> None:
    """A pose that is wrong makes a body that fits it, and then nothing is in doubt."""

    class Unsure(TrueStart):
        def start(self, *asked: object) -> Start:
            return replace(super().start(*asked), sureness=(0.5,), hypotheses=((),))  # type: ignore[arg-type]

    cycle = replace(doubting, initialization=Unsure(heavy))
    found = fit_bodies({0: space_of(general, ShapePrior())}, as_general, cycle, heavy.frames, N_FRAMES, QUICK)
    assert found.told == {0: "as the model has them: 0 of the first 8 frames without doubt"}


def test_a_start_is_not_looked_for_again_but_those_of_other_frames_are(filmed: Simulation) -> None:
    cycle = refining(filmed, TrueStart(filmed))
    first, second = itertools.islice(filmed.frames(), 2)
    steps, _ = there([first], filmed.scene, cycle)
    known, start = {0: steps[0].estimates}, steps[0].start
    more = cycle.knowing(known, start).knowing(known, start)
    assert more.before.estimates == known
    np.testing.assert_array_equal(first_start(first, filmed.scene, more).poses[0], steps[0].estimates[0].q)
    np.testing.assert_array_equal(
        first_start(second, filmed.scene, more).poses, first_start(second, filmed.scene, cycle).poses
    )
    unsure = {0: (in_doubt(steps[0].estimates[0], whole=True),)}
    assert cycle.knowing(unsure, start).before.start is None


def test_edges_alone_make_no_body(filmed: Simulation, as_general: Scene, general: BodyDescription) -> None:
    cycle = refining(filmed, TrueStart(filmed), plates=(filmed.plates[0], None, None, None))
    found = fit_bodies({0: space_of(general, ShapePrior())}, as_general, cycle, filmed.frames, N_FRAMES, QUICK)
    assert (found.fits, found.steps) == ({}, ())
    assert found.told == {0: "as the model has them: no background is known in 2 views"}


def test_the_run_starts_with_the_poses_that_bodies_were_fitted_at(
    filmed: Simulation, as_general: Scene, general: BodyDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    cycle = refining(filmed, TrueStart(filmed))
    monkeypatch.setattr(body_fit, "back", None)  # nobody is in doubt, nor carries anything
    found = fit_bodies({0: space_of(general, ShapePrior())}, as_general, cycle, filmed.frames, N_FRAMES, QUICK)
    first = next(iter(filmed.frames()))
    known = {step.frame.index: step.estimates for step in found.steps}
    start = first_start(first, as_general, cycle.knowing(known, found.start))
    np.testing.assert_array_equal(start.poses[0], found.steps[0].estimates[0].q)
    assert not np.array_equal(found.fits[0].body.shapes, as_general.persons[0].body.shapes)


def test_the_way_found_before_is_gone_again_beside_itself(filmed: Simulation) -> None:
    """By what another body's joints lie beside; not where somebody is elsewhere by now, or was in doubt."""
    cycle, person = refining(filmed, TrueStart(filmed)), filmed.scene.persons[0]
    steps, _ = there(list(filmed.frames()), filmed.scene, cycle)
    known = {10 * k: step.estimates for k, step in enumerate(steps)}  # frames of a run may be strides apart
    (one, other), beside = (steps[k].estimates[0].q for k in (1, 2)), np.full(person.body.dof, 0.01)

    def again(q: np.ndarray, known: dict[int, tuple[Estimate, ...]], index: int) -> tuple[np.ndarray | None, ...]:
        return FoundBefore(estimates=known).gone_again(filmed.scene.with_pose(0, q), index)

    np.testing.assert_allclose(again(one + beside, known, 20)[0], person.body.clamped(other + beside), atol=1e-12)
    assert again(one + beside, known, 25) == ()
    assert again(one + 30 * beside, known, 20) == (None,)
    assert again(one, {**known, 20: (in_doubt(steps[2].estimates[0], whole=True),)}, 20) == (None,)


def test_what_is_known_is_taken_where_it_explains_more(filmed: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tracker.tracking.cycle_turn.in_likeliest_places", in_likeliest_places)
    cycle = cycle_for(filmed, TrueStart(filmed, off_deg=0.0, off_m=0.0), estimation=ArmUp())
    steps, _ = there(list(filmed.frames()), filmed.scene, cycle)
    true = {k: (replace(steps[k].estimates[0], q=filmed.poses[0][k]),) for k in range(N_FRAMES)}
    knowing = replace(cycle, before=FoundBefore(estimates=true))
    off, near = (
        [float(np.abs(step.estimates[0].q - filmed.poses[0][step.frame.index]).max()) for step in taken]
        for taken in (steps, there(list(filmed.frames()), filmed.scene, knowing)[0])
    )
    assert min(off) > 0.2
    assert max(near[1:]) < 0.001


class ArmUp:
    """Always has an arm elsewhere than predicted."""

    def estimate(self, objective: Objective, candidates: np.ndarray) -> Estimate:
        q = candidates[0].copy()
        q[objective.body.index("left_arm_abduction")] += 0.5
        return objective.estimate(q, np.zeros((len(q), len(q))), 1)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> TrackJob:
    """Four frames, of whose person the stature alone is told."""
    folder = tmp_path_factory.mktemp("run") / "sequence"
    config = write_sequence(Recipe("arm_swing", seconds=0.16, size=(320, 256)), folder)
    start = ["initialization.use=given", "initialization.poses=truth_poses.csv", "passes=1", "inspection=false"]
    start += ["evidence=contours", "estimation.use=twist_icp"]
    outputs = "recordings=[{use='csv_table'},{use='journal'},{use='run_json'}]"
    return load_job("track", config, [*start, outputs, "persons.0.stature_m=1.78", "persons.0.carries=[]"])


def test_a_run_keeps_the_body_that_it_has_fitted_and_goes_on_with_it(
    run: TrackJob, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tracker.running.jobs._persons.ViewSettings", lambda: QUICK)
    said: list[str] = []
    whole = execute(run, tmp_path / "whole", progress=lambda what, *_: said.append(what))
    words = "lengths and shapes fitted to 4 of the first 4 frames"
    assert f"person1: {words}" in said
    kept = read_description(whole.folder / "models" / "person1.toml")
    assert "fitted to 4 of the first 4 frames" in kept.about
    assert kept.sigmas
    assert kept.parts != run.persons[0].description().parts
    part = killed_after(2, whole.folder, tmp_path / "part")
    said.clear()
    resumed = execute(run, part, resume=True, progress=lambda what, *_: said.append(what))
    assert not any("lengths and shapes" in line for line in said)
    for name in ("poses.csv", "joints.csv", "models/person1.toml"):
        assert (resumed.folder / name).read_bytes() == (whole.folder / name).read_bytes()
    steps = list(Run(run))
    np.testing.assert_array_equal(steps[-1].scene.persons[0].body.shapes, kept.build().shapes)


@pytest.mark.parametrize(("told_m", "fitted_m", "said"), [(2.2, 2.12, True), (1.65, 1.72, True), (1.78, 1.8, False)])
def test_a_stature_that_the_images_contradict_is_told(
    run: TrackJob, told_m: float, fitted_m: float, said: bool
) -> None:
    """The fit goes part of the way only; of 2 cm nothing is said."""
    lines = list(_unlike(replace(run.persons[0], stature_m=told_m), fitted_m))
    assert [f"told {told_m:.2f} m" in line and "stature_m right" in line for line in lines] == [True] * said


def test_nobody_found_is_an_error_before_anything_is_written(
    run: TrackJob, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nobody(*_: object) -> Start:
        raise InitializationError("nobody there")

    monkeypatch.setattr(type(run.initialization), "start", nobody)
    with pytest.raises(InitializationError, match="nobody there"):
        execute(replace(run, loss=LossRule(start_within=2)), tmp_path / "out", progress=silent)
    assert not (tmp_path / "out").exists()


def test_a_long_recording_is_followed_through_its_first_frames_alone(
    filmed: Simulation, as_general: Scene, general: BodyDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(body_fit, "LONGEST", 5)
    cycle = refining(filmed, TrueStart(filmed))
    found = fit_bodies({0: space_of(general, ShapePrior())}, as_general, cycle, filmed.frames, N_FRAMES, QUICK)
    assert found.told == {0: "fitted to 4 of the first 5 frames"}
