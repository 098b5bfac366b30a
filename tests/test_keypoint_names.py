"""What keypoints mean is said by the body's file: names of detectors, points beside landmarks, both sides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from detected import detected
from observations import four_views
from recordings import cycle_for, small_simulation
from rounding import assert_alike

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body, read_description, save_description
from tracker.bodies.keypoint_layouts.orders import LAYOUTS
from tracker.bodies.keypoints import limbs, meant, plain_name, swapped_sides
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.evidence.keypoints import KeypointEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ModelError
from tracker.foundation.resources import model_path
from tracker.images.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.initialization.keypoints import KeypointInitialization

# Some of those of DeepLabCut's SuperAnimal-Quadruped, as they are spelt there, and one that the body does not know.
SUPER_ANIMAL = (
    *("nose", "right_earbase", "back_base", "back_end", "tail_end", "front_left_thai", "front_left_knee"),
    *("front_left_paw", "front_right_thai", "front_right_knee", "front_right_paw", "back_left_paw", "back_left_thai"),
    *("back_right_thai", "back_left_knee", "back_right_knee", "back_right_paw"),
)


def with_keypoints(tmp_path: Path, section: str, scale: float = 1.0) -> BodyModel:
    """The 22-parameter body with a section of keypoints."""
    path = tmp_path / "body.toml"
    path.write_text(model_path("gavrila22").read_text() + f"\n[keypoints]\n{section}\n")
    return load_body(path, scale)


def points(body: BodyModel, *names: str) -> Array:
    """(N, 3) in the reference pose, metres."""
    found = meant(names, body)
    assert len(found.rows) == len(names)
    return found.points


def test_a_keypoint_lies_beside_its_landmark_and_moves_with_it(tmp_path: Path) -> None:
    body = with_keypoints(tmp_path, 'left_heel = { landmark = "left_ankle", offset = [-0.05, 0.01, -0.06] }')
    heel, ankle = points(body, "left_heel", "left_ankle")
    np.testing.assert_allclose(heel - ankle, [-0.05, 0.01, -0.06])
    q = body.rest()
    q[body.index("left_leg_extension")] = np.radians(90)
    known = meant(("left_heel", "left_ankle", "left_knee"), body)
    heel, ankle, knee = body.points_in_world(q, known.points, known.ends)
    # the shin lies backwards: what was below the ankle is behind it, what was behind it above
    assert np.linalg.norm(heel - ankle) == pytest.approx(np.linalg.norm([0.05, 0.01, 0.06]))
    along = (ankle - knee) / np.linalg.norm(ankle - knee)
    assert (heel - ankle) @ along == pytest.approx(0.06, abs=1e-9)


def test_the_other_side_is_mirrored_unless_it_is_given(tmp_path: Path) -> None:
    section = 'left_heel = { landmark = "left_ankle", offset = [-0.05, 0.01, -0.06] }\nvertex = "head_top"'
    body = with_keypoints(tmp_path, section)
    left, right = points(body, "left_heel", "right_heel")
    np.testing.assert_allclose(right, left * [1, -1, 1])
    assert_alike(*points(body, "vertex", "head_top"))
    body = with_keypoints(tmp_path, section + '\nright_heel = "right_knee"')
    assert_alike(*points(body, "right_heel", "right_knee"))


def test_offsets_grow_with_the_body_and_are_kept_in_files(tmp_path: Path) -> None:
    section = 'left_heel = { landmark = "left_ankle", offset = [-0.05, 0.01, -0.06] }'
    heel, ankle = points(with_keypoints(tmp_path, section, scale=2.0), "left_heel", "left_ankle")
    np.testing.assert_allclose(heel - ankle, [-0.1, 0.02, -0.12])
    description = read_description(tmp_path / "body.toml")
    save_description(description, tmp_path / "again.toml")
    assert read_description(tmp_path / "again.toml").keypoints == description.keypoints


@pytest.mark.parametrize(
    ("section", "told"),
    [
        ('left_heel = "left_ankl"', 'keypoints.left_heel: no landmark "left_ankl"; .*left_ankle'),
        ('left_heel = { landmark = "left_ankle", ofset = [0, 0, 0] }', 'unknown key "ofset"; .*offset'),
        ("left_heel = { offset = [0, 0, 0] }", "keypoints.left_heel.landmark"),
        ('left_heel = { landmark = "left_ankle", offset = [0, 0] }', "keypoints.left_heel.offset"),
        ('RHeel = "left_ankle"\nright_heel = "right_ankle"', '"RHeel" and "right_heel" are one keypoint'),
    ],
)
def test_a_wrong_section_is_one_line(section: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=told) as caught:
        with_keypoints(tmp_path, section)
    assert "body.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("model", ["human", "gavrila22", "upper21", "upper32"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_bundled_persons_know_what_detectors_call_their_joints(model: str, layout: str) -> None:
    """Both sides' points are mirror images, and lie where a person of 1.8 m has them."""
    body = load_body(model_path(model))
    known = meant(LAYOUTS[layout], body)
    names = [LAYOUTS[layout][k] for k in known.rows]
    assert len(set(names)) == len(names) >= 12
    place = dict(zip(names, known.points, strict=True))
    for name in names:
        np.testing.assert_allclose(place[name], place[body.mirror.of(name)] * [1, -1, 1], atol=1e-9)
    if model in ("human", "upper32"):
        assert set(names) == set(LAYOUTS[layout]) - {""}
        if "nose" in names:
            assert place["left_ear"][2] < place["nose"][2] + 0.05
            assert place["nose"][0] > place["left_eye"][0] > place["left_ear"][0]


