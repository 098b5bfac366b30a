"""Persons who walk in are waited for and followed back; who is seen by one view alone is lost, and limbs ambiguous."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation, with_images

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence.auto import AutoEvidence
from tracker.foundation.arrays import Image
from tracker.foundation.errors import InitializationError
from tracker.foundation.progress import Progress
from tracker.images.inspection import first_in_view
from tracker.images.plate import Plate
from tracker.images.sight import Sight
from tracker.running.jobs.track import TrackJob
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.cycle_turn import objective_of
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.estimation.hybrid import HybridEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.loss import LossRule
from tracker.tracking.outcome import still_lost
from tracker.tracking.sequence import track
from tracker.tracking.two_passes import track_twice
from tracker.tracking.visibility import judged_in_view

NOBODY_BEFORE = 6
BRIEF = HybridEstimation(rounds=1)
"""Searches the whole pose as usual, limbs less."""


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("walking_on_the_spot", n_frames=13)


@pytest.fixture(scope="module")
def frames(simulation: Simulation) -> tuple[Frame, ...]:
    return tuple(simulation.frames())


def entering(simulation: Simulation, n_views: tuple[int, ...]) -> tuple[Frame, ...]:
    """Frames in which only so many views show the person; in the last ones all."""

    def shown(t: int, v: int, image: Image | None) -> Image | None:
        return simulation.plates[v].picture.copy() if t < len(n_views) and v >= n_views[t] else image

    return tuple(with_images(simulation, shown))


@pytest.fixture
def limbs_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    """No start looks for limbs elsewhere: they are near enough, and it takes a third of the time."""
    monkeypatch.setattr("tracker.tracking.cycle_turn.in_likeliest_places", lambda _, estimate, *more: estimate)


@pytest.fixture
def refined_only(limbs_stay: None) -> TwistIcpEstimation:
    """An estimation that searches nothing: the search for who is not there would take most of the time."""
    return TwistIcpEstimation()


def judged(
    frame: Frame, scene: Scene, plates: tuple[Plate | None, ...], looked: bool = True, least_views: int = 2
) -> Estimate:
    """What is made of an estimate at the poses of a scene."""
    simulation = replace(small_simulation(n_frames=1), scene=scene)
    cycle, sight = cycle_for(simulation, plates=plates), Sight(frame, plates)
    contours = CpuSynthesis().contours(scene)
    objective = objective_of(scene, 0, cycle, cycle.evidence.observe(Sight(frame), contours))
    estimate = objective.estimate(scene.persons[0].q, np.eye(scene.persons[0].body.dof), 0)
    silhouettes: list[tuple[np.ndarray, ...]] = []
    if looked:
        for v, image in enumerate(frame.images):
            if image is not None:
                sight.changes(v, (0, 0, image.shape[1], image.shape[0]))
        silhouettes = [CpuSynthesis().silhouettes(scene)]
    (found,) = judged_in_view(sight, scene, (estimate,), silhouettes, least_views)
    return found


def pictures(frame: Frame) -> tuple[Image, ...]:
    return tuple(image for image in frame.images if image is not None)


def cropped(rig: Rig, views: tuple[int, ...], size: tuple[int, int]) -> Rig:
    """The rig with smaller images of some views, cut at the right and at the bottom."""
    return Rig(tuple(replace(one, size=size) if v in views else one for v, one in enumerate(rig.cameras)))


def test_who_is_whole_in_view_stays_as_estimated(simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    found = judged(frames[0], simulation.scene, simulation.plates)
    assert found.status is Status.TRACKED
    assert found.ambiguous == ()


@pytest.mark.parametrize(("n_shown", "status"), [(0, Status.LOST), (1, Status.LOST), (2, Status.TRACKED)])
def test_who_is_before_plates_of_all_views_but_one_is_lost(
    simulation: Simulation, frames: tuple[Frame, ...], n_shown: int, status: Status
) -> None:
    images = tuple(image if v < n_shown else simulation.plates[v].picture for v, image in enumerate(frames[0].images))
    frame = replace(frames[0], images=images)
    assert judged(frame, simulation.scene, simulation.plates).status is status
    assert judged(frame, simulation.scene, simulation.plates, least_views=0).status is Status.TRACKED


def test_views_that_cannot_tell_do_not_speak_against_a_person(
    simulation: Simulation, frames: tuple[Frame, ...]
) -> None:
    """One has no plate, one no image; a third one shows nobody."""
    images = (frames[0].images[0], simulation.plates[1].picture, simulation.plates[2].picture, None)
    plates = (None, None, *simulation.plates[2:])
    frame = replace(frames[0], images=images)
    assert judged(frame, simulation.scene, plates).status is Status.TRACKED
    everything = tuple(255 - plate.picture for plate in simulation.plates)
    assert judged(replace(frame, images=everything), simulation.scene, simulation.plates).status is Status.TRACKED


def test_limbs_outside_all_images_but_one_are_ambiguous(simulation: Simulation, frames: tuple[Frame, ...]) -> None:
    """However edges lie; also without any plate."""
    person = simulation.scene.persons[0]
    marks = simulation.scene.rig.project(person.body.landmarks_in_world(person.q))
    knees = [person.body.landmark_names.index(f"{side}_knee") for side in ("left", "right")]
    views = (0, 1, 2)
    height = int(min(marks[v, knees, 1].min() for v in views))
    scene = Scene(simulation.scene.persons, cropped(simulation.scene.rig, views, (360, height)))
    images = tuple(image[:height] if v in views else image for v, image in enumerate(pictures(frames[0])))
    found = judged(replace(frames[0], images=images), scene, (None,) * 4, looked=False)
    assert found.status is Status.TRACKED
    assert found.doubts == tuple(Doubt(limb, Because.FEW_VIEWS, 1, 2) for limb in ("left_leg", "right_leg"))


def test_who_is_outside_all_images_but_one_is_lost_without_plates(
    simulation: Simulation, frames: tuple[Frame, ...]
) -> None:
    views = (1, 2, 3)
    scene = Scene(simulation.scene.persons, cropped(simulation.scene.rig, views, (150, 150)))
    images = tuple(
        None if image is None else image[:150, :150] if v in views else image
        for v, image in enumerate(frames[0].images)
    )
    assert judged(replace(frames[0], images=images), scene, (None,) * 4, looked=False).status is Status.LOST


def test_the_first_frame_in_view_is_that_in_which_two_views_show_somebody(
    simulation: Simulation, frames: tuple[Frame, ...]
) -> None:
    assert first_in_view(frames, simulation.plates) == 0
    assert first_in_view(entering(simulation, (0, 0, 1, 1, 2, 2)), simulation.plates) == 4
    assert first_in_view(frames[3:], simulation.plates) == 3
    assert first_in_view(entering(simulation, (1,) * 13), simulation.plates) is None
    told: list[str] = []
    first_in_view(entering(simulation, (0, 0)), simulation.plates, progress=lambda line, *_: told.append(line))
    assert told == ["looking for the first frame that shows somebody"]


def test_poses_that_nobody_has_do_not_count_in_the_overlap(
    joined_later: Simulation, simulation: Simulation, refined_only: TwistIcpEstimation
) -> None:
    """Who is not there leaves the other one's overlap as it is; with nobody there is none."""
    frames = [next(iter(joined_later.frames())), second_from(joined_later, 8)[1]]
    both = cycle_for(joined_later, TrueStart(joined_later), evidence=AutoEvidence(), loss=LossRule(rehearse=0))
    both = replace(both, estimation=refined_only)
    steps = list(track(iter(frames), joined_later.scene, both))
    assert [one.lost for one in steps[1].estimates] == [False, True]
    assert steps[1].overlap is not None
    assert steps[1].overlap.min() > 0.6
    cycle = cycle_for(simulation, TrueStart(simulation), estimation=refined_only)
    *_, last = track(iter([next(simulation.frames()), entering(simulation, (0, 0))[1]]), simulation.scene, cycle)
    assert last.estimates[0].lost
    assert last.overlap is not None
    assert np.isnan(last.overlap).all()


