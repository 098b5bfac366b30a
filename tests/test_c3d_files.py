"""C3D files as programs write them: what of them is read, and what is said where something is missing."""

from __future__ import annotations

import contextlib

import c3d
import ezc3d
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from marker_files import (
    NAMES,
    POINTS,
    POINTS_MM,
    TIMES_S,
    C3d,
    point_parameters,
    points_bytes,
    rotation_bytes,
    same,
    written,
)

from tracker.foundation.errors import SequenceError
from tracker.results.evaluation.marker_set import MarkerSet, column, joints_of
from tracker.results.marker_layouts import read_markers


@pytest.mark.filterwarnings("ignore::UserWarning")  # of the library, of parameters that are not there
@pytest.mark.parametrize("processor", [84, 85, 86], ids=["Intel", "DEC", "MIPS"])
@pytest.mark.parametrize("whole", [False, True])
def test_c3d_of_every_processor_is_read(tmp_path, processor, whole):
    file = C3d(processor)
    residuals = np.zeros((20, 3))
    residuals[3, 1] = -1
    if whole:
        frames = file.whole(np.concatenate([np.round(10 * POINTS_MM), residuals[..., None]], axis=-1))
    else:
        frames = points_bytes(file, POINTS_MM, residuals)
    scale = 0.1 if whole else -1.0
    content = file.written(point_parameters(SCALE=scale), frames, header={"points": 3, "scale": scale})
    wanted = POINTS.copy()
    wanted[3, 1] = np.nan
    same(read_markers(written(tmp_path, content)), wanted)
    with (tmp_path / "a.trc").open("rb") as opened:
        theirs = np.array([points for _, points, _ in c3d.Reader(opened).read_frames()])
    np.testing.assert_allclose(np.where(theirs[..., 3:4] < 0, np.nan, theirs[..., :3]), 1000 * wanted, atol=1e-3)


C3D_FORMS: dict[str, tuple[dict[str, object], dict[str, float]]] = {
    "usual": ({}, {}),
    "first frame 0, as of OptiTrack Motive": ({}, {"first": 0, "last": 19}),
    "header says more frames, as of Optotrak": ({}, {"last": 1149}),
    "header says fewer frames": ({}, {"last": 3}),
    "a unit a point, as of Optotrak": ({"UNITS": ["mm", "mm", "mm"]}, {}),
    "frames as a number with a fraction, as of Vicon": ({"FRAMES": 20.0}, {}),
    "no POINT:FRAMES": ({"FRAMES": None}, {}),
    "POINT:FRAMES of a longer file, header and data agree": ({"FRAMES": 65}, {}),
    "no POINT:RATE": ({"RATE": None}, {}),
    "no POINT:SCALE": ({"SCALE": None}, {}),
    "no POINT:USED": ({"USED": None}, {}),
    "rate in the parameter alone": ({}, {"rate": 0.0}),
    "an event that is none": ({}, {"first": 1}),
    "labels filled up": ({"LABELS": ["LSHO   ", "LELB   ", "LWRI\0xx"]}, {}),
    "labels in two parameters": ({"LABELS": ["LSHO"], "LABELS2": ["LELB", "LWRI"]}, {}),
}


@pytest.mark.parametrize("form", C3D_FORMS)
def test_a_c3d_is_read_in_every_form(tmp_path, form):
    changes, header = C3D_FORMS[form]
    file = C3d()
    told = {name: value for name, value in point_parameters(**changes).items() if value is not None}
    content = bytearray(file.written(told, points_bytes(file, POINTS_MM), header={"points": 3, **header}))
    if "event" in form:
        content[300:302] = b"\xff\xff"
    read = read_markers(written(tmp_path, bytes(content)))
    same(read)
    assert len(read.remarks) == ("longer" in form)


