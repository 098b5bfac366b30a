"""The tables of followed points: what is written is read back, and what cannot be is refused in a line."""

from __future__ import annotations

import numpy as np
import pytest
from test_trajectories import trajectories

from tracker.foundation.errors import SequenceError
from tracker.points.following.record import motion_of
from tracker.points.following.tables import csv_header, csv_lines, read_trajectories

HEAD = "frame,time_s,point,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m"


def test_names_with_commas_and_quotes_are_read_back(tmp_path):
    made = trajectories(np.random.default_rng(0).normal(size=(5, 2, 3)))
    names = {0: "blade, left", 1: 'the "hip"'}
    lines = [csv_header(("front, low", "side")), *csv_lines(made, motion_of(made), names, slice(None))]
    (tmp_path / "trajectories.csv").write_text("".join(lines))
    read = read_trajectories(tmp_path)
    np.testing.assert_allclose(read.positions, made.positions, atol=1e-6)


@pytest.mark.parametrize("name", ["²", "20231109123456789012"])
def test_names_that_look_like_numbers_are_names(tmp_path, name):
    (tmp_path / "trajectories.csv").write_text(f"{HEAD}\n0,0,{name},1,2,3,0,0,0\n", encoding="utf-8")
    read = read_trajectories(tmp_path)
    np.testing.assert_array_equal(read.ids, [0])
    np.testing.assert_allclose(read.positions, [[[1, 2, 3]]])


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["0.7,0,1,0,0,0,0,0,0"], '"frame" is 0.7, expected a whole number'),
        (["0,0,1,0,0,0,0,0,0", "0,0,1,1,0,0,0,0,0"], "point 1 is there twice in frame 0"),
        (["0,0,1,0,0,0,0,-0.1,0"], "row 1 has a negative sigma, expected standard deviations in m"),
        (["0,0,1,0,0,0,0,0,0", "170000000,0,1,1,0,0,0,0,0"], "0 to 170000000 in a table of 2 frames"),
        (["1700000000000,0,1,1,0,0,0,0,0"], "1700000000000, expected a whole number"),
    ],
)
def test_a_table_that_cannot_be_is_refused(tmp_path, rows, message):
    (tmp_path / "trajectories.csv").write_text("\n".join([HEAD, *rows]))
    with pytest.raises(SequenceError, match=message):
        read_trajectories(tmp_path)


def test_a_column_that_is_there_twice_is_refused_where_it_is_used(tmp_path):
    row = "0,0,1,1,2,3,0,0,0"
    (tmp_path / "trajectories.csv").write_text(f"{HEAD},status,status\n{row},a,b\n")
    np.testing.assert_allclose(read_trajectories(tmp_path).positions, [[[1, 2, 3]]])
    (tmp_path / "trajectories.csv").write_text(f"{HEAD},x_m\n{row},4\n")
    with pytest.raises(SequenceError, match='2 columns are called "x_m", expected one'):
        read_trajectories(tmp_path)
