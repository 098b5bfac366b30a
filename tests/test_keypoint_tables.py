"""Tables of keypoints as programs of today write them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tracker.bodies.keypoint_layouts import open_keypoints
from tracker.foundation.errors import SequenceError

HEAD = (
    "scorer,net,net,net,net,net,net\nbodyparts,nose,nose,nose,hip_l,hip_l,hip_l\ncoords,x,y,likelihood,x,y,likelihood\n"
)


TABLES = {
    "deeplabcut, spellings": HEAD + "0,1,2,0.9,NaN,,\n2,1,2,0.9,-1,-1,-1\n",
    "deeplabcut, labelled": (
        "scorer,,,net,net,net,net\nbodyparts,,,nose,nose,hip_l,hip_l\ncoords,,,x,y,x,y\n"
        "labeled-data,cam,img000.png,1,2,,\nlabeled-data,cam,img002.png,1,2,,\n"
    ),
    "sleap": (
        "track,frame_idx,instance.score,hip_l.score,hip_l.x,hip_l.y,nose.score,nose.x,nose.y\n"
        ",0,1.2,0.8,,,0.9,1,2\n,1,,,,,,,\n,2,1.2,0.8,,,0.9,1,2\n"
    ),
    "sleap, labelled": "track,frame_idx,nose.x,nose.y,nose.score,hip_l.x,hip_l.y,hip_l.score\n,0,1,2,,,,\n,2,1,2,,,,\n",
    "sleap, no scores": (
        "track,frame_idx,nose.x,nose.y,nose.score,hip_l.x,hip_l.y,hip_l.score\n,0,1,2,0,,,0\n,2,1,2,0,,,0\n"
    ),
    "sleap-io, instances": (
        "frame_idx,track,track_score,score,nose.x,nose.y,nose.score,hip_l.x,hip_l.y,hip_l.score\n"
        "0,a,0.5,1.2,1,2,0.9,,,0.8\n1,,,,,,,,,\n2,a,0.5,1.2,1,2,0.9,,,\n"
    ),
    "sleap-io, frames": (
        "frame_idx,inst0.track,inst0.score,inst0.nose.x,inst0.nose.y,inst0.nose.score,inst0.hip_l.x,inst0.hip_l.y,"
        "inst1.track,inst1.score,inst1.nose.x,inst1.nose.y,inst1.nose.score,inst1.hip_l.x,inst1.hip_l.y\n"
        "0,a,1.2,1,2,0.9,,,,,,,,,\n2,,,,,,,,b,1.2,1,2,0.9,,\n"
    ),
    "sleap-io, points": (
        "frame_idx,node,x,y,track,track_score,instance_score,score\n"
        "0,nose,1,2,a,0.5,1.2,0.9\n0,hip_l,,,a,0.5,1.2,0.8\n2,nose,1,2,a,0.5,1.2,0.9\n"
    ),
    "columns": (
        "frame,time,NOSE_x,NOSE_y,NOSE_z,NOSE_visibility,LEFT_HIP_x,LEFT_HIP_y\n"
        "0,0.0,1,2,-3,0.9,,\n2,0.1,1,2,-3,0.9,,\n"
    ),
}


@pytest.mark.parametrize("program", TABLES)
def test_a_table_is_read_as_programs_of_today_write_it(program: str, tmp_path: Path) -> None:
    """As sleap-io 0.9.5 wrote them; a person by hand has no score, or zeros."""
    (tmp_path / "cam.csv").write_text(TABLES[program])
    source = open_keypoints(tmp_path / "cam.csv")
    assert set(source.at(0).names) == {"nose", "left_hip"}
    assert source.named == ("labelled" in program and "deeplabcut" in program)
    for number in (0, 2):
        found = source.at(number)
        assert len(found.found) == 1
        nose, hip = (found.found[0, found.names.index(name)] for name in ("nose", "left_hip"))
        np.testing.assert_array_equal(nose[:2], [1, 2])
        assert nose[2] in (0.9, 1.0)
        np.testing.assert_array_equal(hip, [np.nan] * 3)
    assert len(source.at(1).found) == 0


def test_persons_in_points_of_a_table_are_told_apart(tmp_path: Path) -> None:
    rows = "".join(f"0,{node},{x},5\n" for x in (10, 20) for node in ("nose", "tail"))
    (tmp_path / "cam.csv").write_text(f"frame_idx,node,x,y\n{rows}")
    np.testing.assert_array_equal(open_keypoints(tmp_path / "cam.csv").at(0).found[..., 0], [[10, 10], [20, 20]])


BAD_TABLES = {
    "deeplabcut, names twice": (HEAD.replace("hip_l", "nose") + "0,1,2,1,3,4,1\n", 'two columns are the x of "nose"'),
    "sleap, names twice": ("frame_idx,nose.x,nose.y,Nose.x,Nose.y\n0,1,2,3,4\n", 'two columns are the x of "nose"'),
    "several videos": (
        "frame_idx,video_path,nose.x,nose.y\n0,a.mp4,1,2\n0,b.mp4,3,4\n",
        r"rows of 2 videos (a.mp4, b.mp4)",
    ),
    "points of videos": ("frame_idx,node,x,y,video_path\n0,n,1,2,a.mp4\n0,n,3,4,b.mp4\n", "expected those of one view"),
    "frame": ("frame_idx,nose.x,nose.y\nfirst,1,2\n", '"first" found in row 1, expected a number'),
}


@pytest.mark.parametrize("name", BAD_TABLES)
def test_a_table_that_says_two_things_is_refused(name: str, tmp_path: Path) -> None:
    content, told = BAD_TABLES[name]
    (tmp_path / "cam.csv").write_text(content)
    with pytest.raises(SequenceError) as caught:
        open_keypoints(tmp_path / "cam.csv")
    assert told in str(caught.value)


@pytest.mark.parametrize("told", [{"names": ("nose", "tail")}, {"layout": "body_25"}])
def test_a_table_names_its_keypoints_itself(told: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "cam.csv").write_text(HEAD + "0,1,2,0.9,3,4,0.9\n")
    with pytest.raises(SequenceError, match="leave names and layout out"):
        open_keypoints(tmp_path / "cam.csv", **told)
