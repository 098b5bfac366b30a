"""Units and scale of calibrations that are told, guesses where none is, and numbers that a camera hardly has."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rig_samples import NORTH, assert_equal, entries, sample_rig, tables, written
from typer.testing import CliRunner

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig, read_rig, save_rig
from tracker.foundation.configuration.components import available, find
from tracker.foundation.errors import CalibrationError
from tracker.running.cli import app

READ_ONLY = ("freemocap", "middlebury", "opencap", "panoptic", "vicon")
WRITTEN = [use for use in available("rig_layouts") if use not in READ_ONLY]


def stretched(rig: Rig, factor: float) -> Rig:
    """The rig in a world whose lengths are so many times longer."""
    motions = [np.array(camera.camera_from_world) for camera in rig.cameras]
    for motion in motions:
        motion[:3, 3] *= factor
    return Rig(tuple(replace(c, camera_from_world=m) for c, m in zip(rig.cameras, motions, strict=True)))


@pytest.mark.parametrize("use", WRITTEN)
@pytest.mark.parametrize(("units", "scale", "factor"), [("mm", 1.0, 0.001), ("cm", 2.0, 0.02), ("m", 0.5, 0.5)])
def test_every_layout_can_be_told_its_units_and_its_scale(
    tmp_path: Path, use: str, units: str, scale: float, factor: float
) -> None:
    endings = find("rig_layouts", use).endings
    path = tmp_path / f"rig{endings[0] if endings else ''}"
    rig = sample_rig("A", "B")
    # QTM's files are in mm: a thousandth has the same numbers as metres elsewhere
    save_rig(stretched(rig, 0.001) if use == "qualisys" else rig, path, use)
    found = read_rig(path, units=units, scale=scale)
    assert found.unit == units
    assert_equal(found.rig, stretched(rig, factor), 1e-9)


def test_rig_convert_and_rig_check_are_told_units(tmp_path: Path) -> None:
    save_rig(stretched(sample_rig("A", "B"), 1000), tmp_path / "mm.toml")
    source, target = str(tmp_path / "mm.toml"), str(tmp_path / "rig.toml")
    told = CliRunner().invoke(app, ["rig", "convert", source, target, "--units", "mm"])
    assert told.exit_code == 0, told.output
    assert_equal(load_rig(tmp_path / "rig.toml"), sample_rig("A", "B"), 1e-9)
    told = CliRunner().invoke(app, ["rig", "convert", source, target, "--scale", "0.001"])
    assert told.exit_code == 0, told.output
    assert_equal(load_rig(tmp_path / "rig.toml"), sample_rig("A", "B"), 1e-9)
    told = CliRunner().invoke(app, ["rig", "check", source, "--units", "mm"])
    assert told.exit_code == 0, told.output
    assert "layout anipose, lengths in mm" in told.output
    assert "1.500" in told.output


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1000, r"1500 m apart.*in millimetres they are 1\.5 m apart or in centimetres they are 15 m.*--units mm`"),
        (400, r"600 m apart.*in centimetres they are 6 m apart or in millimetres they are 0\.6 m apart.*--units cm`"),
        (150, r"225 m apart.*in centimetres they are 2\.2 m apart: if the file is in centimetres, .*--units cm`"),
        (1e9, r"if its lengths have another unit, .*--scale METRES`"),
    ],
)
def test_the_unit_that_makes_a_room_is_named(tmp_path: Path, factor: float, words: str) -> None:
    save_rig(stretched(sample_rig("A", "B"), factor), tmp_path / "rig.toml")
    with pytest.raises(CalibrationError, match=words) as refusal:
        read_rig(tmp_path / "rig.toml")
    assert str(tmp_path / "rig.toml") in str(refusal.value)


def test_metres_taken_for_millimetres_are_named(tmp_path: Path) -> None:
    """Not told as two cameras at one place, nor read as a rig of millimetres."""
    save_rig(stretched(sample_rig("A", "B", "C"), 0.001), tmp_path / "rig.qca.txt")
    words = r"two cameras are 3\.0 mm apart.*in metres they are 3 m apart.*--units m`"
    with pytest.raises(CalibrationError, match=words):
        read_rig(tmp_path / "rig.qca.txt")
    assert_equal(read_rig(tmp_path / "rig.qca.txt", units="m").rig, sample_rig("A", "B", "C"), 1e-9)


def test_a_large_room_is_read_and_told(tmp_path: Path) -> None:
    save_rig(stretched(sample_rig("A", "B"), 100), tmp_path / "rig.toml")
    found = read_rig(tmp_path / "rig.toml")
    assert any(re.search(r"150 m apart, .*--units cm", line) for line in found.remarks)
    assert not read_rig(tmp_path / "rig.toml", units="cm").remarks


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"units": "parsec"}, 'units = "parsec": valid: cm, dm, ft, in, m, mm'),
        ({"scale": 0.0}, "scale = 0: expected a factor above 0"),
        ({"scale": float("nan")}, "scale = nan: expected a factor"),
    ],
)
def test_units_that_are_none(tmp_path: Path, told: dict[str, Any], words: str) -> None:
    save_rig(sample_rig("A"), tmp_path / "rig.toml")
    with pytest.raises(CalibrationError, match=words):
        read_rig(tmp_path / "rig.toml", **told)


def test_units_may_be_written_out(tmp_path: Path) -> None:
    content = tables() | {"metadata": {"units": "Millimeters"}}
    for key in ("cam_1", "cam_2"):
        content[key]["translation"] = [1000 * value for value in content[key]["translation"]]
    assert read_rig(written(tmp_path, content, ".toml")).unit == "mm"


ROUNDED = np.array([[0.3, 0.0, 0.95], [-0.1, 0.99, 0.03], [-0.94, -0.11, 0.3]])


def test_a_rotation_of_few_decimals_is_read_and_told(tmp_path: Path) -> None:
    content = entries()
    content[1]["R"] = ROUNDED.tolist()
    found = read_rig(written(tmp_path, {"cameras": content}, ".json"))
    np.testing.assert_allclose(found.rig.cameras[1].camera_from_world[:3, :3], ROUNDED, atol=0.01)
    assert [line for line in found.remarks if '"SIDE"' in line and "degrees" in line and "more decimals" in line]
    content[1]["R"] = (ROUNDED + np.array([[0, 0.012345, 0], [0, 0, 0], [0, 0, 0]])).tolist()
    with pytest.raises(CalibrationError, match="not a rotation"):
        read_rig(written(tmp_path, {"cameras": content}, ".json"))


def put(**values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda table: table.update(values)


SUSPICIOUS = {
    "width and height exchanged": (put(size=[720, 1280]), "width and height are exchanged"),
    "size as text": (put(size=["1280", "720"]), "size: expected numbers"),
    "focal length in mm": (put(matrix=[[8, 0, 640], [0, 8, 360], [0, 0, 1]]), "focal length 8, 8 px .*hundreds"),
    "matrix in widths": (put(matrix=[[0.7, 0, 0.5], [0, 0.7, 0.5], [0, 0, 1]]), "focal length 0.7"),
    "angles in degrees": (put(rotation=[90.0, 0.0, 45.0]), "Rodrigues vector of length 101 rad .*degrees"),
    "a quaternion": (put(rotation=[0.0, 0.0, 0.0, 1.0]), "rotation 4 "),
    "fisheye as text": (put(fisheye="false"), "fisheye: 'false' found, expected true or false"),
    "no distortion": (put(distortions=[]), "distortions: 0 numbers found"),
    "a lens beyond any": (put(distortions=[1e29, 0, 0, 0]), r"distortion .*1e\+29.* found, expected numbers below"),
    "mirrored": (put(rotation=(NORTH * [-1, 1, 1]).tolist()), "not a rotation"),
}


@pytest.mark.parametrize("fault", SUSPICIOUS)
def test_numbers_that_a_camera_hardly_has(tmp_path: Path, fault: str) -> None:
    change, reason = SUSPICIOUS[fault]
    content = tables()
    change(content["cam_2"])
    with pytest.raises(CalibrationError, match=f'"south".*{reason}'):
        load_rig(written(tmp_path, content, ".toml"))


def test_a_principal_point_counted_from_the_middle_is_told(tmp_path: Path) -> None:
    content = tables()
    content["cam_2"]["matrix"] = [[900.0, 0.0, 3.1], [0.0, 905.0, -2.4], [0.0, 0.0, 1.0]]
    found = read_rig(written(tmp_path, content, ".toml"))
    assert [line for line in found.remarks if '"south": its principal point (3, -2) px lies far from' in line]


def test_names_that_differ_by_capital_letters_are_told(tmp_path: Path) -> None:
    save_rig(sample_rig("Left", "left", "right"), tmp_path / "rig.toml")
    assert any('alone: "Left", "left"' in line for line in read_rig(tmp_path / "rig.toml").remarks)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("rig.json", json.dumps({"cameras": {"A": 1, "B": 2}}).replace("B", "A")),
        ("rig.json", json.dumps({"cameras": [{**e, "name": "A", "R": None, "t": None} for e in entries()]})),
    ],
)
def test_names_that_repeat(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(CalibrationError, match='called "A", expected different names'):
        load_rig(tmp_path / name)


LENSES = {
    "k3": ((-0.2, 0.05, 0.001, -0.002, 0.05), "pose2sim", 4, 1.5),
    "rational": ((0.1, 0, 0, 0, 0.1, 0.2, 0, 0), "pose2sim", 4, 1.5),
    "rational to five": ((0.1, 0, 0, 0, 0.1, 0.2, 0, 0), "qualisys", 5, 0.5),
}


@pytest.mark.parametrize("lens", LENSES)
def test_lenses_are_fitted_to_fewer_terms_and_the_cost_is_told(tmp_path: Path, lens: str) -> None:
    numbers, layout, terms, most = LENSES[lens]
    rig = sample_rig("A", "B", lens=numbers)
    path = tmp_path / ("Calib.toml" if layout == "pose2sim" else "rig.xml")
    told = save_rig(rig, path, layout)
    assert [line[:10] for line in told] == ['camera "A"', 'camera "B"']
    rms, largest = (float(word) for word in re.findall(r"([\d.e-]+) px", told[0]))
    assert 0 < rms < largest < most
    for before, after in zip(rig.cameras, load_rig(path).cameras, strict=True):
        assert not after.distortion[terms:].any()
        columns, rows = np.meshgrid(np.linspace(0, 1279, 41), np.linspace(0, 719, 23))
        pixels = np.column_stack([columns.ravel(), rows.ravel()])
        points = before.centre + 3 * before.rays(pixels)
        apart = np.linalg.norm(after.project(points) - pixels, axis=1)
        assert apart.max() == pytest.approx(largest, rel=0.1)
        assert np.sqrt((apart**2).mean()) == pytest.approx(rms, rel=0.1)


def test_what_an_export_costs_is_on_the_terminal(tmp_path: Path) -> None:
    save_rig(sample_rig("A", lens=(-0.2, 0.05, 0, 0, 0.05)), tmp_path / "rig.toml")
    command = ["rig", "convert", str(tmp_path / "rig.toml"), str(tmp_path / "Calib.toml"), "--layout", "pose2sim"]
    told = CliRunner().invoke(app, command)
    assert told.exit_code == 0, told.output
    assert re.search(r'look: camera "A": .* k1 k2 p1 p2 alone.* px off', told.output)
    assert save_rig(sample_rig("A"), tmp_path / "Calib.toml", "pose2sim") == ()
