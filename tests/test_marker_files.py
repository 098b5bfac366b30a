"""Marker files as programs write them: what of them is read, and what is said where something is missing."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from marker_files import (
    POINTS,
    POINTS_MM,
    C3d,
    point_parameters,
    points_bytes,
    same,
    trc,
    written,
)

from tracker.foundation.errors import ConfigError, SequenceError
from tracker.results.evaluation.marker_set import MarkerSet, check_marker_set, column, load_marker_set
from tracker.results.marker_layouts import read_markers
from tracker.results.markers import Markers


@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("a.trc", "NO_OF_FRAMES\t20\nNO_OF_CAMERAS\t8\n", "a TSV export of Qualisys Track Manager"),
        ("a.tsv", "FILE_VERSION\t2.0.0\nNO_OF_FRAMES\t20\n", "a TSV export of Qualisys Track Manager"),
        ("a.csv", "Format Version,1.23,Take Name,a\n", "a CSV export of OptiTrack Motive"),
        ("a.csv", "Trajectories\n100\n,,Anna:LSHO\n", "a CSV export of Vicon Nexus"),
        ("a.mot", "Coordinates\nversion=1\nnRows=20\nendheader\n", "a table of OpenSim (.mot, .sto)"),
        ("a.bvh", "HIERARCHY\nROOT Hips\n", "a BVH file"),
        ("a.c3d", "something else", "not a file of markers"),
        ("a.trc", "", "not a file of markers"),
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
    with pytest.raises(SequenceError, match=r"markers lie .* apart, expected 0\.03 to 100: the unit is wrong"):
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
    with pytest.raises(ConfigError, match='2 markers of the recording are called "LELB": rename'):
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
