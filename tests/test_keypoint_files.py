"""Files of keypoints as detectors of today write them: orders by name, spellings of "not found", one JSON a video."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tracker.bodies.keypoint_layouts import open_keypoints
from tracker.bodies.keypoint_layouts.orders import LAYOUTS
from tracker.bodies.keypoint_layouts.views import KeypointFiles, KeypointViews
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.errors import SequenceError

PERSON = [value for k in range(17) for value in (300.0 + 7 * k, 200.0 + 11 * k, 0.9)]
"""A line of COCO-17."""


def folder_of(tmp_path: Path, *frames: Any) -> Path:
    """A folder of JSON files of these contents; text as it is."""
    for n, content in enumerate(frames):
        text = content if isinstance(content, str) else json.dumps(content)
        (tmp_path / f"cam_{n:06d}.json").write_text(text)
    return tmp_path


def people(*persons: Any) -> Any:
    return {"version": 1.3, "people": [{"person_id": [-1], "pose_keypoints_2d": person} for person in persons]}


def test_each_order_has_as_many_keypoints_as_its_name_says() -> None:
    for layout, names in LAYOUTS.items():
        assert len(names) == int("".join(sign for sign in layout.partition("_")[2] if sign.isdigit()))
        told = [name for name in names if name]
        assert len(set(told)) == len(told)


@pytest.mark.parametrize(
    ("layout", "places"),
    [
        ("coco_18", {"neck": 1, "right_wrist": 4, "right_hip": 8, "left_ankle": 13, "right_eye": 14, "left_ear": 17}),
        ("body_25", {"neck": 1, "right_wrist": 4, "pelvis": 8, "left_ankle": 14, "left_ear": 18, "right_heel": 24}),
        ("body_25b", {"left_eye": 1, "right_wrist": 10, "left_ankle": 15, "head_top": 18, "left_toe": 19}),
        ("halpe_26", {"right_ankle": 16, "head_top": 17, "neck": 18, "pelvis": 19, "left_small_toe": 22}),
        ("halpe_136", {"pelvis": 19, "right_toe": 21, "right_heel": 25}),
        ("wholebody_133", {"right_ankle": 16, "left_toe": 17, "left_heel": 19, "right_toe": 20, "right_heel": 22}),
        ("body_135", {"head_top": 18, "left_toe": 19, "right_heel": 24}),
        ("blazepose_33", {"left_eye": 2, "right_ear": 8, "left_wrist": 15, "left_hip": 23, "right_toe": 32}),
        ("mpii_16", {"right_ankle": 0, "left_hip": 3, "pelvis": 6, "head_top": 9, "right_wrist": 10, "left_wrist": 15}),
        ("mpii_15", {"head_top": 0, "right_shoulder": 2, "right_hip": 8, "left_ankle": 13}),
        (
            "h36m_17",
            {"pelvis": 0, "right_hip": 1, "left_hip": 4, "head_top": 10, "left_shoulder": 11, "right_wrist": 16},
        ),
    ],
)
def test_an_order_is_chosen_by_name(layout: str, places: dict[str, int], tmp_path: Path) -> None:
    """Names stand where the detectors' own sources have them; hands and faces are not read."""
    n = len(LAYOUTS[layout])
    values = [value for k in range(n) for value in (k + 10.0, 5.0, 0.9)]
    source = open_keypoints(folder_of(tmp_path, people(values)), layout=layout)
    found = source.at(0)
    assert "" not in found.names
    assert len(found.names) <= 26
    for name, place in places.items():
        assert found.found[0, found.names.index(name), 0] == place + 10
    by_number = open_keypoints(tmp_path).order
    assert by_number is not None
    assert len(by_number.all_names) == n
    assert by_number.by_number
    assert layout == by_number.layout or layout in by_number.others


@pytest.mark.parametrize("spelt", ["BODY_25B", "body25b", "Body-25B"])
def test_the_name_of_an_order_may_be_spelt_as_its_program_does(spelt: str, tmp_path: Path) -> None:
    source = open_keypoints(folder_of(tmp_path, people([10.0, 5.0, 0.9] * 25)), layout=spelt)
    assert str(source.order) == "25 a person (body_25b)"


