"""Plates that do not know everything, made of the recording: what they say, and starts before them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation
from test_recorded_plate import LEAVING, STILL, WALKING, filmed, room
from test_silhouettes import asked

from tracker.acquisition.calibrated_views import _silhouette
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence.auto import AutoEvidence
from tracker.evidence.measures.outlines import Comparison, outline_observation
from tracker.evidence.silhouettes import SilhouetteEvidence
from tracker.foundation.arrays import Mask
from tracker.foundation.errors import BackdropError, InitializationError
from tracker.images.plate import Plate, changed
from tracker.images.reading._plates import backdrop, recorded_plate
from tracker.images.reading.video import VideoReading
from tracker.images.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.bootstrapping import first_start
from tracker.tracking.hypotheses import least_left
from tracker.tracking.initialization import Backdrops, Stages
from tracker.tracking.initialization._foregrounds import foregrounds, outlined, segmented
from tracker.tracking.initialization.auto import AutoInitialization
from tracker.tracking.initialization.pca import PcaInitialization, _likeliest_fault, _stand_out
from tracker.tracking.initialization.stance import StanceInitialization
from tracker.tracking.recorded_plates import without_persons
from tracker.tracking.start import Hypothesis, Start

BOX = slice(60, 200), slice(140, 180)
QUICK = PcaInitialization(turn_step_deg=45.0, hypotheses=2, finalists=2)


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("arm_swing", n_frames=2)


@pytest.fixture(scope="module")
def masks(truth: Scene) -> tuple[Mask, ...]:
    return CpuSynthesis().silhouettes(truth)


def half_known() -> tuple[Frame, Plate]:
    """Somebody of whom the plate knows the right half."""
    image, unknown = room(), np.zeros((240, 320), dtype=bool)
    image[BOX] = (30, 40, 200)
    unknown[:, :160] = True
    return Frame(0, 0.0, (image,)), Plate(room(), unknown)


def test_what_a_plate_does_not_know_has_changed_but_is_no_foreground() -> None:
    frame, plate = half_known()
    image = frame.images[0]
    assert image is not None
    half, whole = changed(image, plate), changed(image, Plate(room()))
    np.testing.assert_array_equal(half.foreground, whole.foreground & ~np.asarray(plate.unknown))
    assert half.foreground[BOX][:, 21:].mean() > 0.95
    assert half.moving[:, :160].all()
    np.testing.assert_array_equal(half.moving[:, 160:], whole.moving[:, 160:])


def test_a_plate_that_knows_everything_says_so() -> None:
    assert Plate(room(), np.zeros((240, 320), dtype=bool)).unknown is None


def test_a_foreground_is_only_too_small_if_the_unknown_does_not_make_up_for_it() -> None:
    frame, plate = half_known()
    whole = 0, 0, 320, 240
    assert Sight(frame, (plate,), np.array([140 * 40.0])).changes(0, whole) is not None
    assert Sight(frame, (Plate(room()),), np.array([140 * 40.0 / 0.5])).changes(0, whole) is None
    assert Sight(frame, (plate,), np.array([140 * 40.0 / 8])).changes(0, whole) is None


def test_covering_what_is_not_known_neither_costs_nor_is_worth_anything(truth: Scene, masks: tuple[Mask, ...]) -> None:
    evidence, person = SilhouetteEvidence(), truth.persons[0]
    limb = np.radians(50) * np.eye(person.body.dof)[person.body.index("left_arm_abduction")]
    poses = np.stack([person.q, person.q + limb])
    models = CpuSynthesis().silhouettes(truth.with_pose(0, poses[1]))
    # where only one of both poses is, with a margin for the coarse grid that is filled
    beyond = tuple(
        cv2.dilate((mask ^ model).astype(np.uint8), np.ones((25, 25))) > 0
        for mask, model in zip(masks, models, strict=True)
    )
    cut = tuple(mask & ~hidden for mask, hidden in zip(masks, beyond, strict=True))
    question = Comparison(truth, 0, CpuSynthesis(), evidence.seen(cut, beyond))
    right, turned = evidence.distances(question, poses)
    assert abs(turned - right) < 0.05
    known, wrong = evidence.distances(asked(truth, masks), poses)
    assert wrong > known + 0.5


def test_the_border_of_what_is_not_known_is_no_outline(masks: tuple[Mask, ...]) -> None:
    mask = masks[0]
    unknown = np.zeros_like(mask)
    unknown[: mask.shape[0] // 2] = True
    (view,) = outline_observation((mask & ~unknown,), (unknown,)).views
    (whole,) = outline_observation((mask,)).views
    assert view is not None
    assert whole is not None
    assert view.edges[:, 1].min() > mask.shape[0] // 2
    below = whole.edges[:, 1] > mask.shape[0] // 2 + 6
    assert len(view.edges) > 0.9 * below.sum() > 0


def test_where_somebody_stood_for_long_is_not_known() -> None:
    walking, leaving = recorded_plate(filmed(WALKING)), recorded_plate(filmed(LEAVING))
    assert leaving.known < 0.5 < walking.known
    assert leaving.plate.unknown is not None
    assert leaving.plate.unknown[BOX].mean() > 0.9
    free = ~leaving.plate.unknown
    assert np.percentile(np.abs(leaving.plate.picture.astype(int) - room())[free], 99) < 8


def test_nothing_that_moves_is_no_backdrop() -> None:
    leaving = backdrop(filmed(LEAVING))
    assert leaving is not None
    assert leaving.plate.unknown is not None
    assert backdrop(filmed(STILL)) is None
    assert backdrop(filmed(WALKING[:5])) is None
    assert backdrop([]) is None


def test_of_the_unknown_what_looks_like_the_person_is_foreground() -> None:
    plate = room()
    unknown = np.zeros(plate.shape[:2], dtype=bool)
    unknown[100:110, 150:170] = unknown[10:40, 10:40] = True
    image = plate.copy()
    image[BOX] = plate[100:110, 150:170] = plate[150:156, 150:170] = (30, 40, 200)
    (near,) = segmented(Frame(0, 0.0, (image,)), (Plate(plate, unknown),))
    (every,) = foregrounds(Frame(0, 0.0, (image,)), (Plate(plate, unknown),))
    assert near is not None
    assert every is not None
    assert near[101:109, 152:168].all()
    assert not near[12:38, 12:38].any()
    assert every[12:38, 12:38].all()
    assert not near[152:154, 155:165].any()


def test_what_was_drawn_is_a_mask_where_the_plate_does_not_know() -> None:
    frame, plate = half_known()
    image, given = frame.images[0], np.zeros((240, 320), dtype=bool)
    given[:20, :20] = given[100, 100] = True
    four = Frame(0, 0.0, (image,) * 4, (None, None, given, given))
    plates = (plate, Plate(room()), plate, None)
    drawn = segmented(four, plates)
    masks = outlined(four, plates, drawn).masks
    assert masks[0] is not None
    # the half that the plate knows, and of the other what looks like it
    assert (masks[0][BOX].mean(), masks[0][:, :130].any(), masks[0][:, 190:].any()) == (1.0, False, False)
    assert masks[1] is None
    for mask in masks[2:]:
        np.testing.assert_array_equal(mask, given)


def test_a_view_that_knows_nothing_behind_the_person_makes_no_model(truth: Scene, masks: tuple[Mask, ...]) -> None:
    images = tuple(np.where(mask[..., None], (60, 90, 160), 190).astype(np.uint8) for mask in masks)
    empty = np.full_like(images[0], 190)
    rows = np.flatnonzero(masks[2].any(axis=1))
    head = masks[2].copy()
    head[rows[0] + len(rows) // 5 :] = False
    around = cv2.dilate(masks[1].astype(np.uint8), np.ones((9, 9))) > 0
    known = (Plate(empty), Plate(empty, around), Plate(empty, masks[2] & ~head), Plate(empty))
    sight = Sight(Frame(0, 0.0, images), known)
    for v, mask in enumerate(masks):
        sight.changes(v, (0, 0, mask.shape[1], mask.shape[0]))
    assert [_silhouette(sight, v) is not None for v in range(4)] == [True, False, True, True]


# Starts


@dataclass(frozen=True)
class Asked(StanceInitialization):
    """Finds nobody; only whether it was asked matters."""

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        raise InitializationError("asked")


def stages_of(simulation: Simulation, backdrops: Backdrops) -> Stages:
    evidence = AutoEvidence()
    return replace(cycle_for(simulation, evidence=evidence).stages, plates=(None,) * 4, backdrops=backdrops)


def showing(simulation: Simulation, shown: Callable[[Mask], Mask], unknown: bool) -> tuple[Plate, ...]:
    """Plates in which a part of the first frame's silhouettes is seen, or is not known."""
    frame = next(iter(simulation.frames()))
    first = simulation.scene.with_poses(tuple(poses[0] for poses in simulation.poses))
    found = []
    for plate, image, mask in zip(simulation.plates, frame.images, CpuSynthesis().silhouettes(first), strict=True):
        part = cv2.dilate(shown(mask).astype(np.uint8), np.ones((9, 9))) > 0
        assert plate is not None
        assert image is not None
        picture = np.where(part[..., None], image, plate.picture).astype(np.uint8)
        found.append(Plate(picture, part if unknown else None))
    return tuple(found)


