"""Acquisition from scans: a bundled model, posed, meshed and turned, is a scan whose answers are known."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from tests.test_skins import meshed
from tracker.acquisition.scan import ScanFiles, read_scan
from tracker.acquisition.scan_rigging import Fitted, fit_superquadric, rigged
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body, read_description
from tracker.bodies.segments import Mirror
from tracker.bodies.skin import Rigging, ScannedSurface, read_surface, write_rigging, write_surface
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError, ModelError
from tracker.foundation.geometry.superquadrics import surface
from tracker.foundation.resources import model_path
from tracker.running.cli import app

POSE_DEG = {"arm_abduction": 35.0, "arm_elevation": 8.0, "arm_twist": -6.0, "arm_extension": 12.0}
CENTRES = {
    "left_upper_arm": "left_shoulder",
    "left_forearm": "left_elbow",
    "left_hand": "left_wrist",
    "left_thigh": "left_hip",
    "left_shin": "left_knee",
    "left_foot": "left_ankle",
}
WORLD_FROM_MODEL = Rotation.from_euler("z", -70, degrees=True).as_matrix()


@dataclass(frozen=True)
class Scanned:
    """A scan on disk, and the body that it is of."""

    folder: Path
    body: BodyModel
    q: Array

    @property
    def files(self) -> ScanFiles:
        return ScanFiles(
            surface=self.folder / "scan.ply", weights=self.folder / "scan.npz", joints=self.folder / "joints.json"
        )


def scanned(folder: Path, model: str, pose_deg: dict[str, float]) -> Scanned:
    """The body of a model at 1.68 m, posed and turned about the vertical; its collar bones are of the chest."""
    body = meshed(load_body(model_path(model), 1.68 / 1.80), 13, 18)
    q = np.zeros(body.dof)
    for name, degrees in pose_deg.items():
        q[body.columns(name)] = np.radians(degrees)
    assert body.skin is not None
    points = body.skin.world_points(body.world_from_part(q)) @ WORLD_FROM_MODEL.T + (0.4, -0.2, 0.85)
    write_surface(ScannedSurface(points, body.skin.faces), folder / "scan.ply")
    names = [part.name for part in body.parts]
    owner = ["chest" if name in ("neck", "left_shoulder", "right_shoulder") else name for name in names]
    segments = tuple(dict.fromkeys(owner))
    weights = np.zeros((len(points), len(segments)))
    for k, own in enumerate(owner):
        weights[:, segments.index(own)] += body.skin.weights[:, k]
    write_rigging(Rigging(segments, weights), folder / "scan.npz")
    marks = dict(zip(body.landmark_names, body.landmarks_in_world(q), strict=True))
    joints = [joint for segment in segments if (joint := _joint(body, q, segment, marks))]
    (folder / "joints.json").write_text(json.dumps({"joints": joints, "joint_centres_m": {}}), encoding="utf-8")
    return Scanned(folder, body, q)


def _joint(body: BodyModel, q: Array, segment: str, marks: dict[str, Array]) -> dict[str, object] | None:
    mirror = body.mirror
    at = {**CENTRES, **{mirror.of(one): mirror.of(other) for one, other in CENTRES.items()}}
    at |= {"chest": "spine", "head": "neck"}
    if segment not in at:
        return None
    parents = {"chest": "pelvis", "head": "chest", "hand": "forearm", "forearm": "upper_arm", "upper_arm": "chest"}
    parents |= {"thigh": "pelvis", "shin": "thigh", "foot": "shin"}
    side, _, kind = segment.partition("_")
    parent = parents[kind or segment]
    parent = parent if parent in ("pelvis", "chest") else f"{side}_{parent}"
    axes = {}
    own = next((one for one in body.segments if one.name == segment), None)
    for column in own.parameters if own is not None else ():
        name = {"arm_extension": "flexion", "leg_extension": "flexion"}.get(
            body.names[column].partition("_")[2], body.names[column].rpartition("_")[2]
        )
        axes[name] = (WORLD_FROM_MODEL @ body.twists(q)[column, 3:]).tolist()
    centre = WORLD_FROM_MODEL @ marks[at[segment]] + (0.4, -0.2, 0.85)
    return {"name": at[segment], "parent": parent, "child": segment, "centre_m": centre.tolist(), "axes": axes}


@pytest.mark.parametrize(
    ("model", "pose_deg"),
    [
        ("upper21", {**POSE_DEG, "arm_pronation": -60.0}),
        ("upper32", {**POSE_DEG, "arm_pronation": -60.0}),
        ("human", {**POSE_DEG, "leg_abduction": 7.0}),
    ],
)
def test_a_scan_of_a_known_body_gives_that_body(tmp_path: Path, model: str, pose_deg: dict[str, float]) -> None:
    scan = scanned(tmp_path, model, pose_deg)
    general = read_description(model_path(model))
    found = rigged(general, read_scan(scan.files, Mirror()), "somebody")
    skin = found.description.skin
    assert skin is not None
    body = found.description.model_copy(update={"skin": None}).build()
    assert body.names == scan.body.names
    for name, degrees in pose_deg.items():
        for own in body.mirror.meant(name, body.names):
            assert skin.pose_deg.get(own, 0.0) == pytest.approx(degrees, abs=0.3)
    for name in ("left_elbow", "right_wrist", "left_shoulder", "neck", "right_hip", "left_knee", "right_ankle"):
        mark = body.landmark_names.index(name)
        np.testing.assert_allclose(body.landmarks[mark].point, scan.body.landmarks[mark].point, atol=1.5e-3)
    for one, other in zip(body.parameters, scan.body.parameters, strict=True):
        np.testing.assert_allclose(one.axis, other.axis, atol=0.01)
    # the part of a segment that was one superquadric is that again, where the scan was
    q = np.radians([skin.pose_deg.get(name, 0.0) for name in body.names])
    for name in ("left_forearm", "right_thigh", "head"):
        (mine,) = (k for k, part in enumerate(body.parts) if part.name == name)
        (known,) = (k for k, part in enumerate(scan.body.parts) if part.name == name)
        np.testing.assert_allclose(body.shapes[mine, :3], scan.body.shapes[known, :3], rtol=0.06)
        placed, true = body.world_from_part(q)[mine], scan.body.world_from_part(scan.q)[known]
        np.testing.assert_allclose(placed[:3, 3], true[:3, 3], atol=8e-3)


def test_limits_are_widened_where_the_scan_exceeds_them_and_nowhere_else(tmp_path: Path) -> None:
    """Whoever stands with an elbow bent by 3 degrees can't for that bend it backwards by 17."""
    pose_deg = {**POSE_DEG, "arm_extension": 3.0, "arm_pronation": -95.0}
    general = load_body(model_path("upper32"))
    scan = read_scan(scanned(tmp_path, "upper32", pose_deg).files, Mirror())
    found = rigged(read_description(model_path("upper32")), scan, "rita")
    body = found.description.model_copy(update={"skin": None}).build()
    usual, now = np.degrees(general.limits), np.degrees(body.limits)
    exceeded = [body.index(f"{side}_arm_pronation") for side in ("left", "right")]
    others = np.setdiff1d(np.arange(body.dof), exceeded)
    np.testing.assert_allclose(now[others], usual[others], atol=1e-6)
    np.testing.assert_allclose(now[exceeded, 1], usual[exceeded, 1])
    np.testing.assert_allclose(now[exceeded, 0], -115.0, atol=0.5)