def test_where_too_few_views_can_tell_nobody_is_waited_for(simulation: Simulation) -> None:
    empty = entering(simulation, (0,) * 13)
    asked = iter(empty)
    assert first_in_view(asked, (simulation.plates[0], None, None, None)) is None
    assert next(asked).index == 1, "the recording is not read to its end"
    somewhere = np.zeros(simulation.plates[0].picture.shape[:2], np.bool_)
    somewhere[:9] = True
    in_doubt = tuple(replace(one, unknown=somewhere) for one in simulation.plates)
    assert first_in_view(empty, in_doubt) == 0


def test_who_is_cut_by_images_at_first_is_looked_for_where_most_show_all(simulation: Simulation) -> None:
    """A view after the other shows all of her."""

    def shown(t: int, v: int, image: Image | None) -> Image | None:
        cut = simulation.plates[v].picture.copy()
        assert image is not None
        if t >= 2 * v:
            return image
        cut[:, -180:] = image[:, 90:270]
        return cut

    assert first_in_view(with_images(simulation, shown), simulation.plates) == 4


@pytest.fixture(scope="module")
def joined_later() -> Simulation:
    """Two persons; see `second_from`."""
    return small_simulation("arm_swing", n_frames=10, persons=2)


def second_from(simulation: Simulation, t: int) -> list[Frame]:
    """Frames of two persons, of whom the second is there from frame `t` on."""
    scene = simulation.scene
    alone = replace(simulation, scene=Scene(scene.persons[:1], scene.rig), poses=simulation.poses[:1])
    pairs = zip(alone.frames(), simulation.frames(), strict=True)
    return [both if both.index >= t else one for one, both in pairs]


