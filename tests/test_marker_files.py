"""Marker files as programs write them: what of them is read, and what is said where something is missing."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from pathlib import Path

import c3d
import ezc3d
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from marker_files import NAMES, POINTS_MM, C3d, point_parameters, points_bytes, rotation_bytes, trc

from tracker.errors import ConfigError, SequenceError
from tracker.evaluation.marker_set import MarkerSet, check_marker_set, column, joints_of, load_marker_set
from tracker.marker_layouts import read_markers
from tracker.markers import Markers, metres_in

TIMES_S = np.arange(20) / 100
POINTS = POINTS_MM / 1000


def written(folder: Path, content: str | bytes, name: str = "a.trc") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def same(read: Markers, points: np.ndarray = POINTS, names: tuple[str, ...] = NAMES) -> None:
    assert read.names == names
    np.testing.assert_allclose(read.times_s, TIMES_S[: len(points)], atol=1e-9)
    np.testing.assert_allclose(read.points, points, atol=2e-7)


PADDED = trc(values="  100.00\t\t  100.00\t\t    20\t\t     3\t\tmm\t\t  100.00\t     1")
TRC_FORMS: dict[str, str | bytes] = {
    "as OpenSim writes it, with a tab behind": trc().replace("\t\t\n", "\t\t\t\n").replace("\tZ3\n", "\tZ3\t\n"),
    "header cells padded with tabs, as in an example of OpenSim's": PADDED,
    "path in Latin-1": trc(path="C:\\Übung\\a.trc").encode("latin-1"),
    "path in a code page whose letters end lines in Unicode": trc(path="C:\\\x85\x1c\xf8\\a.trc").encode("latin-1"),
    "UTF-8 with a mark": trc(path="Übung").encode("utf-8-sig"),
    "UTF-16, as Excel's Unicode text": trc().encode("utf-16"),
    "lines of Windows": trc().replace("\n", "\r\n").encode(),
    "lines of Windows, copied as text": trc().replace("\n", "\r\r\n").encode(),
    "lines of an old Macintosh": trc().replace("\n", "\r").encode(),
    "no blank line below the header": trc().replace("\n\n", "\n"),
    "further blank lines": trc().replace("\n\n", "\n\t\t\n\n"),
    "Ctrl-Z behind, and filled up": trc() + "\x1a\0\0",
    "commas of decimals": trc().replace(".", ",").replace("a,trc", "a.trc"),
    "tabs behind the rows": trc().replace("\n", "\t\t\n"),
    "names with one tab between": trc().replace("LSHO\t\t\tLELB\t\t\tLWRI\t\t", "LSHO\tLELB\tLWRI"),
    "axes that count from another number, as of a part of a file": trc().replace("X1\tY1\tZ1", "X9\tY9\tZ9"),
    "commas for tabs, as of a spreadsheet": trc().replace("\t", ","),
    "cells in quotes, as of a spreadsheet": trc().replace("LSHO", '"LSHO"').replace("PathFile", " PathFile"),
    "a script of MATLAB": trc().replace("Frame#", "#Frame"),
    "columns of spaces": re.sub("\t+", "   ", trc()),
    "a value of the header left empty in place": trc(values="100.00\t\t20\t3\tmm\t100.00\t1"),
    "fewer keys, as MOtoNMS writes them": trc(values="100.00\t20\t3\tmm\t100.00\t1").replace("CameraRate\t", ""),
}


@pytest.mark.parametrize("form", TRC_FORMS)
def test_a_trc_is_read_in_every_form(tmp_path, form):
    read = read_markers(written(tmp_path, TRC_FORMS[form]))
    same(read)
    assert read.remarks == ()


@pytest.mark.parametrize("unit", ["mm", "MM", "[mm]", "millimeters", "Millimetres", "Millimeter"])
def test_a_unit_is_known_by_its_word(tmp_path, unit):
    same(read_markers(written(tmp_path, trc().replace("\tmm\t", f"\t{unit}\t"))))
    found = [metres_in(word) for word in ("Meters", "(cm)", "Inches", "ft", "deg", "", "Nmm")]
    assert found == [1.0, 0.01, 0.0254, 0.3048, None, None, None]


NOT_A_NUMBER = (
    *("", "NaN", "-nan", "NAN", "nan(ind)", "-nan(ind)", "nan(snan)", "-nan(0x7ffff)", "NaNQ", "1.#QNAN", "1.#QNAN0"),
    *("-1.#IND", "-1.#IND00", "1.#SNAN", "1.#J", "-1.#R", "1.#INF00", "inf", "-Infinity", "NA", "N/A", "n/a", "<NA>"),
    *("#N/A", "#NV", "#NUM!", "#VALUE!", "#DIV/0!", "null", "None", "*******", "-", "--"),
)


@pytest.mark.parametrize("spelling", NOT_A_NUMBER)
def test_not_a_number_is_a_gap_in_every_spelling(tmp_path, spelling):
    cells = [[f"{value:.1f}" for value in row.ravel()] for row in POINTS_MM]
    cells[4][3:6] = [spelling] * 3
    wanted = POINTS.copy()
    wanted[4, 1] = np.nan
    same(read_markers(written(tmp_path, trc(cells))), wanted)
    commas = trc(cells).replace(".", ",").replace("a,trc", "a.trc")
    same(read_markers(written(tmp_path, commas)), wanted)


def test_cells_left_out_at_the_end_of_a_row_are_gaps(tmp_path):
    cells = [[f"{value:.1f}" for value in row.ravel()] for row in POINTS_MM]
    del cells[7][6:]
    wanted = POINTS.copy()
    wanted[7, 2] = np.nan
    same(read_markers(written(tmp_path, trc(cells))), wanted)


@pytest.mark.parametrize("name", ["", " "])
def test_markers_without_a_name_are_left_out_and_counted(tmp_path, name):
    read = read_markers(written(tmp_path, trc(names=("LSHO", name, "LWRI"))))
    same(read, POINTS[:, [0, 2]], ("LSHO", "LWRI"))
    assert read.remarks == ("a.trc: 1 of 3 markers have no name, and are left out",)
    with pytest.raises(
        ConfigError, match=r'no marker "LELB"; .*; a\.trc: 1 of 3 markers have no name, and are left out'
    ):
        column("LELB", Path("set.toml"), read)


def test_names_that_pose2sim_did_not_add_are_left_out_and_counted(tmp_path):
    """Its markers of the augmentation: 22 names, axes and columns of 65."""
    read = read_markers(written(tmp_path, trc().replace("\t\t\tLELB\t\t\tLWRI", "")))
    same(read, POINTS[:, :1], ("LSHO",))
    assert read.remarks == ("a.trc: 2 of 3 markers have no name, and are left out",)


@pytest.mark.parametrize(
    ("change", "remark"),
    [
        (lambda text: text.replace("\t20\t", "\t25\t"), "NumFrames of a.trc is 25, its table has 20"),
        (lambda text: text.replace("\t20\t3\t", "\t20\t4\t"), "NumMarkers of a.trc is 4, its table has 3"),
        (lambda text: text.replace("100.00\t100.00\t20", "120\t100\t20"), "DataRate of a.trc is 120 Hz, by its column"),
        (lambda text: text.replace("\t20\t3\t", "\t20.0\t3.0\t"), ""),
    ],
)
def test_what_a_trc_tells_in_two_ways_is_remarked(tmp_path, change, remark):
    read = read_markers(written(tmp_path, change(trc())))
    same(read)
    assert len(read.remarks) == bool(remark)
    assert "".join(read.remarks).startswith(remark)


def test_rounded_times_are_no_other_rate(tmp_path):
    """60 Hz in milliseconds: 0, 0.017, 0.033, 0.05, most of the steps 0.017."""
    text = re.sub(r"\n(\d+)\t0\.\d+", lambda found: f"\n{found[1]}\t{(int(found[1]) - 1) / 60:.3f}", trc())
    read = read_markers(written(tmp_path, text.replace("100.00\t100.00", "60\t60")))
    assert read.remarks == ()


TRC_FAULTS: dict[str, tuple[Callable[[str], str], str]] = {
    "a value missing before the unit": (
        lambda text: text.replace("100.00\t100.00\t20\t3\tmm\t100.00\t1", "100.00\t20\t3\tmm\t100.00\t1"),
        "line 3 has 6 values for the 7 names in line 2: one of DataRate, CameraRate, NumFrames is missing",
    ),
    "no unit": (lambda text: text.replace("\tmm\t", "\t"), "line 3 has 6 values for the 7 names in line 2: Units is"),
    "several values missing": (lambda text: text.replace("\t20\t3\t", "\t"), "line 3 has 5 values for the 7 names"),
    "no column Units": (
        lambda text: text.replace("\tmm\t", "\t").replace("\tUnits\t", "\t"),
        'Units in line 3 is missing: say it in the marker set, for instance unit = "mm"',
    ),
    "a unit of no length": (lambda text: text.replace("\tmm\t", "\tdeg\t"), 'Units in line 3 is "deg"; valid: cm, dm'),
    "two names for three columns": (
        lambda text: text.replace("LSHO\t\t\tLELB\t\t\tLWRI", "LSHO\tLWRI"),
        "line 4 names 2 markers, line 5 has the axes of 3",
    ),
    "no names": (lambda text: text.replace("Frame#", "Nr"), 'line 4 is "Nr'),
    "axes in another order": (lambda text: text.replace("X1\tY1\tZ1", "X1\tZ1\tY1"), 'line 5 is "X1\tZ1\tY1'),
    "no axes": (lambda text: re.sub("\t\tX1.*\n\n", "", text), "line 5 is "),
    "cells of nobody": (lambda text: text.replace("\n7\t", "\n7\t\t"), "12 cells in line 13, expected at most 11"),
    "a word": (lambda text: text.replace("\n7\t", "\n7\tsoon"), "'soon0.060' in line 13, expected a number"),
    "a time twice": (lambda text: text.replace("\t0.060\t", "\t0.050\t"), "Time does not run forwards in line 13"),
    "a time missing": (lambda text: text.replace("\t0.060\t", "\t\t"), "Time does not run forwards in line 13"),
    "one row": (lambda text: text[: text.index("\n2\t")], "Time does not run forwards in a table of one row"),
    "milliseconds": (
        lambda text: re.sub(r"\n(\d+)\t0\.(\d+)\t", r"\n\1\t\2\t", text),
        "DataRate is 100.00 Hz, and Time steps by 10: expected seconds",
    ),
}


@pytest.mark.parametrize("fault", TRC_FAULTS)
def test_what_is_wrong_in_a_trc_is_told_by_its_line(tmp_path, fault):
    change, message = TRC_FAULTS[fault]
    assert change(trc()) != trc()
    with pytest.raises(SequenceError) as told:
        read_markers(written(tmp_path, change(trc())))
    assert f"a.trc: {message}" in str(told.value)


@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("a.trc", "NO_OF_FRAMES\t20\nNO_OF_CAMERAS\t8\n", "a TSV export of Qualisys Track Manager"),
        ("a.tsv", "FILE_VERSION\t2.0.0\nNO_OF_FRAMES\t20\n", "a TSV export of Qualisys Track Manager"),
        ("a.csv", "Format Version,1.23,Take Name,a\n", "a CSV export of OptiTrack Motive"),
        ("a.csv", "Trajectories\n100\n,,Anna:LSHO\n", "a CSV export of Vicon Nexus"),
        ("a.mot", "Coordinates\nversion=1\nnRows=20\nendheader\n", "a table of OpenSim (.mot, .sto)"),
        ("a.bvh", "HIERARCHY\nROOT Hips\n", "a BVH file"),
        ("a.c3d", "something else", "no file of markers"),
        ("a.trc", "", "no file of markers"),
    ],
)
def test_other_files_are_named(tmp_path, name, content, what):
    with pytest.raises(SequenceError, match=re.escape(what) + ".*expected TRC or C3D"):
        read_markers(written(tmp_path, content, name))


def test_a_file_is_known_by_its_content(tmp_path):
    same(read_markers(written(tmp_path, trc(), "a.txt")))
    file = C3d()
    content = file.written(point_parameters(), points_bytes(file, POINTS_MM), header={"points": 3})
    same(read_markers(written(tmp_path, content, "a.trc")))


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
    "no unit": ({"UNITS": None}, {}, "POINT:UNITS is missing: say it in the marker set"),
    "an empty unit": ({"UNITS": ["  "]}, {}, "POINT:UNITS is missing: say it in the marker set"),
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


def test_the_unit_that_a_file_lacks_is_said_in_the_set(tmp_path):
    file = C3d()
    told = {name: value for name, value in point_parameters().items() if name != "POINT:UNITS"}
    path = written(tmp_path, file.written(told, points_bytes(file, POINTS_MM), header={"points": 3}))
    (tmp_path / "set.toml").write_text('unit = "mm"\n[joints]\nleft_elbow = ["LELB"]\n')
    chosen = load_marker_set(tmp_path / "set.toml")
    same(read_markers(path, chosen.unit))
    same(read_markers(written(tmp_path, trc()), "cm"), 10 * POINTS)
    (tmp_path / "set.toml").write_text('unit = "deg"\n[joints]\nleft_elbow = ["LELB"]\n')
    with pytest.raises(ConfigError, match="unit"):
        load_marker_set(tmp_path / "set.toml")


@pytest.mark.parametrize(("per_mm", "told"), [(0.001, "mm"), (0.001, "cm"), (1.0, "m")])
def test_a_unit_that_cannot_be_is_refused(tmp_path, per_mm, told):
    """Angles agree in any unit, places do not: metres that are called millimetres, or the other way round."""
    cells = [[f"{value * per_mm:.6f}" for value in row.ravel()] for row in POINTS_MM]
    path = written(tmp_path, trc(cells).replace("\tmm\t", f"\t{told}\t"))
    with pytest.raises(SequenceError, match=r"markers lie .* apart, expected 0\.03 to 100: its unit is another one"):
        read_markers(path)
    same(read_markers(path, "mm" if per_mm == 1 else "m"))


@pytest.mark.parametrize("kind", ["trc", "c3d"])
def test_a_name_of_two_markers_is_refused_where_it_is_used(tmp_path, kind):
    names = ("LSHO", "LELB", "LELB")
    file = C3d()
    content = file.written(point_parameters(LABELS=names), points_bytes(file, POINTS_MM), header={"points": 3})
    read = read_markers(written(tmp_path, trc(names=names) if kind == "trc" else content))
    assert read.names == names
    check_marker_set(MarkerSet(joints={"left_shoulder": ("LSHO",)}), Path("set.toml"), read, ["left_shoulder"])
    with pytest.raises(ConfigError, match='2 markers of the recording are called "LELB", which one is meant'):
        check_marker_set(MarkerSet(joints={"left_elbow": ("LELB",)}), Path("set.toml"), read, ["left_elbow"])
    owned = Markers(tuple(f"Anna:{name}" for name in names), read.times_s, read.points)
    with pytest.raises(ConfigError, match='2 markers of the recording are called "LELB"'):
        column("LELB", Path("set.toml"), owned)


def test_two_joints_of_the_same_markers_are_refused(tmp_path):
    (tmp_path / "set.toml").write_text('[joints]\nleft_elbow = ["A", "B"]\nright_elbow = ["B", "A"]\n')
    with pytest.raises(ConfigError, match="left_elbow and right_elbow are made of the same markers: A, B"):
        load_marker_set(tmp_path / "set.toml")


CASES = {
    "01-trc-header-two-tabs/markers.trc": 20,
    "03-trc-latin1-path/markers.trc": 20,
    "05-trc-names/name_missing.trc": 20,
    "05-trc-names/same_name_twice.trc": 20,
    "06-trc-numbers/control_z.trc": 20,
    "06-trc-numbers/msvc_nan.trc": 20,
    "06-trc-numbers/qnan.trc": 20,
    "06-trc-numbers/unit_word.trc": 20,
    "07-c3d-first-frame-0/first_frame_0.c3d": 32,
    "07-c3d-first-frame-0/first_frame_0_padded.c3d": 30,
    "11-c3d-optotrak/header_says_more.c3d": 29,
    "11-c3d-optotrak/units_per_point.c3d": 32,
}


@pytest.mark.parametrize("case", CASES)
def test_files_that_went_wrong_are_read(data, case):
    read = read_markers(data(f"cases/{case}"))
    np.testing.assert_allclose(read.times_s, np.arange(CASES[case]) / 100, atol=1e-9)
    first = 1.0 if case.endswith("c3d") else 1.4
    np.testing.assert_allclose(read.points[0, 0], (0, 0, first), atol=1e-6)
    assert len(read.names) == (4 if case.endswith("c3d") else 2 if "missing" in case else 3)
    assert read.gaps == pytest.approx(1 / 60 if "nan" in case else 0)
    assert len(read.remarks) == ("missing" in case)


def test_files_that_lack_something_are_told_it(data):
    for case, message in (
        ("01-trc-header-two-tabs/value_missing.trc", "line 3 has 7 values for the 8 names in line 2: one of DataRate"),
        ("09-c3d-theia-no-points-labels/no_point_labels.c3d", "POINT:LABELS is missing: 4 points in it have no names"),
    ):
        with pytest.raises(SequenceError, match=message):
            read_markers(data(f"cases/{case}"))