@pytest.mark.parametrize(
    ("names", "layout", "told"),
    [
        ((), "body25x", 'no such layout of keypoints; did you mean "body_25"?'),
        ((), "body_25", "17 keypoints, body_25 has 25"),
        (("nose",) * 17, None, '"nose" is there twice'),
        (("nose", "LEye", "left_eye", *[""] * 14), None, '"LEye" and "left_eye" are the same'),
        (tuple("abcdefghijklmnop"), None, "17 keypoints, the names given are 16"),
        (tuple("abcdefghijklmnopq"), "coco_17", "leave one of them out"),
    ],
)
def test_names_and_orders_that_do_not_fit_are_told_at_once(
    names: tuple[str, ...], layout: str | None, told: str, tmp_path: Path
) -> None:
    with pytest.raises(SequenceError) as caught:
        open_keypoints(folder_of(tmp_path, people(), people(PERSON)), names, layout)
    assert told in str(caught.value)


def test_a_keypoint_without_a_name_is_left_out(tmp_path: Path) -> None:
    names = ("", "left_eye", *[""] * 14, "right_ankle")
    found = open_keypoints(folder_of(tmp_path, people(PERSON)), names).at(0)
    assert found.names == ("left_eye", "right_ankle")
    np.testing.assert_array_equal(found.found[0, :, 0], [307, 412])


NOBODY = {
    "NaN": '{"people": [{"pose_keypoints_2d": [' + ", ".join(["NaN"] * 51) + "]}]}",
    "Infinity": '{"people": [{"pose_keypoints_2d": [' + ", ".join(["Infinity"] * 51) + "]}]}",
    "null": people([None] * 51),
    "zeros": people([0] * 51),
    "minus one": people([-1] * 51),
    "minus one, sure": people([-1, -1, 1] * 17),
    "words": people(["nan", "None", "N/A"] * 17),
    "no confidence": people([300, 200, 0] * 17),
    "empty list": people([]),
    "null in its place": people(None),
    "no keypoints of the body": {"people": [{"face_keypoints_2d": [1.0, 2.0, 0.5]}]},
    "an empty person": {"people": [{}, None, []]},
    "nobody": people(),
    "people are null": {"version": 1.3, "people": None},
    "no people": {"version": 1.3},
    "null throughout": "null",
    "an empty object": {},
    "an empty array": [],
    "an empty file": "",
    "a blank file": " \n",
}


@pytest.mark.parametrize("spelling", NOBODY)
def test_nobody_is_spelt_in_many_ways_and_ends_no_run(spelling: str, tmp_path: Path) -> None:
    """Also as the first frame, before the order is known."""
    source = open_keypoints(folder_of(tmp_path, NOBODY[spelling], people(PERSON), NOBODY[spelling]))
    assert source.at(0).found.shape == source.at(2).found.shape == (0, 17, 3)
    np.testing.assert_array_equal(source.at(1).found.ravel(), PERSON)


@pytest.mark.parametrize(
    "gap",
    [
        *(
            [np.nan] * 3,
            [None] * 3,
            [0, 0, 0],
            [-1, -1, -1],
            [-1, -1, 0.9],
            [0, 0, 0.4],
            [300, None, 0.9],
            [300, 200, 0],
        ),
        *([300, 200, np.nan], ["", "-", ""], ["NaN", "NaN", "NaN"], ["-1.#IND", "1.#QNAN", 0.9], [np.inf, 200, 0.9]),
        [10**400, 200, 0.9],
    ],
)
def test_a_keypoint_that_was_not_found_is_spelt_in_many_ways(gap: list[Any], tmp_path: Path) -> None:
    found = open_keypoints(folder_of(tmp_path, people([*PERSON[:6], *gap, *PERSON[9:]]))).at(0).found
    np.testing.assert_array_equal(found[0, 2], [np.nan] * 3)
    assert np.isfinite(found[0, [0, 1, *range(3, 17)]]).all()


def test_numbers_in_words_are_numbers_and_other_words_are_told(tmp_path: Path) -> None:
    found = open_keypoints(folder_of(tmp_path, people([str(value) for value in PERSON]))).at(0).found
    np.testing.assert_array_equal(found.ravel(), PERSON)
    with pytest.raises(SequenceError, match="entry that is no number"):
        open_keypoints(folder_of(tmp_path, people(["left", *PERSON[1:]])))