def test_several_are_waited_for_until_two_views_show_them_all(joined_later: Simulation) -> None:
    frames, plates = second_from(joined_later, 6), joined_later.plates
    told: list[str] = []
    assert first_in_view(frames, plates, 2, lambda line, *_: told.append(line)) == 6
    assert told == ["looking for the first frame that shows all 2 persons"]
    assert first_in_view(frames, plates) == 0
    assert first_in_view(joined_later.frames(), plates, 2) == 0
    assert first_in_view(frames, plates, 3) is None
    one_view = [replace(frame, images=(frame.images[0], *frames[0].images[1:])) for frame in frames]
    assert first_in_view(one_view, plates, 2) is None, "both are apart in a single view alone"


def test_who_joins_later_is_lost_before_and_the_other_one_is_tracked_throughout(
    joined_later: Simulation, refined_only: TwistIcpEstimation
) -> None:
    frames = second_from(joined_later, 6)
    cycle = cycle_for(joined_later, TrueStart(joined_later), evidence=AutoEvidence(), nobody_before=6)
    cycle = replace(cycle, loss=LossRule(rehearse=0), estimation=refined_only)
    steps = list(track_twice(iter(frames), joined_later.scene, cycle, {}, lambda: iter(frames)))
    for step in steps:
        there, later = step.estimates
        assert not there.lost
        assert joint_errors_mm(joined_later, 0, step.frame.index, there.q).mean() < 15
        assert later.lost == (step.frame.index < 6)


@pytest.mark.parametrize(
    ("views", "lost"),
    [
        ("absent shows hidden hidden", True),
        ("hidden shows hidden hidden", False),
        ("absent shows shows hidden", False),
        ("absent hidden hidden hidden", True),
    ],
)
def test_views_that_others_hide_somebody_from_do_not_count_against_one_that_does_not_show_him(
    joined_later: Simulation, views: str, lost: bool
) -> None:
    """The second person is not there; where he is said to be shown his silhouette is where the first one is."""
    frame, scene, drawn = second_from(joined_later, 6)[0], joined_later.scene, CpuSynthesis()
    one, other = (drawn.silhouettes(replace(scene, persons=(person,))) for person in scene.persons)
    first, second = [], []
    for v, how in enumerate(views.split()):
        first.append(np.zeros_like(one[v]) if how == "shows" else one[v])
        second.append(other[v] & ~one[v] if how == "absent" else one[v])
    sight = Sight(frame, joined_later.plates)
    for v, image in enumerate(frame.images):
        assert image is not None
        sight.changes(v, (0, 0, image.shape[1], image.shape[0]))
    found = replace(judged(frame, Scene(scene.persons[:1], scene.rig), joined_later.plates), status=Status.TRACKED)
    _, judged_second = judged_in_view(sight, scene, (found, found), (first, second), 2)
    assert judged_second.lost == lost


@pytest.mark.usefixtures("limbs_stay")
def test_who_leaves_and_comes_back_is_looked_for_now_and_then(joined_later: Simulation) -> None:
    """Not in every frame, though his model explains the contours of the one who stayed."""
    frames = second_from(joined_later, 6)[:8]
    frames[0] = next(iter(joined_later.frames()))
    start = TrueStart(joined_later)
    cycle = cycle_for(joined_later, start, evidence=AutoEvidence(), loss=LossRule(rehearse=0), estimation=BRIEF)
    steps = list(track(iter(frames), joined_later.scene, cycle))
    assert [step.estimates[1].lost for step in steps] == [False, *[True] * 5, False, False]
    # When he leaves, his model ends up in the one who stayed, and is sought at once, or beside him, and is not: which
    # of both changes with 0.1 deg in the first pose, and with the processor.
    assert [t for t in start.asked if t != 1] == [0, 4, 6]
    assert not any(step.estimates[0].lost for step in steps)
    errors = [joint_errors_mm(joined_later, k, 7, steps[7].estimates[k].q).mean() for k in (0, 1)]
    assert max(errors) < 15


