"""TRC files as programs write them: what of them is read, and what is said where something is missing."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from marker_files import (
    POINTS,
    POINTS_MM,
    same,
    trc,
    written,
)

from tracker.foundation.errors import ConfigError, SequenceError
from tracker.foundation.source_files import metres_in
from tracker.results.evaluation.marker_set import column
from tracker.results.marker_layouts import read_markers

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
        'Units in line 3 is missing: set it in the marker set, for instance unit = "mm"',
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