def test_where_a_scan_is_finer_turns_no_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Faces have most vertices of a head: a fit began 32 degrees off, and ended through the nose."""
    scan = read_scan(scanned(tmp_path, "human", POSE_DEG | {"leg_abduction": 7.0}).files, Mirror())
    head = scan.rigging.segments.index("head")
    own = np.flatnonzero(scan.rigging.weights.argmax(axis=1) == head)
    face = own[scan.surface.points[own, 1] < np.quantile(scan.surface.points[own, 1], 0.2)].repeat(8)
    finer = replace(
        scan,
        surface=replace(scan.surface, points=np.concatenate([scan.surface.points, scan.surface.points[face]])),
        rigging=replace(scan.rigging, weights=np.concatenate([scan.rigging.weights, scan.rigging.weights[face]])),
    )
    axes: list[Array] = []

    def fitted(points: Array, weights: Array, axis: Array, front: Array) -> Fitted:
        axes.append(axis / np.linalg.norm(axis))
        return fit_superquadric(points, weights, axis, front)

    monkeypatch.setattr("tracker.acquisition.scan_rigging.fit_superquadric", fitted)
    for one in (scan, finer):
        rigged(read_description(model_path("human")), one, "rita")
    one, other = axes[head], axes[len(axes) // 2 + head]
    assert np.degrees(np.arccos(min(one @ other, 1.0))) < 1


def test_a_superquadric_is_found_in_its_own_points() -> None:
    shape = np.array([0.06, 0.04, 0.15, 0.5, 0.8, -0.2, 0.1])
    eta, omega = np.meshgrid(np.linspace(-1.5, 1.5, 25), np.linspace(-np.pi, np.pi, 33))
    points = surface(shape, eta, omega)[0].reshape(-1, 3)
    tilt = Rotation.from_rotvec([0.1, -0.05, 0.02]).as_matrix()
    moved = points @ tilt.T + (0.3, 0.1, -0.2)
    found = fit_superquadric(moved, np.ones(len(moved)), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))
    assert found.rms_m < 0.001
    np.testing.assert_allclose(found.shape[:3], shape[:3], rtol=0.03)
    np.testing.assert_allclose(found.placement[:3, 3], (0.3, 0.1, -0.2), atol=2e-3)


def test_the_command_writes_a_model_that_carries_its_skin(tmp_path: Path) -> None:
    scan = scanned(tmp_path, "upper21", POSE_DEG)
    files = {name: str(getattr(scan.files, name)) for name in ("surface", "weights", "joints")}
    table = {"name": "rita", "model": "upper21", "scan": files}
    (tmp_path / "scan.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
    output = tmp_path / "models" / "rita.toml"
    done = CliRunner().invoke(app, ["acquire", str(tmp_path / "scan.toml"), "--output", str(output)])
    assert done.exit_code == 0, done.output
    assert sorted(file.name for file in output.parent.iterdir()) == [
        "rita.json",
        "rita.png",
        "rita.toml",
        "rita_skin.npz",
        "rita_skin.ply",
    ]
    body = load_body(output)
    assert body.skin is not None
    q = np.radians([read_description(output).skin.pose_deg.get(name, 0.0) for name in body.names])  # type: ignore[union-attr]
    assert scan.body.skin is not None
    moved = body.skin.world_points(body.world_from_part(q))
    true = scan.body.skin.world_points(scan.body.world_from_part(scan.q))
    np.testing.assert_allclose(moved, true, atol=1e-4)
    share = json.loads((output.with_suffix(".json")).read_text(encoding="utf-8"))["overlaps"]
    assert min(share.values()) > 0.93


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda table: table.pop("joints"), 'expected a list "joints" of tables'),
        (lambda table: table["joints"][0].pop("centre_m"), "joints: centre_m: Field required"),
        (lambda table: table["joints"][0].update(child="chets"), 'no segment "chets" in the weights; did you mean'),
        (lambda table: table["joints"][0]["axes"].update(flexion=[0, 0, 9]), "an axis of length 9, expected a unit"),
        (lambda table: table.update(joint_centres_m=[1]), '"joint_centres_m": expected a table of points'),
        (
            lambda table: [one.update(name=one["name"].replace("left", "l")) for one in table["joints"]],
            "expected joints of both sides",
        ),
    ],
)
def test_wrong_joints_are_one_sentence(tmp_path: Path, change: object, said: str) -> None:
    scan = scanned(tmp_path, "upper21", POSE_DEG)
    table = json.loads(scan.files.joints.read_text(encoding="utf-8"))
    change(table)  # type: ignore[operator]
    scan.files.joints.write_text(json.dumps(table), encoding="utf-8")
    with pytest.raises(ConfigError) as found:
        read_scan(scan.files, Mirror())
    assert said in str(found.value)


@pytest.mark.parametrize(
    ("matrix", "error", "said"),
    [
        (1000 * np.eye(3), ConfigError, r"scan\.ply: a surface of 1\.68e\+03 m, expected one person in metres"),
        (Rotation.from_euler("x", -90, degrees=True).as_matrix(), ModelError, r"(89|90) degrees from .*expected z up"),
    ],
)
def test_other_units_and_axes_are_refused(tmp_path: Path, matrix: Array, error: type[Exception], said: str) -> None:
    scan = scanned(tmp_path, "upper21", {})
    surface = read_surface(scan.files.surface)
    write_surface(ScannedSurface(surface.points @ matrix.T, surface.faces), scan.files.surface)
    table = json.loads(scan.files.joints.read_text(encoding="utf-8"))
    for one in table["joints"]:
        one["centre_m"], one["axes"] = (matrix @ one["centre_m"]).tolist(), {}
    scan.files.joints.write_text(json.dumps(table), encoding="utf-8")
    with pytest.raises(error, match=said):
        rigged(read_description(model_path("upper21")), read_scan(scan.files, Mirror()), "nobody")


def test_joints_in_one_place_point_nowhere(tmp_path: Path) -> None:
    scan = read_scan(scanned(tmp_path, "upper21", POSE_DEG).files, Mirror())
    elbow = next(one for one in scan.joints if one.child == "left_forearm")
    joints = tuple(replace(one, centre=elbow.centre) if one.child == "left_hand" else one for one in scan.joints)
    known = rigged(read_description(model_path("upper21")), replace(scan, joints=joints), "somebody").description
    assert np.isfinite([part.start for part in known.parts]).all()
    known.model_copy(update={"skin": None}).build()


def test_a_scan_without_the_models_segments_is_refused(tmp_path: Path) -> None:
    scan = scanned(tmp_path, "upper21", POSE_DEG)
    known = read_scan(scan.files, Mirror())
    animal = read_description(model_path("quadruped"))
    names = tuple(f"x{n}" for n in range(len(known.rigging.segments)))
    renamed = replace(known, rigging=replace(known.rigging, segments=names))
    with pytest.raises(ModelError, match="the scan has no segment of model"):
        rigged(animal, renamed, "nobody")


def test_a_configuration_is_one_kind_of_acquisition(tmp_path: Path) -> None:
    (tmp_path / "none.toml").write_text('name = "x"\n', encoding="utf-8")
    done = CliRunner().invoke(app, ["acquire", str(tmp_path / "none.toml")])
    assert "or a [scan] with its joints" in str(done.exception)