def test_a_keypoint_of_a_side_that_the_body_lacks_is_left_out(tmp_path: Path) -> None:
    text = model_path("gavrila22").read_text().split("[groups]")[0]
    text = text.replace("[landmarks]\n", '[landmarks]\nleft_stick = { segment = "left_forearm", at = [0, 0.2, 0.1] }\n')
    (tmp_path / "model.toml").write_text(text + '[keypoints]\nleft_tip = { landmark = "left_stick" }\n')
    assert [one.name for one in load_body(tmp_path / "model.toml").keypoints] == ["left_tip"]


def test_sides_of_an_animal_are_exchanged_leg_by_leg() -> None:
    """Fore and hind knees have the same words; what is exchanged of one pair leaves the other alone."""
    body = load_body(model_path("quadruped"))
    found = [{SUPER_ANIMAL[k] for k in limb} for limb in limbs(SUPER_ANIMAL, body)]
    for legs in ("front", "back"):
        of_legs = {name for name in SUPER_ANIMAL if name.startswith((f"{legs}_left", f"{legs}_right"))}
        assert len(of_legs) == 6
        assert of_legs in found
    other = swapped_sides(SUPER_ANIMAL, body.mirror)
    assert SUPER_ANIMAL[other[SUPER_ANIMAL.index("back_left_paw")]] == "back_right_paw"
    # and in the order in which tables give names
    plain = tuple(plain_name(name) for name in SUPER_ANIMAL)
    np.testing.assert_array_equal(swapped_sides(plain, body.mirror), other)
    assert len(meant(plain, body).rows) == len(meant(SUPER_ANIMAL, body).rows) == len(SUPER_ANIMAL) - 1


def test_an_animal_is_found_by_keypoints_of_deeplabcut(tmp_path: Path) -> None:
    """From tables with the detector's own names alone, and its evidence has its minimum there."""
    body = load_body(model_path("quadruped"))
    q = body.rest()
    q[body.root.shifts] = 0.2, -0.1, 0.6
    q[body.root.turn] = np.radians(130)
    for name, angle_deg in (("front_left_swing", 20), ("hind_right_swing", 15), ("hind_right_bend", 20)):
        q[body.index(name)] = np.radians(angle_deg)
    q = body.clamped(q)
    scene = Scene((Person("dog", body, q),), four_views((720, 576)))
    for name, view in zip(scene.rig.names, detected(scene, noise_px=1.0, names=SUPER_ANIMAL), strict=True):
        (tmp_path / f"{name}.csv").write_text(_deeplabcut(SUPER_ANIMAL, view[0]))
    pattern = str(tmp_path / "{view}.csv")
    initialization = KeypointInitialization(path=pattern)
    initialization.check(scene, (None,) * 4)
    frame = Frame(0, 0.0, tuple(np.zeros((576, 720, 3), np.uint8) for _ in range(4)))
    unknown = Scene((Person("dog", body, body.rest()),), scene.rig)
    stages = cycle_for(small_simulation(n_frames=1), plates=(None,) * 4).stages
    found = initialization.start(frame, unknown, stages).poses[0]
    gaps = np.linalg.norm(body.landmarks_in_world(found) - body.landmarks_in_world(q), axis=1)
    # a pixel is 8 mm there; the legs' twists are held by the reference pose alone
    assert np.median(gaps) < 0.02
    assert gaps.max() < 0.06
    evidence = KeypointEvidence(path=pattern)
    observed = evidence.observe(Sight(frame), None)
    near, far = evidence.distances(Comparison(scene, 0, CpuSynthesis(), observed), np.array([found, body.rest()]))
    assert near < 2.0 < far


def _deeplabcut(names: tuple[str, ...], found: Array) -> str:
    """A table of one frame."""
    heads = [["scorer", *["net"] * 3 * len(names)], ["bodyparts", *np.repeat(names, 3)]]
    heads.append(["coords", *["x", "y", "likelihood"] * len(names)])
    cells = ["0", *("" if np.isnan(value) else f"{value:.3f}" for value in found.ravel())]
    return "\n".join(",".join(row) for row in (*heads, cells)) + "\n"