def test_a_view_in_which_nobody_is_ever_seen_is_a_view(tmp_path: Path) -> None:
    """What the keypoints are, the other views say."""
    for view, content in (("one", people()), ("two", people([10.0, 5.0, 0.9] * 25))):
        (tmp_path / view).mkdir()
        folder_of(tmp_path / view, content)
    views = KeypointViews.open(str(tmp_path / "{view}"), ("one", "two"))
    assert views.names == LAYOUTS["body_25"]
    assert [source.at(0).found.shape for source in views.sources] == [(0, 25, 3), (1, 25, 3)]


def test_persons_of_a_case_that_are_nan_are_nobody(data: Callable[[str], Path]) -> None:
    """Pose2Sim writes persons whose numbers are all NaN."""
    source = open_keypoints(data("cases/12-json-nan/FRONT_json"))
    assert [len(source.at(n).found) for n in range(4)] == [1, 1, 1, 0]


POINTS = np.reshape(PERSON, (17, 3))


MMPOSE = {"keypoints": POINTS[:, :2].tolist(), "keypoint_scores": POINTS[:, 2].tolist(), "bbox": [[1, 2, 3, 4]]}


ALPHAPOSE = {"category_id": 1, "keypoints": PERSON, "score": 1.7, "box": [1.0, 2.0, 3.0, 4.0]}


FRAMES: dict[str, Any] = {
    "openpose": people(PERSON),
    "alphapose cmu, sep-json": {"version": "AlphaPose v0.3", "bodies": [{"joints": PERSON}]},
    "mmpose, an image": [MMPOSE],
    "mmpose, returned": {"predictions": [[MMPOSE]]},
    "openpifpaf": [{"keypoints": PERSON, "bbox": [1, 2, 3, 4], "score": 0.8, "category_id": 1}],
    "points": people(POINTS.tolist()),
    "openpose before 1.3": {"version": 1.1, "people": [{"pose_keypoints": PERSON, "face_keypoints": []}]},
    "easymocap": {"filename": "0.jpg", "annots": [{"personID": 0, "keypoints": POINTS.tolist(), "isKeyframe": False}]},
    "one person": {"frame": 0, "keypoints": PERSON},
    "tensorflow.js": [{"keypoints": [{"x": x, "y": y, "score": c, "name": "k"} for x, y, c in POINTS], "score": 0.9}],
    "ultralytics": [{"name": "person", "keypoints": dict(zip(("x", "y", "visible"), POINTS.T.tolist(), strict=True))}],
}


@pytest.mark.parametrize("program", FRAMES)
def test_a_file_a_frame_is_read_as_programs_write_it(program: str, tmp_path: Path) -> None:
    found = open_keypoints(folder_of(tmp_path, FRAMES[program])).at(0).found
    np.testing.assert_array_equal(found, [POINTS])


ONE_JSON: dict[str, tuple[Any, bool]] = {
    "alphapose": ([{"image_id": f"{n}.jpg", **ALPHAPOSE, "idx": k} for n in (0, 2) for k in range(1 + n)], True),
    "coco results": ([{"image_id": n, **ALPHAPOSE} for n in (2, 0, 2, 2)], True),
    "alphapose cmu": ({f"{n}.jpg": {"bodies": [{"joints": PERSON}] * (1 + n)} for n in (0, 2)}, True),
    "alphapose open": ({f"cam_{n:06d}.png": people(*[PERSON] * (1 + n)) for n in (0, 2)}, True),
    "alphapose, poseflow": ({f"{n}.jpg": [{"keypoints": PERSON, "idx": 1}] * (1, 0, 3)[n] for n in range(3)}, True),
    "coco data set": (
        {
            "images": [{"id": 50 + n, "file_name": f"cam/{n:06d}.png"} for n in (0, 1, 2)],
            "annotations": [{"image_id": n, "keypoints": PERSON} for n in (50, 52, 52, 52)],
        },
        True,
    ),
    "mmpose inferencer": ([{"frame_id": n, "instances": [MMPOSE] * (1, 0, 3)[n]} for n in range(3)], False),
    "mmpose demo": (
        {
            "meta_info": {},
            "instance_info": [{"frame_id": 1 + n, "instances": [MMPOSE] * (1, 0, 3)[n]} for n in range(3)],
        },
        False,
    ),
}