def test_a_recording_that_was_stopped_early_is_read_and_told(tmp_path):
    """As a file of Optotrak's: 1149 frames by POINT:FRAMES and header, and whole frames up to its end."""
    file, n_frames = C3d(), 20
    content = file.written(point_parameters(FRAMES=1149), points_bytes(file, POINTS_MM), header={"last": 1149})
    ended = content[: len(content) // 512 * 512 - 1024 + n_frames * 3 * 16]
    read = read_markers(written(tmp_path, ended))
    same(read)
    assert read.remarks == ("POINT:FRAMES of a.trc says 1149 frames, it ends after 20",)
    with pytest.raises(SequenceError, match="POINT:FRAMES says 1149 frames, 19 are there: the file is cut off"):
        read_markers(written(tmp_path, ended[:-1]))


def test_the_time_of_a_part_of_a_recording_is_that_of_the_recording(tmp_path):
    file = C3d()
    frames = points_bytes(file, POINTS_MM)
    part = file.written(point_parameters(), frames, header={"points": 3, "first": 51, "last": 70})
    np.testing.assert_allclose(read_markers(written(tmp_path, part)).times_s, TIMES_S + 0.5)
    long = {"TRIAL:ACTUAL_START_FIELD": [0x1001, 1], "TRIAL:ACTUAL_END_FIELD": [0x1014, 1]}
    late = file.written(point_parameters() | long, frames, header={"points": 3})
    np.testing.assert_allclose(read_markers(written(tmp_path, late)).times_s, TIMES_S + 0x11000 / 100)


@pytest.mark.parametrize("told", [{"TRIAL:ACTUAL_START_FIELD": [1, 0], "TRIAL:ACTUAL_END_FIELD": [4464, 1]}, {}])
def test_c3d_of_more_frames_than_two_bytes_count_is_read(tmp_path, told):
    file, n_frames = C3d(), 70_000
    frames = np.full((n_frames, 1, 3), 5.0)
    content = file.written(
        point_parameters(USED=1, LABELS=["LSHO"], FRAMES=65_535) | told,
        points_bytes(file, frames),
        header={"points": 1, "last": 65_535},
    )
    n_read = len(read_markers(written(tmp_path, content)).times_s)
    assert n_read == n_frames if told else 0 <= n_read - n_frames < 512 / 16


@pytest.mark.parametrize(("header", "rate"), [(4, 200.0), (0, 200.0), (4, 0.0)])
def test_analog_signals_between_the_points_are_stepped_over(tmp_path, header, rate):
    """Some programs tell them in the header alone, others in the parameters."""
    file = C3d()
    analog = np.full((20, 4), 7.0)
    told = point_parameters() | {"ANALOG:USED": 2, "ANALOG:RATE": rate}
    content = file.written(told, points_bytes(file, POINTS_MM, analog=analog), header={"points": 3, "analog": header})
    same(read_markers(written(tmp_path, content)))


def test_points_of_no_length_and_of_no_name_are_left_out_and_told(tmp_path):
    file = C3d()
    frames = points_bytes(file, POINTS_MM)
    angles = file.written(point_parameters(UNITS=["mm", "deg", "cm"]), frames, header={"points": 3})
    read = read_markers(written(tmp_path, angles))
    same(read, POINTS[:, [0, 2]] * np.array([1.0, 10.0])[:, None], ("LSHO", "LWRI"))
    assert read.remarks == ("a.trc: points that are no lengths are left out: 1 in 'deg'",)
    fewer = file.written(point_parameters(LABELS=["LSHO", "", "LWRI"]), frames, header={"points": 3})
    read = read_markers(written(tmp_path, fewer))
    same(read, POINTS[:, [0, 2]], ("LSHO", "LWRI"))
    assert read.remarks == ("a.trc: 1 of 3 points have no name, and are left out",)


def test_what_ndi_writes_for_a_gap_is_one(tmp_path):
    file, gap = C3d(), POINTS_MM.copy()
    gap[2, 0] = -3.697314e28
    wanted = POINTS.copy()
    wanted[2, 0] = np.nan
    same(read_markers(written(tmp_path, file.written(point_parameters(), points_bytes(file, gap)))), wanted)


SEGMENTS = ("pelvis_4X4", "l_thigh_4X4", "l_shank_4X4")


ROTATION = {"ROTATION:USED": 3, "ROTATION:RATIO": 1, "ROTATION:LABELS": SEGMENTS}


@pytest.mark.parametrize(
    ("labels", "left_out"), [(None, ""), ([""], ""), (None, "ROTATION:USED"), (None, "POINT:USED")]
)
def test_origins_of_segments_stand_for_markers_as_of_theia(tmp_path, labels, left_out):
    file = C3d()
    told = {"POINT:USED": 0, "POINT:RATE": 100.0, "POINT:FRAMES": 20, "POINT:UNITS": ["mm"], **ROTATION}
    if labels:
        told["POINT:LABELS"] = labels
    told.pop(left_out, None)
    read = read_markers(written(tmp_path, file.written(told, b"", rotations=rotation_bytes(file, POINTS_MM))))
    same(read, names=SEGMENTS)
    assert [column(name, tmp_path, read) for name in ("pelvis", "l_thigh", "l_shank_4X4")] == [0, 1, 2]
    made = joints_of(MarkerSet(joints={"left_knee": ("l_shank",)}), tmp_path, read)
    np.testing.assert_allclose(made.points[:, 0], POINTS[:, 2], atol=1e-6)


def test_origins_of_segments_come_behind_points_at_the_frames_of_these(tmp_path):
    file = C3d()
    twice = np.repeat(POINTS_MM + 100, 2, axis=0)
    frames, rotations = points_bytes(file, POINTS_MM), rotation_bytes(file, twice)
    told = point_parameters() | ROTATION | {"ROTATION:RATIO": 2}
    read = read_markers(written(tmp_path, file.written(told, frames, header={"points": 3}, rotations=rotations)))
    same(read, np.concatenate([POINTS, POINTS + 0.1], axis=1), (*NAMES, *SEGMENTS))
    unnamed = {name: value for name, value in told.items() if name != "ROTATION:LABELS"}
    read = read_markers(written(tmp_path, file.written(unnamed, frames, header={"points": 3}, rotations=rotations)))
    same(read)
    assert "ROTATION:LABELS is missing" in read.remarks[0]


def test_segments_that_ezc3d_writes_are_read(tmp_path):
    content = ezc3d.c3d()
    placed = np.tile(np.eye(4)[..., None, None], (1, 1, 2, 20))
    placed[:3, 3] = np.moveaxis(POINTS_MM[:, :2], 2, 0).transpose(0, 2, 1)
    content["parameters"]["POINT"]["RATE"]["value"], content["parameters"]["POINT"]["UNITS"]["value"] = [100.0], ["mm"]
    content["parameters"]["POINT"]["LABELS"]["value"] = ["LSHO", "LELB", "LWRI"]
    content["data"]["points"] = np.concatenate([np.moveaxis(POINTS_MM, 2, 0).transpose(0, 2, 1), np.ones((1, 3, 20))])
    content["data"]["rotations"] = placed
    for name, value in (("LABELS", ["a", "b"]), ("RATE", [100.0]), ("USED", [2]), ("FRAMES", [20])):
        content.add_parameter("ROTATION", name, value)
    content.write(str(tmp_path / "a.c3d"))
    same(read_markers(tmp_path / "a.c3d"), np.concatenate([POINTS, POINTS[:, :2]], axis=1), (*NAMES, "a", "b"))


@pytest.mark.filterwarnings("ignore::UserWarning", "ignore::RuntimeWarning")  # of the library that writes it
def test_c3d_of_pose2sim_is_read(tmp_path):
    """Whole millimetres, as it has the package c3d write them."""
    writer = c3d.Writer(point_rate=100, analog_rate=0, point_scale=1.0, point_units="mm", gen_scale=-1.0)
    writer.set_point_labels(NAMES)
    writer.set_screen_axis(X="+Z", Y="+Y")
    for frame in POINTS_MM:
        writer.add_frames([(np.hstack([np.round(frame), np.zeros((3, 2))]), np.array([]))])
    writer.set_start_frame(0)
    with (tmp_path / "a.c3d").open("wb") as opened:
        writer.write(opened)
    same(read_markers(tmp_path / "a.c3d"), np.round(POINTS_MM) / 1000)


C3D_FAULTS: dict[str, tuple[dict[str, object], dict[str, float], str]] = {
    "no names": ({"LABELS": None}, {}, "POINT:LABELS is missing: 3 points in it have no names"),
    "no unit": ({"UNITS": None}, {}, "POINT:UNITS is missing: set it in the marker set"),
    "an empty unit": ({"UNITS": ["  "]}, {}, "POINT:UNITS is missing: set it in the marker set"),
    "a unit of no length": ({"UNITS": ["deg"]}, {}, 'POINT:UNITS is "deg"; valid: cm'),
    "units of nobody": ({"UNITS": ["mm", "deg"]}, {}, "POINT:UNITS has 2 units for 3 points"),
    "no rate": ({"RATE": None}, {"rate": 0.0}, "POINT:RATE is missing, and 0 in the header"),
    "no scale": ({"SCALE": 0.0}, {"scale": 0.0}, "POINT:SCALE is missing, and 0 in the header"),
    "cut off": ({"FRAMES": 40}, {"last": 40}, "POINT:FRAMES says 40 frames, 21 are there: the file is cut off"),
    "no points": ({"USED": 0}, {}, "POINT:USED is 0: no markers in it"),
    "signals alone": ({"USED": 0}, {"analog": 16}, "POINT:USED is 0: no markers in it: analog signals alone"),
    "one frame": ({"FRAMES": 1}, {}, "1 frames at 100 Hz"),
}


@pytest.mark.parametrize("fault", C3D_FAULTS)
def test_what_is_missing_in_a_c3d_is_named(tmp_path, fault):
    changes, header, message = C3D_FAULTS[fault]
    file = C3d()
    told = {name: value for name, value in point_parameters(**changes).items() if value is not None}
    content = file.written(told, points_bytes(file, POINTS_MM), header={"points": 3, **header})
    with pytest.raises(SequenceError) as raised:
        read_markers(written(tmp_path, content, "a.c3d"))
    assert f"a.c3d: {message}" in str(raised.value)


def test_a_c3d_without_parameters_is_told_as_such(tmp_path):
    for content, message in (
        (b"\x02\x50" + bytes(100), "ends before its parameters"),
        (b"\x02\x50" + bytes(600), "written by a processor 0"),
        (b"\x02\x50" + bytes(510) + b"\x01\x50\x01\x54" + bytes(508), "no markers in it"),
    ):
        with pytest.raises(SequenceError, match=message):
            read_markers(written(tmp_path, content, "a.c3d"))


@given(data=st.data())
def test_a_damaged_c3d_is_read_or_refused(tmp_path_factory, data):
    """Whatever a byte becomes and wherever a file ends, a fault is one of the file's, never one of Python's."""
    file = C3d()
    whole = bytearray(
        file.written(
            point_parameters() | ROTATION, points_bytes(file, POINTS_MM), rotations=rotation_bytes(file, POINTS_MM)
        )
    )
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, 1100))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(whole)))
    path = written(tmp_path_factory.mktemp("damaged"), bytes(whole[: max(cut, 3)]), "a.c3d")
    with contextlib.suppress(SequenceError):
        read_markers(path)
