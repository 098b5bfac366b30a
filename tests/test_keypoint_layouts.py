"""Files of keypoints: OpenPose's JSON, tables of DeepLabCut and SLEAP, and what is said of malformed ones."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from tracker.bodies.keypoint_layouts import open_keypoints
from tracker.bodies.keypoint_layouts.orders import LAYOUTS
from tracker.bodies.keypoint_layouts.views import KeypointViews
from tracker.bodies.keypoints import plain_name, swapped_sides
from tracker.bodies.segments import Mirror
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.errors import SequenceError


def written(folder: Path, frame: int, people: list[list[float]]) -> None:
    folder.mkdir(exist_ok=True)
    content = {"version": 1.3, "people": [{"person_id": [-1], "pose_keypoints_2d": values} for values in people]}
    (folder / f"cam01_{frame:012d}_keypoints.json").write_text(json.dumps(content))


def one_person(n: int, seed: int = 0) -> list[float]:
    return np.random.default_rng(seed).uniform(1, 100, 3 * n).tolist()


@pytest.mark.parametrize(("layout", "n"), [("coco_17", 17), ("body_25", 25), ("halpe_26", 26)])
def test_the_layout_is_told_by_the_number_of_keypoints(tmp_path: Path, layout: str, n: int) -> None:
    assert len(LAYOUTS[layout]) == len(set(LAYOUTS[layout])) == n
    written(tmp_path / "cam", 3, [])
    values = one_person(n)
    values[5] = 0.0
    written(tmp_path / "cam", 4, [values, one_person(n, 1)])
    source = open_keypoints(tmp_path / "cam")
    assert source.at(3).found.shape == source.at(9).found.shape == (0, n, 3)
    found = source.at(4)
    assert found.names == LAYOUTS[layout]
    assert found.found.shape == (2, n, 3)
    assert np.isnan(found.found[0, 1]).all()
    np.testing.assert_array_equal(found.found[1].ravel(), one_person(n, 1))


def test_both_sides_of_every_layout_have_partners() -> None:
    for names in (tuple(filter(None, layout)) for layout in LAYOUTS.values()):
        other = swapped_sides(names, Mirror())
        np.testing.assert_array_equal(other[other], np.arange(len(names)))
        for k, name in enumerate(names):
            assert (other[k] == k) == (not name.startswith(("left_", "right_")))


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("RShoulder", "right_shoulder"),
        ("Right Shoulder", "right_shoulder"),
        ("shoulder_r", "right_shoulder"),
        ("left-big-toe", "left_toe"),
        ("LBigToe", "left_toe"),
        ("MidHip", "pelvis"),
        ("left_ankle", "left_ankle"),
        ("NOSE", "nose"),
        ("Head", "head_top"),
    ],
)
def test_names_are_spelt_our_way(name: str, plain: str) -> None:
    assert plain_name(name) == plain


def test_a_table_of_deeplabcut_is_read(tmp_path: Path) -> None:
    path = tmp_path / "cam.csv"
    path.write_text(
        "scorer,net,net,net,net,net,net\n"
        "bodyparts,nose,nose,nose,hip_l,hip_l,hip_l\n"
        "coords,x,y,likelihood,x,y,likelihood\n"
        "0,1,2,0.9,3,4,0.8\n"
        "labeled-data/cam/img0007.png,5,6,0.7,,,\n"
    )
    source = open_keypoints(path)
    assert source.at(0).names == ("nose", "left_hip")
    np.testing.assert_array_equal(source.at(0).found, [[[1, 2, 0.9], [3, 4, 0.8]]])
    np.testing.assert_array_equal(source.at(7).found, [[[5, 6, 0.7], [np.nan] * 3]])
    assert len(source.at(1).found) == 0


def test_a_table_of_several_individuals_is_read(tmp_path: Path) -> None:
    path = tmp_path / "cam.csv"
    path.write_text(
        "scorer,net,net,net,net,net,net\n"
        "individuals,a,a,a,b,b,b\n"
        "bodyparts,nose,nose,nose,nose,nose,nose\n"
        "coords,x,y,likelihood,x,y,likelihood\n"
        "2,1,2,0.9,3,4,0.8\n"
    )
    np.testing.assert_array_equal(open_keypoints(path).at(2).found, [[[1, 2, 0.9]], [[3, 4, 0.8]]])
    path.write_text(path.read_text().replace("nose,nose,nose\ncoords", "ball,ball,ball\ncoords"))
    gone = [np.nan] * 3
    np.testing.assert_array_equal(open_keypoints(path).at(2).found, [[[1, 2, 0.9], gone], [gone, [3, 4, 0.8]]])


def test_a_table_of_sleap_is_read(tmp_path: Path) -> None:
    path = tmp_path / "cam.csv"
    path.write_text(
        "track,frame_idx,instance.score,nose.x,nose.y,nose.score,tail.x,tail.y,tail.score\n"
        "track_0,0,1.9,1,2,0.9,3,4,0.8\n"
        "track_1,0,1.9,5,6,0.7,,,\n"
        "track_0,3,1.9,7,8,0.6,9,10,0.5\n"
    )
    source = open_keypoints(path)
    np.testing.assert_array_equal(source.at(0).found[0], [[1, 2, 0.9], [3, 4, 0.8]])
    np.testing.assert_array_equal(source.at(0).found[1], [[5, 6, 0.7], [np.nan] * 3])
    np.testing.assert_array_equal(source.at(3).found, [[[7, 8, 0.6], [9, 10, 0.5]]])


MALFORMED = {
    "not json": ("a_0.json", "{", "not a JSON file"),
    "other json": ("a_0.json", '{"persons": []}', "not as OpenPose writes it"),
    "no numbers": ("a_0.json", '{"people": [{"pose_keypoints_2d": ["x", 1, 2]}]}', "no number"),
    "two thirds": ("a_0.json", '{"people": [{"pose_keypoints_2d": [1, 2, 0.5, 3]}]}', "expected x, y, confidence"),
    "layout": ("a_0.json", '{"people": [{"pose_keypoints_2d": [1, 2, 0.5]}]}', "17 (coco_17)"),
    "number": ("a.json", "{}", "keypoints of no known form"),
    "empty": ("a.txt", "", "no .json file"),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_folder_is_one_clear_line(name: str, tmp_path: Path) -> None:
    file, content, told = MALFORMED[name]
    (tmp_path / file).write_text(content)
    with pytest.raises(SequenceError) as caught:
        open_keypoints(tmp_path).at(0)
    assert told in str(caught.value)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_without_a_number_among_others_is_one_clear_line(tmp_path: Path) -> None:
    for name in ("a_0.json", "notes.json"):
        (tmp_path / name).write_text("{}")
    with pytest.raises(SequenceError, match=r"notes.json: no number in the file's name, expected e.g. "):
        open_keypoints(tmp_path)


TABLES = {
    "empty": ("", "neither a table of DeepLabCut"),
    "other": ("a,b\n1,2\n", "neither a table of DeepLabCut"),
    "headless": ("scorer,net\n0,1\n", "bodyparts"),
    "short": ("scorer,n,n,n\nbodyparts,a,a,a\ncoords,x,y,likelihood\n0,1,2\n", "3 cells in the row of 0, expected 4"),
    "words": ("scorer,n,n,n\nbodyparts,a,a,a\ncoords,x,y,likelihood\n0,1,two,0.5\n", '"two" found'),
    "units": ("scorer,n,n,n\nbodyparts,a,a,a\ncoords,x,y,likelihood\nunit,px,px,1\n", '"px" found in the row of unit,'),
    "no y": ("scorer,n,n\nbodyparts,a,a\ncoords,x,z\n0,1,2\n", 'no column of the y of "a"'),
    "twice": ("scorer,n,n,n\nbodyparts,a,a,a\ncoords,x,y,likelihood\n7,1,2,1\n7,1,3,1\n", "a second row of frame 7"),
    "semicolons": ("scorer;n;n;n\nbodyparts;a;a;a\n", "cells are separated by semicolons, expected commas"),
    "no frame": ("scorer,n,n,n\nbodyparts,a,a,a\ncoords,x,y,likelihood\n", "no frame"),
    "sleap": ("track,frame_idx\n0,0\n", 'no column like "nose.x"'),
    "sleap units": ("track,frame_idx,a.x,a.y\n,,px,px\n", '"px" found in row 1, expected'),
    "sleap no y": ("track,frame_idx,a.x,a.z\n0,0,1,2\n", 'no column of the y of "a"'),
    "sleap short": ("track,frame_idx,a.x,a.y\n0,0,1,2\n0,1\n", "2 cells in row 2, expected 4"),
    "sleap frame": ("track,frame_idx,a.x,a.y,a.score\n0,,1,2,0.5\n", "without frame_idx"),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_malformed_table_is_one_clear_line(name: str, tmp_path: Path) -> None:
    content, told = TABLES[name]
    path = tmp_path / "cam.csv"
    path.write_text(content)
    with pytest.raises(SequenceError) as caught:
        open_keypoints(path)
    assert told in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_have_changed_are_read_anew(tmp_path: Path) -> None:
    """In a notebook a detector may have run again meanwhile."""
    file = tmp_path / "one.csv"
    for k, x in enumerate((10.0, 20.0)):
        table = f"frame_idx,instance.score,nose.x,nose.y,nose.score\n0,0.9,{x},5,0.9\n"
        file.write_text(table)
        os.utime(file, ns=(k, k))
        views = KeypointViews.open(str(tmp_path / "{view}.csv"), ("one",))
        assert views.sources[0].at(0).found[0, 0, 0] == x
        assert KeypointViews.open(str(tmp_path / "{view}.csv"), ("one",)) is views


@pytest.mark.parametrize("name", ["absent", "video.mp4"])
def test_what_is_no_file_of_keypoints_is_one_clear_line(name: str, tmp_path: Path) -> None:
    (tmp_path / "video.mp4").touch()
    with pytest.raises(SequenceError, match="expected a folder of OpenPose's JSON files"):
        open_keypoints(tmp_path / name)


@pytest.mark.parametrize(
    ("kind", "numbers"), [("json", (1 + 5, 1 + 8)), ("images", (6, 9)), ("rows", (5, 8)), ("sleap", (5, 8))]
)
def test_keypoints_are_those_of_the_images_of_a_frame(tmp_path: Path, kind: str, numbers: tuple[int, int]) -> None:
    """Images numbered from 1 on, the second view three images late: files are named as images, tables count from 0."""
    for view in ("one", "two"):
        if kind == "json":
            (tmp_path / view).mkdir()
            for n in range(20):
                people = {"people": [{"pose_keypoints_2d": [n, 1.0, 0.9] * 17}]}
                (tmp_path / view / f"{n:04d}.json").write_text(json.dumps(people))
        else:
            head = (
                "frame_idx,nose.x,nose.y,nose.score"
                if kind == "sleap"
                else "scorer,a,a,a\nbodyparts,nose,nose,nose\ncoords,x,y,likelihood"
            )
            label = "labeled/img{:04d}.png" if kind == "images" else "{}"
            rows = [f"{label.format(n)},{n},1,0.9" for n in range(20)]
            (tmp_path / f"{view}.csv").write_text("\n".join([head, *rows, ""]))
    cameras = (Camera.looking_at(name, (64, 48), 50.0, (x, -2, 1), (0, 0, 1)) for name, x in (("one", 0), ("two", 1)))
    rig = Rig(tuple(cameras))
    views = KeypointViews.open(str(tmp_path / ("{view}" if kind == "json" else "{view}.csv")), rig.names)
    found = views.at(Frame(5, 0.2, (None, None), (), (5, 8), 1), rig)
    assert tuple(round(view[0, 0, 0]) for view in found) == numbers
    assert [round(view[0, 0, 0]) for view in views.at(Frame(5, 0.2, (None, None)), rig)] == [5, 5]
