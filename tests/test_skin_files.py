"""Skins in model files: PLY and OBJ, weights and labels, faults, and that they travel with the model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from tracker.bodies.body.description import load_body, read_description, save_description
from tracker.bodies.skin import Rigging, ScannedSurface, Skin, read_rigging, read_surface, write_rigging, write_surface
from tracker.foundation.errors import ModelError

# Two parts one above the other, and a strip of surface over both.
POINTS = np.array([[x, 0.1 * y, 0.2 * z] for z in range(5) for y in (-1, 1) for x in (0.0,)])
FACES = np.array([[2 * k + a, 2 * k + b, 2 * k + c] for k in range(4) for a, b, c in ((0, 1, 2), (1, 3, 2))])
BODY = {
    "name": "post",
    "stature_m": 0.8,
    "segments": [
        {"name": "foot", "parameters": [{"name": "x", "axis": [1, 0, 0], "limits_m": [-1, 1]}]},
        {
            "name": "top",
            "parent": "foot",
            "joint": [0, 0, 0.4],
            "parameters": [{"name": "bend", "axis": [0, 1, 0], "limits_deg": [-90, 90]}],
        },
    ],
    "parts": [
        {"name": "lower", "segment": "foot", "start": [0, 0, 0], "end": [0, 0, 0.4], "radii": [0.1, 0.1]},
        {"name": "upper", "segment": "top", "start": [0, 0, 0.4], "end": [0, 0, 0.8], "radii": [0.1, 0.1]},
    ],
}
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in POINTS.tolist()) + "".join(
    f"{'g lower' if k == 0 else 'g top' if k == 4 else ''}\nf {a + 1}/1 {b + 1} {c + 1}\n"
    for k, (a, b, c) in enumerate(FACES.tolist())
)


def written(folder: Path, skin: dict[str, object], **files: object) -> Path:
    """A model with that section, an OBJ file with groups, a PLY file and weights."""
    folder.mkdir(exist_ok=True)
    (folder / "post.obj").write_text(OBJ, encoding="utf-8")
    write_surface(ScannedSurface(POINTS, FACES), folder / "post.ply")
    share = np.linspace(0, 1, len(POINTS))
    write_rigging(Rigging(("lower", "upper"), np.stack([1 - share, share], axis=1)), folder / "post.npz")
    (folder / "post.toml").write_text(tomli_w.dumps(BODY | {"skin": skin}), encoding="utf-8")
    return folder / "post.toml"


def skin_of(path: Path, scale: float = 1.0) -> Skin:
    skin = load_body(path, scale).skin
    assert skin is not None
    return skin


def test_groups_and_labels_are_rigid_and_weights_are_blended(tmp_path: Path) -> None:
    grouped = skin_of(written(tmp_path, {"surface": "post.obj"}))
    # a group may be called after the only part of a segment; its vertices on the seam belong to the first group
    assert grouped.labels.tolist() == [0] * 6 + [1] * 4
    np.testing.assert_array_equal(grouped.points, POINTS)
    blended = skin_of(written(tmp_path, {"surface": "post.ply", "weights": "post.npz"}))
    np.testing.assert_allclose(blended.weights[:, 1], np.linspace(0, 1, len(POINTS)), atol=1e-6)
    np.testing.assert_allclose(blended.points, POINTS, atol=1e-7)
    rigid = skin_of(written(tmp_path, {"surface": "post.ply", "weights": "post.npz", "smooth": False}))
    assert set(rigid.weights.ravel().tolist()) == {0.0, 1.0}


def test_labels_may_stand_in_place_of_weights(tmp_path: Path) -> None:
    np.savez(tmp_path / "labels.npz", segments=np.array(["a", "b"]), label=np.array([0, 1, 1]))
    found = read_rigging(tmp_path / "labels.npz", 3)
    assert found.weights.tolist() == [[1, 0], [0, 1], [0, 1]]


def test_a_bend_bends_the_skin_about_the_joint(tmp_path: Path) -> None:
    body = load_body(written(tmp_path, {"surface": "post.obj"}))
    assert body.skin is not None
    moved = body.skin.world_points(body.world_from_part(np.array([0.5, np.pi / 2])))
    np.testing.assert_allclose(moved[:6], POINTS[:6] + np.array([0.5, 0, 0]), atol=1e-12)
    np.testing.assert_allclose(moved[-1], (0.9, 0.1, 0.4), atol=1e-12)


def test_a_skin_measured_in_a_pose_looks_so_there(tmp_path: Path) -> None:
    body = load_body(written(tmp_path, {"surface": "post.obj", "pose_deg": {"bend": 30.0}}))
    assert body.skin is not None
    moved = body.skin.world_points(body.world_from_part(np.array([0.0, np.pi / 6])))
    np.testing.assert_allclose(moved, POINTS, atol=1e-12)


def test_a_model_scales_and_is_saved_with_its_skin(tmp_path: Path) -> None:
    path = written(tmp_path / "one", {"surface": "post.ply", "weights": "post.npz", "pose_deg": {"bend": 10.0}})
    np.testing.assert_allclose(skin_of(path, 2.0).points, 2 * POINTS, atol=1e-6)
    save_description(read_description(path).scaled(2.0), tmp_path / "other" / "long.toml", decimals=None)
    for file in (tmp_path / "one").iterdir():
        file.unlink()
    assert sorted(file.name for file in (tmp_path / "other").iterdir()) == [
        "long.toml",
        "long_skin.npz",
        "long_skin.ply",
    ]
    np.testing.assert_allclose(skin_of(tmp_path / "other" / "long.toml").points, 2 * POINTS, atol=1e-6)


def test_normals_point_outwards_and_seams_are_no_borders() -> None:
    """Two patches that share an edge without sharing vertices."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    skin = Skin(points, faces, np.ones((6, 1)), np.eye(4)[None])
    np.testing.assert_allclose(skin.normals, np.tile([0, 0, 1], (6, 1)), atol=1e-7)
    assert len(skin.borders) == 4