@pytest.mark.parametrize("program", ONE_JSON)
def test_one_json_a_video_is_read(program: str, tmp_path: Path) -> None:
    """Frames without anybody are left out by AlphaPose; MMPose's demonstrations count from 1."""
    content, named = ONE_JSON[program]
    (tmp_path / "cam.json").write_text(json.dumps(content))
    source = open_keypoints(tmp_path / "cam.json")
    assert source.named == named
    assert [len(source.at(n).found) for n in range(4)] == [1, 0, 3, 0]
    np.testing.assert_array_equal(source.at(2).found, [POINTS] * 3)


def test_a_folder_that_holds_the_results_of_a_video_is_those(tmp_path: Path) -> None:
    (tmp_path / "alphapose-results.json").write_text(json.dumps([{"image_id": "3.jpg", **ALPHAPOSE}]))
    assert open_keypoints(tmp_path).numbers == (3,)


def test_nobody_in_a_whole_video_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "cam.json").write_text("[]")
    assert len(open_keypoints(tmp_path / "cam.json").at(0).found) == 0


def test_alphapose_of_a_case_is_that_of_openpose(data: Callable[[str], Path]) -> None:
    alphapose = open_keypoints(data("cases/26-alphapose/FRONT.json"))
    openpose = open_keypoints(data("room/D-TwoElbowRot/keypoints/FRONT_json"))
    assert len(alphapose.numbers) > 10
    for number in alphapose.numbers:
        np.testing.assert_array_equal(alphapose.at(number).found[0], openpose.at(number).found[0])


NO_JSON = {
    "image": (people(PERSON), "the persons of one image, expected the folder"),
    "no number": ([{"image_id": "front.jpg", **ALPHAPOSE}], 'no number in the image name "front.jpg"'),
    "two views": (
        [{"image_id": f"{view}_0.jpg", **ALPHAPOSE} for view in ("front", "left")],
        '"front_0.jpg" and "left_0.jpg" have the same number, expected one view a file',
    ),
    "frame": ([{"frame_id": "first", "instances": []}], "first as the number of a frame"),
    "demo": ({"instance_info": [{"frame_id": 0, "instances": []}]}, "expected whole ones from 1 on"),
    "vitpose": ({"keypoints": [{}], "skeleton": {}}, 'keypoints of no known form ("keypoints", "skeleton")'),
    "data set": ({"images": [{"id": 1}], "annotations": []}, "no data set of COCO"),
    "in space": (
        [{"frame_id": 0, "instances": [{**MMPOSE, "keypoints": POINTS.tolist()}]}],
        "points in space, expected pixels",
    ),
    "scores": ([{"frame_id": 0, "instances": [{**MMPOSE, "keypoint_scores": [0.5]}]}], "a score beside it"),
}


@pytest.mark.parametrize("name", NO_JSON)
def test_a_json_file_that_is_none_of_those_is_one_clear_line(name: str, tmp_path: Path) -> None:
    content, told = NO_JSON[name]
    (tmp_path / "cam.json").write_text(json.dumps(content))
    with pytest.raises(SequenceError) as caught:
        open_keypoints(tmp_path / "cam.json")
    assert told in str(caught.value)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("file", "told"),
    [
        ("cam.h5", "write CSV"),
        ("cam.slp", "export its analysis CSV"),
        ("mediapipe_2d.npy", "write a CSV table"),
        ("cam_keypoints.pkl", "can run programs"),
        ("cam.txt", "labels, as YOLO writes them, are not read"),
    ],
)
def test_what_detectors_write_besides_is_named_with_the_way_out(file: str, told: str, tmp_path: Path) -> None:
    (tmp_path / file).touch()
    with pytest.raises(SequenceError, match=told):
        open_keypoints(tmp_path / file)


def test_files_of_the_system_are_no_frames_and_labels_in_a_folder_are_named(tmp_path: Path) -> None:
    folder_of(tmp_path, people(PERSON))
    (tmp_path / "._cam_000000.json").write_bytes(b"\0\5\26\7")
    assert open_keypoints(tmp_path).numbers == (0,)
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "cam_1.txt").touch()
    with pytest.raises(SequenceError, match=r"no .json file in it \(but .txt\)"):
        open_keypoints(tmp_path / "labels")


