"""Acquisition from points: known bodies found again from noisy and partial points, and from trajectories."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w
from followed import on_body, outer, written
from test_shape_space import some_shape, space
from typer.testing import CliRunner

from tracker.acquisition._residuals import part_slopes
from tracker.acquisition._surface_points import Tied, Tracks, outside, surface_rows, tied
from tracker.acquisition.clouds import Cloud, cloud_of, read_cloud
from tracker.acquisition.posed_points import FromPoints, Moment, PointSettings, acquire_from_points
from tracker.acquisition.result import bone_lengths
from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import save_rig
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import ConfigError, SequenceError, TrackerError
from tracker.points.following.tables import read_trajectories
from tracker.points.surfaces.points import SurfacePoints
from tracker.points.surfaces.surface_files import write_ply
from tracker.running.cli import _told, app
from tracker.running.jobs.acquire import acquire_to, acquisition_from
from tracker.synthesis.cpu import CpuSynthesis

NOISE_M, SPACING_M = 0.003, 0.015
OF = space()
WHO = some_shape(space(length=0.035), seed=3, share=0.8)
"""Somebody who is not the general model: as usual as those of whom lengths differ by 3.5 %."""

RIG = Rig((Camera.looking_at("a", (480, 640), 600, (4.0, 0.0, 1.0), np.array([0.0, 0.0, 1.0])),))
FACED_RAD = 0.7
FEW = replace(PointSettings().fit, iterations=8)


@lru_cache(maxsize=1)
def person() -> BodyModel:
    """Somebody who is not the general model."""
    return OF.body(WHO)


def posture(k: int) -> Array:
    body = person()
    q = body.rest()
    q[:3], q[body.index("torso_twist")] = (0.1, -0.2, 1.0), FACED_RAD
    bent = {"arm_abduction": (50, 80, 30, 60), "arm_extension": (10, 60, 90, 30), "leg_abduction": (7, 7, 7, 7)}
    bent |= {"leg_extension": (6, 30, 50, 17), "leg_elevation": (3, 23, 11, 34), "arm_elevation": (0, 20, -10, 40)}
    for name, degrees in bent.items():
        for side in ("left", "right"):
            q[body.index(f"{side}_{name}")] = np.radians(degrees[k])
    return body.clamped(q)


@lru_cache(maxsize=8)
def measured(k: int, front: bool = False) -> Array:
    """Noisy points of the outside, or of what faces the front."""
    body, q = person(), posture(k)
    points = on_body(body, 33, 40)
    world, normals = points.in_world(body, q)
    seen: Mask = outer(body, points, q)
    if front:
        seen = seen & (normals @ (np.cos(FACED_RAD), np.sin(FACED_RAD), 0.0) > 0.2)
    return world[seen] + NOISE_M * np.random.default_rng(k).normal(size=(int(seen.sum()), 3))


def cloud(k: int, front: bool = False, spacing_m: float = SPACING_M) -> Cloud:
    points = measured(k, front)
    return cloud_of(points, np.full(len(points), NOISE_M), spacing_m)


def stored(points: Array, path: Path) -> Path:
    n = len(points)
    write_ply(
        SurfacePoints(
            points=points,
            covariances=np.tile(NOISE_M**2 * np.eye(3), (n, 1, 1)),
            residual_px=np.zeros(n),
            pixels=np.zeros((1, n, 2)),
            colours=np.full((n, 3), 128, np.uint8),
            s0=1.0,
        ),
        path,
    )
    return path


def errors_mm(found: FromPoints) -> tuple[Array, Array]:
    """Errors and predicted standard deviations of all links."""
    marks = {mark.name: mark.point for mark in person().landmarks}
    off, sigma = [], []
    for bone in bone_lengths(found.fit):
        one, other = bone.bone.split("-")
        off.append(bone.length_mm - 1000 * float(np.linalg.norm(marks[one] - marks[other])))
        sigma.append(bone.sigma_mm)
    return np.array(off), np.array(sigma)


def joints_mm(found: FromPoints, k: int = 0) -> Array:
    gaps = found.fit.body.landmarks_in_world(found.fit.pose(k)) - person().landmarks_in_world(posture(k))
    distances: Array = 1000 * np.linalg.norm(gaps, axis=1)
    return distances


@pytest.mark.parametrize(("front", "most_mm", "sure_mm"), [(False, 12.0, 10.0), (True, 25.0, 15.0)])
def test_a_known_body_is_found_in_its_points(front: bool, most_mm: float, sure_mm: float) -> None:
    """Searched from nothing; and from a half of its surface, which is the same from both sides but for its feet."""
    found = acquire_from_points(OF, [Moment(cloud(0, front), RIG)], PointSettings())
    off, sigma = errors_mm(found)
    # honest: no length is off by more than three of its standard deviations, and these are less than those of persons
    assert (np.abs(off) < 3 * sigma).all()
    assert np.median(sigma) < sure_mm
    assert joints_mm(found).mean() < most_mm
    assert min(found.explained) > 0.98
    assert found.explained[0] > found.before[0]
    # the normals' part of the noise, less what is averaged in a cube, and what two steps of a distance leave
    assert found.rms_mm < 1000 * NOISE_M * 1.4


def test_rows_are_derivatives_of_distances() -> None:
    shape = some_shape(OF, seed=5, share=0.3)
    body, q, some = OF.body(shape), posture(0) + 0.01, cloud(0)
    steps, neighbours = OF.steps(shape), OF.neighbours(shape)
    rows = surface_rows(some, body, q, (0.02, 90.0), (0.005, 0.1))
    slopes = part_slopes((body, neighbours, steps), q)[rows.parts]
    jacobian = np.einsum("nk,nkj->nj", rows.asks, slopes)
    rng, step = np.random.default_rng(0), 1e-6

    def gaps(s: Array, pose: Array) -> Array:
        other = OF.body(s)
        _, feet, normals = outside(other.world_from_part(pose), other.shapes, some.points)
        return ((feet - some.points) * normals).sum(axis=1)

    # only those that stay on their part and within the gate
    here = np.abs(gaps(shape, q)) <= 0.02
    for _ in range(4):
        along = np.concatenate([OF.sigmas * rng.normal(size=len(shape)), 0.1 * rng.normal(size=len(q))])
        ends = [
            gaps(shape + sign * step * along[: len(shape)], q + sign * step * along[len(shape) :]) for sign in (1, -1)
        ]
        slope = (ends[0] - ends[1])[here] / (2 * step)
        off = np.abs(jacobian @ along - slope)
        # distances are to second order: at 10 mm from an elbow of 40 mm they are some per cent off
        assert np.quantile(off, 0.95) < 0.1 * np.abs(slope).max()
        assert np.median(off) < 0.01 * np.abs(slope).max()


def followed_places(n_moments: int, noise_m: float) -> tuple[Array, Array]:
    """(K, N, 3) points that keep their places on their parts, N spread over the outside, and (N,) their parts."""
    body = person()
    points = on_body(body, 9, 8)
    kept = np.all([outer(body, points, posture(k)) for k in range(n_moments)], axis=0)
    places = np.array([points.in_world(body, posture(k))[0][kept] for k in range(n_moments)])
    return places + noise_m * np.random.default_rng(7).normal(size=places.shape), points.part[kept]


def test_ties_vanish_at_the_truth_and_are_derivatives_beside_it() -> None:
    shape = WHO
    places, _ = followed_places(4, 0.0)
    tracks = Tracks(places, np.full(places.shape[:2], 1e-4), 0.03)
    dof = person().dof
    columns = [k * dof + np.arange(dof) for k in range(4)]
    truth = np.concatenate([shape, *(posture(k) for k in range(4))])

    def equations(x: Array) -> Tied:
        s, q = x[: len(shape)], x[len(shape) :]
        # so far a gate that all have the same weight
        return tied(tracks, (OF.body(s), OF.neighbours(s), OF.steps(s)), q, columns, 100.0, (0.005, 0.1))

    assert equations(truth).squares < 1e-12
    rng, step = np.random.default_rng(0), 1e-6
    beside = truth + 0.02 * rng.normal(size=len(truth)) * np.r_[OF.sigmas, np.ones(4 * dof)]
    found = equations(beside)
    for _ in range(4):
        along = rng.normal(size=len(truth)) * np.r_[OF.sigmas, 0.1 * np.ones(4 * dof)]
        slope = (equations(beside + step * along).squares - equations(beside - step * along).squares) / (2 * step)
        assert 2 * found.vector @ along == pytest.approx(slope, rel=1e-3)
    # where the joints are is seen whatever the poses: what is left of a length's information when they are free
    poses = np.arange(len(shape), len(truth))
    rest = found.matrix[np.ix_(poses, poses)] + 1e-9 * np.eye(len(poses))
    for name in ("left_thigh.length", "left_upper_arm.length"):
        k = OF.names.index(name)
        across = found.matrix[k, poses]
        left = found.matrix[k, k] - across @ np.linalg.solve(rest, across)
        # of 5 mm a point: better known than persons differ
        assert 0.005 / np.sqrt(left) < OF.sigmas[k]


def test_trajectories_make_lengths_surer(tmp_path: Path) -> None:
    moments = [Moment(cloud(k, spacing_m=0.025), RIG, q=posture(k) + 0.02, frame=k) for k in range(4)]
    places, _ = followed_places(4, 0.001)
    table = written(places, 0.001, 0.0, tmp_path / "trajectories.csv")
    few = PointSettings(fit=FEW)
    without = acquire_from_points(OF, moments, few)
    found = acquire_from_points(OF, moments, few, read_trajectories(table))
    assert found.n_tracks > 100
    assert without.n_tracks == 0
    bones = [bone.bone for bone in bone_lengths(found.fit)]
    # between two joints that turn: what a wrist or an ankle does not show, it does not make surer
    limbs = [k for k, bone in enumerate(bones) if "shoulder-left_elbow" in bone or "hip-left_knee" in bone]
    assert len(limbs) == 2
    (before, sure_before), (after, sure) = errors_mm(without), errors_mm(found)
    assert (sure[limbs] < 0.9 * sure_before[limbs]).all()
    assert (np.abs(after[limbs]) < 3 * sure[limbs]).all()
    assert np.sqrt((after[limbs] ** 2).mean()) < max(np.sqrt((before[limbs] ** 2).mean()), 2.0)


def test_a_body_that_may_face_either_way_is_refused_unless_it_is_told() -> None:
    """A trunk without head, arms and feet looks the same from the front and from behind."""
    points = measured(0)
    trunk = points[
        (points[:, 2] > 0.95) & (points[:, 2] < 1.35) & (np.abs(points[:, :2] - (0.1, -0.2)) < 0.25).all(axis=1)
    ]
    moment = Moment(cloud_of(trunk, np.full(len(trunk), NOISE_M), SPACING_M), RIG)
    with pytest.raises(SequenceError, match="may face") as caught:
        acquire_from_points(OF, [moment], PointSettings(least_lead=0.5, fit=FEW))
    assert "\n" not in str(caught.value)
    faced = PointSettings(heading_deg=float(np.degrees(FACED_RAD)), fit=FEW)
    found = acquire_from_points(OF, [Moment(cloud(0, front=True), RIG)], faced)
    assert joints_mm(found).mean() < 25


def test_points_of_something_else_are_refused() -> None:
    box = np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 2), (1000, 3))
    moment = Moment(cloud_of(box, np.zeros(1000), 0.1), RIG)
    with pytest.raises(SequenceError, match="points lie within"):
        acquire_from_points(OF, [moment], PointSettings(least_lead=0.0, fit=FEW))


def test_the_command_makes_a_model_and_refuses_bad_inputs(tmp_path: Path) -> None:
    stored(measured(0), tmp_path / "points.ply")
    stored(1000 * measured(0), tmp_path / "mm.ply")
    stored(measured(0)[:: len(measured(0)) // 40], tmp_path / "few.ply")
    (tmp_path / "text.ply").write_text("solid", encoding="utf-8")
    table = {"name": "eva", "model": "gavrila22", "stature_m": 1.8, "moments": [{"cloud": "points.ply"}]}
    config = tmp_path / "eva.toml"
    told = {"heading_deg": float(np.degrees(FACED_RAD)), "fit": {"iterations": 4}}
    config.write_text(tomli_w.dumps(table | {"acquisition": told}), encoding="utf-8")
    made = CliRunner().invoke(app, ["acquire", str(config), "--output", str(tmp_path / "models" / "eva.toml")])
    assert made.exit_code == 0, made.output
    assert "points of moment 1 on the model" in made.output
    assert (tmp_path / "models" / "eva.png").stat().st_size > 10_000
    faults = {
        "mm.ply": "millimetres",
        "few.ply": "expected at least 60",
        "text.ply": "does not begin with ply",
        "absent.ply": "cannot read the points",
    }
    for name, words in faults.items():
        config.write_text(tomli_w.dumps(table | {"moments": [{"cloud": name}]}), encoding="utf-8")
        # of these the command makes one line, as of whatever escapes
        refused = CliRunner().invoke(app, ["acquire", str(config), "--output", str(tmp_path / "no.toml")]).exception
        assert isinstance(refused, TrackerError)
        text, code = _told(refused)
        assert code == 2
        assert words in text
        assert "\n" not in text
        assert not (tmp_path / "no.toml").exists()
    read = read_cloud(tmp_path / "points.ply", SPACING_M)
    same = cloud(0)
    np.testing.assert_allclose(read.points, same.points, atol=1e-6)
    np.testing.assert_allclose(read.sigmas, same.sigmas, rtol=1e-4)


def test_silhouettes_and_start_poses_join_in(tmp_path: Path) -> None:
    """Points of the front alone do not show how deep the body is; a picture from the side does."""
    body, q = person(), posture(0)
    side = Camera.looking_at("side", (480, 640), 700, (0.1 - 3.2, -0.2 + 3.8, 1.0), np.array([0.1, -0.2, 0.95]))
    save_rig(Rig((side,)), tmp_path / "rig.toml")
    mask = CpuSynthesis().silhouettes(Scene((Person("eva", body, q),), Rig((side,))))[0]
    cv2.imwrite(str(tmp_path / "side.png"), 255 * mask.astype(np.uint8))
    stored(measured(0, front=True), tmp_path / "front.ply")
    units = [180 / np.pi if one.rotates else 1.0 for one in body.parameters]
    cells = [str(unit * value) for unit, value in zip(units, q, strict=True)]
    head = ",".join(["frame", "person", *(one.column for one in body.parameters)])
    (tmp_path / "start.csv").write_text(f"{head}\n0,eva,{','.join(cells)}\n", encoding="utf-8")
    picture = {"mask": "side.png", "rig": "rig.toml"}
    moment = {"cloud": "front.ply", "silhouettes": [picture]}
    table = {"name": "eva", "model": "gavrila22", "stature_m": 1.8, "start": "start.csv", "moments": [moment]}
    job = acquisition_from(table, "eva.toml", tmp_path, "eva")
    outcome = acquire_to(job, tmp_path / "models" / "eva.toml")
    assert outcome.overlaps["side"] > 0.95
    depths = {one.part: one.size_mm[0] for one in outcome.parts}
    true = dict(zip((part.name for part in body.parts), 2000 * body.shapes[:, 0], strict=True))
    # a silhouette of 220 px a metre is exact to 2 mm a side, and the other half of the trunk is as long as it says
    assert depths["torso"] == pytest.approx(true["torso"], abs=15)
    moment["silhouettes"] = [{"mask": "side.png", "px_per_m": 200.0}]
    with pytest.raises(ConfigError, match="without `rig`"):
        acquisition_from(table, "eva.toml", tmp_path, "eva").open()


def test_a_scanned_woman_has_her_own_lengths(tmp_path: Path) -> None:
    """Her clothes hide where the joints are: what the surface shows of them, within its standard deviations."""
    data = os.environ.get("BODYTRACK_DATA")
    if not data:
        pytest.skip("BODYTRACK_DATA is not set: no scanned person")
    scan, truth = Path(data) / "room" / "R-UpperBody" / "surface" / "scan.ply", {"upper_arm": 267.1, "thigh": 413.9}
    table = {"name": "rita", "stature_m": 1.70, "moments": [{"cloud": str(scan)}]}
    outcome = acquire_to(acquisition_from(table, "rita.toml", tmp_path, "rita"), tmp_path / "rita.toml")
    bones = {bone.bone: bone for bone in outcome.bones}
    for bone, true in (("left_shoulder-left_elbow", truth["upper_arm"]), ("left_hip-left_knee", truth["thigh"])):
        assert abs(bones[bone].length_mm - true) < 2 * bones[bone].sigma_mm < 30
    assert outcome.explained[0] > 0.97