def trunk(mask: Mask) -> Mask:
    """The middle of a silhouette."""
    inner: Mask = cv2.erode(mask.astype(np.uint8), np.ones((9, 9))) > 0
    return inner


def legs(mask: Mask) -> Mask:
    """The lower half of a silhouette."""
    rows = np.flatnonzero(mask.any(axis=1))
    lower = mask.copy()
    lower[: (rows[0] + rows[-1]) // 2] = False
    return lower


def test_who_stands_out_but_for_the_unknown_is_found_without_plates(simulation: Simulation) -> None:
    plates = showing(simulation, trunk, unknown=True)
    assert all(plate.unknown is not None for plate in plates)
    stages = stages_of(simulation, lambda: plates)
    start = AutoInitialization(pca=QUICK, stance=Asked()).start(
        next(iter(simulation.frames())), simulation.scene, stages
    )
    # seen from the front and from behind arms look alike: the next frames decide
    assert min(joint_errors_mm(simulation, 0, 0, one.q).mean() for one in start.hypotheses[0]) < 30


def test_of_two_starts_that_which_leaves_less_is_taken_with_the_hypotheses_of_both(simulation: Simulation) -> None:
    body = simulation.scene.persons[0].body
    q = [body.clamped(body.rest() + 0.3 * k) for k in range(3)]
    left = (0.4, 0.2, 0.3)
    one, other, third = (
        Hypothesis(pose, distance_px=1.0, explained=0.9, left_over=over, turn_deg=0.0)
        for pose, over in zip(q, left, strict=True)
    )
    starts = [Start((q[0],), ((),), ((one, third),), (0.1,)), Start((q[1],), ((),), ((other, one),), (0.9,))]
    found = least_left(starts, simulation.scene, 2)
    np.testing.assert_array_equal(found.poses[0], q[1])
    assert [h.left_over for h in found.hypotheses[0]] == [0.2, 0.3]


@pytest.mark.parametrize("shown", [legs, lambda mask: mask], ids=["legs", "whole"])
def test_who_is_in_the_backdrops_is_looked_for_on_edges(simulation: Simulation, shown: Callable[[Mask], Mask]) -> None:
    plates = showing(simulation, shown, unknown=False)
    with pytest.raises(InitializationError, match=r"^asked$"):
        AutoInitialization(pca=QUICK, stance=Asked()).start(
            next(iter(simulation.frames())), simulation.scene, stages_of(simulation, lambda: plates)
        )


def test_no_backdrops_leave_the_edges(simulation: Simulation) -> None:
    frame = next(iter(simulation.frames()))
    for known in ((), (None,) * 4, (simulation.plates[0], None, None, None)):
        with pytest.raises(InitializationError, match=r"^asked$"):
            AutoInitialization(pca=QUICK, stance=Asked()).start(
                frame, simulation.scene, stages_of(simulation, lambda known=known: known)
            )


def test_the_backdrop_of_a_recording_is_the_empty_room(data: Callable[[str], Path]) -> None:
    folder = data("room/V-Dance")
    reading = VideoReading(path=f"{folder}/{{view}}.mp4", rig=folder / "calibration.json", views=("RIGHT",))
    (plate,) = reading.open().backdrops
    assert plate is not None
    assert plate.unknown is not None
    empty = cv2.imread(f"{folder}/background/RIGHT.jpg")
    off = np.abs(plate.picture.astype(int) - empty).max(axis=2)
    assert np.percentile(off[~plate.unknown], 99.5) < 20
    assert off[plate.unknown].mean() > 2 * off[~plate.unknown].mean()


@pytest.mark.parametrize(("shown", "are_used"), [(trunk, True), (lambda mask: mask, False)], ids=["little", "all"])
def test_plates_of_the_recording_that_show_the_person_are_not_used(
    simulation: Simulation, shown: Callable[[Mask], Mask], are_used: bool
) -> None:
    plates = showing(simulation, shown, unknown=are_used)
    made = tuple(replace(plate, recorded=True) for plate in plates[:2]) + plates[2:]
    cycle = cycle_for(simulation, TrueStart(simulation), plates=made)  # type: ignore[arg-type]
    kept = without_persons(cycle, simulation.scene, simulation.frames)
    assert [plate is not None for plate in kept.plates] == [are_used, are_used, True, True]
    assert (kept.before.start is not None) == are_used, "before other plates another one may be found"
    assert without_persons(replace(cycle, plates=plates), simulation.scene, simulation.frames).plates == plates


def test_a_start_before_plates_of_the_recording_is_not_looked_for_again(simulation: Simulation) -> None:
    plates = tuple(replace(plate, recorded=True) for plate in showing(simulation, trunk, unknown=True))
    initialization, first = TrueStart(simulation), next(iter(simulation.frames()))
    kept = without_persons(cycle_for(simulation, initialization, plates=plates), simulation.scene, simulation.frames)
    stages, scene = kept.stages, simulation.scene
    found = first_start(first, scene, kept)
    assert initialization.asked == [0]
    np.testing.assert_array_equal(found.poses[0], TrueStart(simulation).start(first, scene, stages).poses[0])
    kept.initialization.start(first, scene, replace(stages, seen_before=True))
    assert initialization.asked == [0, 0], "who was lost since may be elsewhere"


def test_whom_the_plates_show_everywhere_is_not_searched_before_them(
    simulation: Simulation,
) -> None:
    """Of a woman who stays what is not known was taken for her: 18 s of search, and a pose 150 m away."""

    class Refusing(TrueStart):
        def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
            _stand_out(frame, scene, replace(stages, plates=plates), [self.simulation.poses[0][0]])
            return super().start(frame, scene, stages)

    plates = tuple(replace(plate, recorded=True) for plate in showing(simulation, lambda mask: mask, unknown=False))
    refused = without_persons(
        cycle_for(simulation, Refusing(simulation), plates=plates), simulation.scene, simulation.frames
    )
    assert refused.plates == (None,) * 4
    assert isinstance(refused.initialization, Refusing)
    empty, first = replace(stages_of(simulation, tuple), plates=simulation.plates), next(iter(simulation.frames()))
    _stand_out(first, simulation.scene, empty, [simulation.poses[0][0]])  # before the empty room she stands out


def test_that_the_plates_show_somebody_is_told_before_any_other_fault() -> None:
    nobody, shown = InitializationError("nobody"), BackdropError("in the plates")
    assert _likeliest_fault([nobody, shown]) is shown
    assert _likeliest_fault([nobody, InitializationError("another")]) is nobody


@pytest.mark.parametrize(
    ("name", "background", "are_made"),
    [("N-WalkCircle", None, True), ("N-WalkCircle", "none", False), ("D-TwoElbowRot", None, False)],
)
def test_plates_are_made_unasked_where_somebody_walks_about(
    name: str, background: str | None, are_made: bool, data: Callable[[str], Path]
) -> None:
    folder = data(f"room/{name}")
    reading = VideoReading(
        path=f"{folder}/{{view}}.mp4", rig=folder / "calibration.json", views=("FRONT", "LEFT"), background=background
    )
    opened = reading.open()
    assert [plate is not None and plate.recorded for plate in opened.plates] == [are_made] * 2
    assert opened.makes_plates is (background is None)


def test_masks_of_ones_own_leave_no_plates_to_be_made(data: Callable[[str], Path], tmp_path: Path) -> None:
    folder = data("room/N-WalkCircle")
    for view in ("FRONT", "LEFT"):
        (tmp_path / view).mkdir()
        cv2.imwrite(str(tmp_path / view / "0.png"), np.zeros((576, 720), np.uint8))
    reading = VideoReading(
        path=f"{folder}/{{view}}.mp4",
        rig=folder / "calibration.json",
        views=("FRONT", "LEFT"),
        masks=f"{tmp_path}/{{view}}/{{frame}}.png",
        stop=1,
    )
    opened = reading.open()
    assert opened.plates == (None, None)
    assert not opened.makes_plates