def camera_views(tmp_path: Path, scale: Any, shift: float = 0.0, **told: Any) -> tuple[KeypointViews, Rig]:
    """A person in one view, in numbers that a detector made of the pixels."""
    points = POINTS.copy()
    points[:, :2] = points[:, :2] * scale + shift
    folder_of(tmp_path, people(points.ravel().tolist()))
    rig = Rig((Camera.looking_at("cam", (640, 480), 50.0, (0, -2, 1), (0, 0, 1)),))
    return KeypointViews.open(str(tmp_path), ("cam",), **told), rig


def test_shares_of_an_image_are_no_pixels(tmp_path: Path) -> None:
    views, rig = camera_views(tmp_path, 1 / np.array([640, 480]))
    with pytest.raises(
        SequenceError, match=r'view "cam": keypoints lie between 0.42 and 0.78: .* set normalized = true'
    ):
        views.check(rig)
    views.check(rig, normalized=True)
    np.testing.assert_allclose(views.at(Frame(0, 0.0, (None,)), rig, normalized=True)[0][0], POINTS)


@pytest.mark.parametrize("outside", [0.6, -0.45])
def test_shares_may_lie_outside_of_the_image_a_little(outside: float, tmp_path: Path) -> None:
    views, rig = camera_views(tmp_path, 1 / np.array([640, 480]), outside)
    with pytest.raises(SequenceError, match="they are shares of the image, no pixels"):
        views.check(rig)


def test_shares_from_minus_one_on_and_pixels_called_shares_are_told(tmp_path: Path) -> None:
    views, rig = camera_views(tmp_path, 2 / np.array([640, 480]), -1.0)
    with pytest.raises(SequenceError, match=r"write pixels \(OpenPose: --keypoint_scale 0\)"):
        views.check(rig)
    views, rig = camera_views(tmp_path / ".." / tmp_path.name, 1.0)
    with pytest.raises(SequenceError, match="they are pixels, leave normalized out"):
        views.check(rig, normalized=True)


def test_who_leaves_the_image_ends_no_run(tmp_path: Path) -> None:
    """Detectors guess what the edge cuts off; where many lie outside throughout, they are of other images."""
    folder_of(tmp_path, *[people(PERSON)] * 5, people([value + 450 for value in PERSON]))
    views, rig = camera_views(tmp_path, 1.0)
    views.check(rig)
    assert (views.at(Frame(5, 0.0, (None,)), rig)[0][..., :2] > 640).any()


def test_what_a_detector_is_not_sure_of_may_lie_outside(tmp_path: Path) -> None:
    """Legs that no view of an upper body shows are guessed below the image, with little confidence."""
    legs = [value for k in range(6) for value in (300.0, 700.0 + k, 0.1)]
    folder_of(tmp_path, people([*PERSON[:33], *legs]))
    rig = Rig((Camera.looking_at("cam", (640, 480), 50.0, (0, -2, 1), (0, 0, 1)),))
    KeypointFiles(path=str(tmp_path)).checked(rig)
    with pytest.raises(SequenceError, match="set downscale"):
        KeypointFiles(path=str(tmp_path), least_confidence=0.0).checked(rig)


def test_files_that_are_not_numbered_from_0_are_told(tmp_path: Path) -> None:
    """Beside a video, whose images count from 0, they would be an image late."""
    for view, first in (("one", 0), ("two", 1), ("three", 1)):
        (tmp_path / view).mkdir()
        folder_of(tmp_path / view, *[people(PERSON)] * 3)
        if first:
            (tmp_path / view / "cam_000000.json").unlink()
    pattern = str(tmp_path / "{view}")
    assert (
        KeypointViews.open(pattern, ("one", "two", "three")).numbering
        == ", numbered: one from 0 on; two, three from 1 on"
    )
    assert KeypointViews.open(str(tmp_path / "one"), ("one",)).numbering == ""


def test_files_of_other_numbers_than_the_frame_are_told(tmp_path: Path) -> None:
    views, _ = camera_views(tmp_path, 1.0)
    assert views.gaps_told(Frame(0, 0.0, (None,))) == ""
    assert views.gaps_told(Frame(7, 0.0, (None,))) == "cam has 0 to 0, this frame is 7"