def test_a_run_of_persons_who_are_never_apart_waits_for_the_first_one(
    joined_later: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []

    def first(frames: object, plates: object, n_persons: int, progress: Progress) -> int | None:
        asked.append(n_persons)
        return 3 if n_persons == 1 else None

    monkeypatch.setattr("tracker.running.jobs._messages.first_in_view", first)
    told: list[str] = []
    cycle = cycle_for(joined_later, progress=lambda line, *_: told.append(line))
    opened = SimpleNamespace(scene=joined_later.scene, frames=joined_later.frames, sequence=None)
    opened.reading = SimpleNamespace(start=0)
    job = SimpleNamespace(initialization=None, reading=opened.reading, passes=2)
    assert TrackJob._first_in_view(job, opened, cycle) == 3  # type: ignore[arg-type]
    assert asked == [2, 1]
    assert told == [
        "nobody is seen whole before frame 3: the start is looked for there, "
        "and the frames before are tracked back from it"
    ]


@pytest.mark.parametrize(("since", "n_views", "lost"), [(0, 0, False), (3, 0, True), (3, 1, True), (3, 4, False)])
def test_who_was_lost_still_is_where_too_few_views_show_him(
    simulation: Simulation, since: int, n_views: int, lost: bool
) -> None:
    """Or he would be looked for anew in every frame, as if just seen again."""
    frame, scene = entering(simulation, (n_views,))[0], simulation.scene
    found = replace(judged(frame, scene, simulation.plates, least_views=0), status=Status.TRACKED)
    sight = Sight(frame, simulation.plates)
    for v, image in enumerate(frame.images):
        assert image is not None
        sight.changes(v, (0, 0, image.shape[1], image.shape[0]))
    (still,) = still_lost(sight, scene, CpuSynthesis(), [found], [since], 2)
    assert still.lost == lost
    assert lost or still is found


def test_a_run_waits_for_who_walks_in_and_follows_back(
    simulation: Simulation, refined_only: TwistIcpEstimation
) -> None:
    frames = entering(simulation, (0, 0, 0, 3, 4, 4))
    start = TrueStart(simulation)
    loss = LossRule(rehearse=0, start_within=1)
    cycle = cycle_for(simulation, start, evidence=AutoEvidence(), nobody_before=NOBODY_BEFORE, loss=loss)
    cycle = replace(cycle, estimation=refined_only)
    there = list(track(iter(frames[NOBODY_BEFORE:]), simulation.scene, cycle, {}, lambda: iter(frames)))
    for way in (track, track_twice):
        start.asked.clear()
        steps = list(way(iter(frames), simulation.scene, cycle, {}, lambda: iter(frames)))
        statuses = [step.estimates[0].status for step in steps]
        assert start.asked[0] == NOBODY_BEFORE
        assert statuses[:3] == [Status.LOST] * 3
        assert (Status.LOST in statuses[3:]) == (way is track)
        if way is track:
            begun, alone = steps[NOBODY_BEFORE].estimates[0], there[0].estimates[0]
            np.testing.assert_allclose(begun.q, alone.q, atol=1e-5)
        errors = [joint_errors_mm(simulation, 0, step.frame.index, step.estimates[0].q).mean() for step in steps]
        assert max(errors[4 if way is track_twice else NOBODY_BEFORE :]) < 15


def test_frames_before_somebody_is_in_view_do_not_count(simulation: Simulation) -> None:
    class Nobody(TrueStart):
        def start(self, frame: Frame, *given: object) -> object:  # type: ignore[override]
            self.asked.append(frame.index)
            raise InitializationError("nobody there")

    for way in (track, track_twice):
        nobody = Nobody(simulation)
        cycle = cycle_for(simulation, nobody, nobody_before=NOBODY_BEFORE, loss=LossRule(start_within=3))
        with pytest.raises(InitializationError, match="nobody there"):
            list(way(simulation.frames(), simulation.scene, cycle, {}, simulation.frames))
        assert nobody.asked == list(itertools.islice(itertools.count(NOBODY_BEFORE), 3))


def test_who_leaves_is_lost_and_nobody_is_made_of_the_last_view(
    simulation: Simulation, refined_only: TwistIcpEstimation
) -> None:
    def shown(t: int, v: int, image: Image | None) -> Image | None:
        return simulation.plates[v].picture.copy() if t >= 2 and v > 0 else image

    cycle = cycle_for(simulation, TrueStart(simulation), evidence=AutoEvidence(), estimation=refined_only)
    frames = itertools.islice(with_images(simulation, shown), 7)
    statuses = [step.estimates[0].status for step in track(frames, simulation.scene, cycle)]
    assert Status.LOST not in statuses[:2]
    assert statuses[2:] == [Status.LOST] * 5
