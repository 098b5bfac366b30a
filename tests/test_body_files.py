"""Body model files: what they mean, and one clear line for every wrong entry."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tomli_w

from tracker.bodies.body.description import load_body, read_description, save_description
from tracker.foundation.errors import ModelError
from tracker.running.jobs.acquire import acquisition_from

LAMP: dict[str, Any] = {
    "name": "lamp",
    "stature_m": 0.6,
    "segments": [
        {"name": "foot"},
        {
            "name": "mast",
            "parent": "foot",
            "joint": [0.0, 0.0, 0.1],
            "parameters": [
                {"name": "swivel", "axis": [0, 0, 2.0], "limits_deg": [-180, 180]},
                {"name": "lift", "axis": [0, 0, 1], "limits_m": [-0.1, 0.2]},
            ],
        },
        {
            "name": "shade",
            "parent": "mast",
            "joint": [0.0, 0.0, 0.5],
            "parameters": [{"name": "nod", "axis": [0, 1, 0], "limits_deg": [-30, 90]}],
        },
    ],
    "parts": [
        {"name": "foot", "segment": "foot", "start": [0, 0, 0], "end": [0, 0, 0.05], "radii": [0.1, 0.08]},
        {"name": "shade", "segment": "shade", "start": [0, 0, 0.5], "end": [0.2, 0, 0.5], "radii": [0.06, 0.05],
         "front": [0, 0, 1], "squareness": [0.4, 0.9], "taper": [0.3, 0.3]},
    ],
    "landmarks": {
        "base": {"segment": "world", "at": [0, 0, 0]},
        "bulb": {"segment": "shade", "at": [0.1, 0, 0.5]},
    },
    "links": [["base", "bulb"]],
    "groups": {"mast": ["swivel", "lift"], "shade": ["nod"]},
}  # fmt: skip


def written(folder: Path, change: Callable[[dict[str, Any]], Any] = lambda model: None) -> Path:
    model = copy.deepcopy(LAMP)
    change(model)
    path = folder / "lamp.toml"
    path.write_text(tomli_w.dumps(model))
    return path


def test_a_model_means_what_its_file_says(tmp_path: Path) -> None:
    lamp = load_body(written(tmp_path))
    assert lamp.name == "lamp"
    assert lamp.names == ("swivel", "lift", "nod")
    assert [parameter.parent for parameter in lamp.parameters] == [-1, 0, 1]
    assert [parameter.column for parameter in lamp.parameters] == ["swivel_deg", "lift_m", "nod_deg"]
    np.testing.assert_array_equal(lamp.parameters[0].axis, (0, 0, 1))
    np.testing.assert_allclose(lamp.limits, [(-math.pi, math.pi), (-0.1, 0.2), (-math.pi / 6, math.pi / 2)])
    assert lamp.part_parameters.tolist() == [-1, 2]
    assert lamp.groups == {"mast": ("swivel", "lift"), "shade": ("nod",)}
    assert lamp.links == (("base", "bulb"),)


def test_a_part_lies_between_its_ends_with_its_radii_to_front_and_side(tmp_path: Path) -> None:
    shade = load_body(written(tmp_path)).parts[1]
    np.testing.assert_allclose(shade.shape.packed, [0.06, 0.05, 0.1, 0.4, 0.9, 0.3, 0.3])
    x, y, z, centre = shade.model_from_part[:3].T
    np.testing.assert_allclose(centre, (0.1, 0, 0.5), atol=1e-12)
    np.testing.assert_allclose(z, (1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(x, (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(np.cross(x, y), z, atol=1e-12)


def test_a_mast_that_lifts_and_a_shade_that_nods(tmp_path: Path) -> None:
    """Swivel by 90 degrees, lift by 10 cm, nod by 90 degrees: the bulb hangs 10 cm below the raised joint."""
    marks = load_body(written(tmp_path)).landmarks_in_world(np.array([math.pi / 2, 0.1, math.pi / 2]))
    np.testing.assert_allclose(marks, [(0, 0, 0), (0, 0, 0.5)], atol=1e-12)
    marks = load_body(written(tmp_path)).landmarks_in_world(np.array([math.pi / 2, 0.1, 0.0]))
    np.testing.assert_allclose(marks[1], (0, 0.1, 0.6), atol=1e-12)


def at(*steps: str | int) -> Callable[[dict[str, Any]], Any]:
    def find(model: Any) -> Any:
        for step in steps:
            model = model[step]
        return model

    return find


SWIVEL = at("segments", 1, "parameters", 0)
FAULTS: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "no segments": (lambda m: m.pop("segments"), r"segments: Field required"),
    "unknown key": (lambda m: m.update(colour="red"), r'unknown key "colour"; valid: .*segments'),
    "unknown key of a part": (
        lambda m: m["parts"][1].update(color="red"),
        r'parts\.1: unknown key "color"; valid: end, front',
    ),
    "millimetres": (lambda m: m.update(units="mm"), r"units: Input should be 'm'"),
    "two coordinates": (lambda m: m["parts"][0].update(end=[0, 1]), r"parts\.0\.end"),
    "words": (lambda m: SWIVEL(m).update(limits_deg=["low", "high"]), r"limits_deg\.0"),
    "unknown parent": (lambda m: m["segments"][2].update(parent="mst"), r'"shade": parent "mst".*did you mean "mast"'),
    "parent below": (lambda m: m["segments"][1].update(parent="shade"), r'"mast": parent "shade" is not defined above'),
    "segment twice": (lambda m: m["segments"][2].update(name="mast"), r'segment "mast" is defined twice'),
    "part twice": (lambda m: m["parts"][1].update(name=m["parts"][0]["name"]), r"part '\w+' is defined twice"),
    "parameter twice": (lambda m: SWIVEL(m).update(name="nod"), r"'nod' is defined twice"),
    "no limits": (lambda m: SWIVEL(m).pop("limits_deg"), r'"swivel": give either limits_m .* or limits_deg'),
    "both limits": (lambda m: SWIVEL(m).update(limits_m=[0, 1]), r'"swivel": give either'),
    "limits out of order": (lambda m: SWIVEL(m).update(limits_deg=[20, 10]), r'"swivel".*limits out of order'),
    "nothing usual": (lambda m: SWIVEL(m).update(usual_deg=0), r"usual_deg: Input should be greater than 0"),
    "a usual translation": (
        lambda m: (SWIVEL(m).pop("limits_deg"), SWIVEL(m).update(limits_m=[0, 1], usual_deg=5)),
        r'"swivel": usual_deg is for rotations',
    ),
    "no axis": (lambda m: SWIVEL(m).update(axis=[0, 0, 0]), r'"swivel": axis of length 0'),
    "part of no segment": (lambda m: m["parts"][1].update(segment="shde"), r'"shade": no segment "shde".*"shade"'),
    "part of no length": (lambda m: m["parts"][0].update(end=[0, 0, 0]), r'"foot": start and end are the same'),
    "front along the part": (lambda m: m["parts"][1].update(front=[2, 0, 0]), r'"shade": `front` is parallel'),
    "negative radius": (
        lambda m: m["parts"][0].update(radii=[-0.1, 0.1]),
        r'part "foot": superquadric: .*expected positive',
    ),
    "squareness": (lambda m: m["parts"][0].update(squareness=[2, 1]), r'part "foot": .*squareness.*expected 0\.1 to 1'),
    "landmark of no segment": (lambda m: m["landmarks"]["bulb"].update(segment="lamp"), r'"bulb": no segment "lamp"'),
    "no number": (lambda m: m["segments"][2].update(joint=[math.nan, 0, 0]), r"segments\.2\.joint\.0: .*finite number"),
    "no end": (
        lambda m: m["landmarks"]["bulb"].update(at=[0, 0, math.inf]),
        r"landmarks\.bulb\.at\.2: .*finite number",
    ),
    "no plane": (lambda m: m.update(across=[0, 0, 0]), r"across: the normal .* has no length"),
    "no parts": (lambda m: m.update(parts=[], landmarks={}, links=[]), r"parts: none, expected at least one"),
    "an empty group": (lambda m: m["groups"].update(bulbs=[]), r'group "bulbs": expected one parameter or more'),
    "a parameter twice in a group": (lambda m: m["groups"]["mast"].append("lift"), r'group "mast": .* each once'),
    "link to no landmark": (lambda m: m.update(links=[["base", "blub"]]), r'no landmark "blub".*did you mean "bulb"'),
    "group of no parameter": (lambda m: m["groups"].update(mast=["lft"]), r'"mast": no parameter "lft".*"lift"'),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_entry_is_named(tmp_path: Path, fault: str) -> None:
    change, reason = FAULTS[fault]
    path = written(tmp_path, change)
    with pytest.raises(ModelError, match=reason) as refusal:
        load_body(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert "\n" not in str(refusal.value)


def test_limits_may_be_infinite(tmp_path: Path) -> None:
    body = load_body(written(tmp_path, lambda m: m["segments"][1]["parameters"][1].update(limits_m=[-math.inf, 0.2])))
    np.testing.assert_array_equal(body.limits[1], (-math.inf, 0.2))


@pytest.mark.parametrize("fault", ["unknown parent", "part of no segment", "negative radius"])
@pytest.mark.parametrize("kind", ["pairs", "moments", "scan"])
def test_a_model_is_checked_before_it_is_fitted(tmp_path: Path, fault: str, kind: str) -> None:
    change, reason = FAULTS[fault]
    mask = np.zeros((200, 200), np.uint8)
    mask[20:180, 80:120] = 255
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    picture = {"mask": "mask.png", "px_per_m": 100.0}
    asked: dict[str, Any] = {
        "pairs": [{"front": picture, "side": picture}],
        "moments": [{"cloud": "none.ply"}],
        "scan": {"surface": "none.ply", "weights": "none.npz", "joints": "none.json"},
    }
    told = {} if kind == "scan" else {"stature_m": 0.6}
    table = {"model": str(written(tmp_path, change)), kind: asked[kind], **told}
    with pytest.raises(ModelError, match=rf"lamp\.toml: .*{reason}"):
        acquisition_from(table, "lamp.toml", tmp_path, "lamp").open()


def test_blanks_in_names_survive(tmp_path: Path) -> None:
    change = {
        "base, of it": {"segment": "foot", "at": [0, 0, 0]},
        "a  bulb,": {"segment": "shade", "at": [0.1, 0, 0.5]},
    }
    given = read_description(written(tmp_path, lambda m: m.update(landmarks=change, links=[[*change]])))
    save_description(given, tmp_path / "again.toml", decimals=None)
    assert read_description(tmp_path / "again.toml") == given


def test_files_that_are_not_there_or_not_toml(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"none\.toml: cannot read the body model: No such file"):
        load_body(tmp_path / "none.toml")
    (tmp_path / "broken.toml").write_text("name = lamp")
    with pytest.raises(ModelError, match=r"broken\.toml: not a TOML file"):
        load_body(tmp_path / "broken.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\x00\xfe")
    with pytest.raises(ModelError, match=r"binary\.toml: not a text file in UTF-8"):
        load_body(tmp_path / "binary.toml")