@pytest.mark.parametrize(
    ("skin", "said"),
    [
        ({"surface": "none.ply"}, "none.ply: cannot read the surface: No such file"),
        ({"surface": "post.stl"}, "expected a surface in a .ply or .obj file"),
        ({"surface": "post.ply"}, 'has no groups: name the parts in lines "g PART", or give `weights`'),
        ({"surface": "post.ply", "weights": "none.npz"}, "none.npz: cannot read the weights: No such file"),
        ({"surface": "post.ply", "weights": "post.obj"}, "post.obj: not an archive of numpy"),
        ({"surface": "post.obj", "pose_deg": {"bent": 3.0}}, 'no parameter "bent"; did you mean "bend"'),
        ({"surface": "post.obj", "pose_deg": {"x": 3.0}}, '"x" is a translation, expected angles'),
        ({"surface": "post.obj", "smoth": True}, 'unknown key "smoth"; did you mean "smooth"'),
        ({"surface": "post.obj", "scale": 0.0}, "skin.scale: Input should be greater than 0"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, skin: dict[str, object], said: str) -> None:
    with pytest.raises(ModelError) as found:
        load_body(written(tmp_path, skin))
    assert said in str(found.value)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.ply", b"solid", "not a PLY file"),
        ("a.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\n", "damaged PLY file"),
        ("a.obj", b"v 0 0\nf 1 1 1\n", "a vertex without three coordinates"),
        ("a.obj", b"v 0 0 x\n", "line 1: could not convert"),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n", "a triangle of vertices that do not exist"),
        ("a.obj", b"v 0 0 0\n", "1 vertices and 0 triangles"),
        (
            "a.obj",
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\nv 1 1 0\n",
            "line 4: vertices [0, 1, 2], expected 1 and on",
        ),
        ("a.obj", b"v 0 0 0\nf 99999999999999999999 1 1\n", "line 2: vertices [99999999999999999999, 1, 1], expected"),
        ("a.obj", b"\xff\xfe", "not a text file"),
    ],
)
def test_damaged_surfaces_are_one_sentence(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ModelError) as found:
        read_surface(tmp_path / name)
    assert said in str(found.value)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"label": np.array(["a", "b", "a"])}, '"label" are of type <U1, expected numbers'),
        ({"weights": np.array([["1", "x"]] * 3)}, '"weights" are of type <U1, expected numbers'),
        ({"weights": np.zeros(3, dtype=[("a", "f4"), ("b", "f4")])}, "expected numbers"),
        ({"label": np.array([0.5, 1.2, 0.9])}, '"label" has values that are no whole numbers'),
        ({"label": np.array([0, np.nan, 1])}, '"label" has values that are no whole numbers'),
        ({"label": np.array([0, 2, 1])}, "labels 0 to 2, expected 0 to 1"),
        (None, "not an archive of numpy"),
    ],
)
def test_labels_and_weights_that_are_no_numbers_are_one_sentence(
    tmp_path: Path, content: dict[str, Any] | None, said: str
) -> None:
    with (tmp_path / "post.npz").open("wb") as file:
        if content is None:
            np.save(file, np.zeros(3))
        else:
            np.savez(file, segments=np.array(["a", "b"]), **content)
    with pytest.raises(ModelError) as found:
        read_rigging(tmp_path / "post.npz", 3)
    assert said in str(found.value)
    assert "\n" not in str(found.value)


def test_weights_of_another_surface_are_refused(tmp_path: Path) -> None:
    write_rigging(Rigging(("lower", "head"), np.ones((10, 2))), tmp_path / "other.npz")
    with pytest.raises(ModelError, match=r"weights \(10, 2\), expected \(11, 2\)"):
        read_rigging(tmp_path / "other.npz", 11)
    path = written(tmp_path, {"surface": "post.ply", "weights": "other.npz"})
    with pytest.raises(ModelError, match='skin: no part "head"; '):
        load_body(path)
    np.savez(tmp_path / "other.npz", weights=np.ones((10, 2)))
    with pytest.raises(ModelError, match='expected "segments", and "weights" or "label"; found weights'):
        load_body(path)
