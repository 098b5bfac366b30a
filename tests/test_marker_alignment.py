"""Alignment of a track with markers in time and space, on simulated recordings and on the room's."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from marked import HINGES, OFFSET_S, SET, SHIFT, TIMES_S, TURN, joints_at, simulated, turn_error_deg

from tracker.bodies.body import BodyModel
from tracker.foundation.errors import SequenceError
from tracker.foundation.geometry import rigid_motion
from tracker.results.evaluation.marker_comparison import compare
from tracker.results.evaluation.marker_fit import align, placed
from tracker.results.evaluation.marker_set import MarkerJoints, joints_of
from tracker.results.evaluation.time_correlation import Clocked, flexions, offsets_by_angles

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def marker_joints(body: BodyModel) -> MarkerJoints:
    return joints_of(SET, Path("set.toml"), simulated(body, np.random.default_rng(0)))


def lost_arm(joints: np.ndarray, side: int) -> np.ndarray:
    """One arm stays where it was at first, as an arm does that was lost before the trunk."""
    wrong = joints.copy()
    wrong[:, 3 * side + 1 : 3 * side + 3] = joints[:1, 3 * side + 1 : 3 * side + 3] + (0.1, 0.15, 0.1)
    return wrong


@pytest.mark.parametrize("lost", [None, 0, 1])
def test_alignment_is_as_good_as_the_noise_allows_whichever_arm_is_lost(body, marker_joints, lost):
    """Half a millimetre on each of two markers, six joints (four, where an arm is lost) in 100 frames.

    The middle of a pair is known to 0.35 mm; 400 and more of them move at 0.5 m/s, 0.3 m about their centre: five
    standard errors are 0.2 ms, 0.02 deg and 0.1 mm. What is left is linear interpolation at 120 Hz, 50 m/s^2 dt^2 / 8 =
    0.4 mm, and the shift of each joint that is estimated besides: ten times the former, far below what is asked for.
    """
    joints = joints_at(body, TIMES_S)
    ours = Clocked(TIMES_S, joints if lost is None else lost_arm(joints, lost))
    found = align(ours, marker_joints, HINGES).placement
    assert found.offset_s == pytest.approx(OFFSET_S, abs=0.002)
    assert turn_error_deg(found.rotation, TURN) < 0.2
    middle = joints.mean(axis=(0, 1))
    assert np.linalg.norm(found.in_their_world(middle) - (TURN @ middle + SHIFT)) < 0.002
    back = found.in_our_world(found.in_their_world(joints))
    np.testing.assert_allclose(back, joints, atol=1e-12)


def test_a_plain_least_squares_fit_would_be_spoilt(body, marker_joints):
    """What the robust fit is for: the same track, all samples counted."""
    ours = lost_arm(joints_at(body, TIMES_S), 0)
    theirs = marker_joints.at(TIMES_S + OFFSET_S)
    both = np.isfinite(theirs).all(axis=-1)
    assert turn_error_deg(rigid_motion(ours[both], theirs[both])[:3, :3], TURN) > 3


@pytest.mark.parametrize("off_s", [-0.35, 0.35])
def test_time_is_found_from_where_angles_were_wrong_about_it(body, marker_joints, off_s):
    """A lost arm bends by itself: on R-Turn, angles were 0.3 s off."""
    ours = Clocked(TIMES_S, lost_arm(joints_at(body, TIMES_S), 0))
    found = placed(ours, marker_joints, OFFSET_S + off_s)
    assert found is not None
    assert found.offset_s == pytest.approx(OFFSET_S, abs=0.002)


def test_noise_of_a_track_is_averaged_and_told(body, marker_joints):
    rng = np.random.default_rng(3)
    ours = Clocked(TIMES_S, joints_at(body, TIMES_S) + 0.01 * rng.normal(size=(100, 6, 3)))
    found = align(ours, marker_joints, HINGES)
    assert abs(found.placement.offset_s - OFFSET_S) < 4 * max(found.offset_sigma_s, 0.001)
    assert turn_error_deg(found.placement.rotation, TURN) < 4 * found.rotation_sigma_deg
    assert 0.05 < found.rotation_sigma_deg < 2
    assert found.correlation > 0.9
    assert np.isnan(found.rival_offset_s)


def test_joints_beside_their_markers_are_found_and_bias_nothing(body, marker_joints):
    """The pair of one shoulder sits 20 mm off, as on R-Turn: found, though the others pull with 15 mm of prior."""
    beside = np.zeros((1, 6, 3))
    beside[0, 0] = (0.0, 0.02, 0.0)
    shifted = marker_joints.points + np.einsum(
        "tjab,tjb->tja", marker_joints.frames, np.broadcast_to(beside, (1, 6, 3))
    )
    found = align(Clocked(TIMES_S, joints_at(body, TIMES_S)), replace(marker_joints, points=shifted), HINGES).placement
    assert found.beside_m[0, 1] == pytest.approx(-0.02, abs=0.004)
    assert turn_error_deg(found.rotation, TURN) < 0.3


def test_movement_that_repeats_has_a_rival():
    """A push-up every 0.8 s on the spot: nothing tells one from the next."""
    bend = np.radians(50 + 40 * np.sin(2 * np.pi * np.arange(0, 8, 0.01) / 0.8))
    zero = np.zeros_like(bend)
    upper = np.stack([0.3 * np.sin(bend / 2), zero, 0.3 * np.cos(bend / 2)], axis=1)
    lower = np.stack([-0.3 * np.sin(bend / 2), zero, 0.3 * np.cos(bend / 2)], axis=1)
    arm = np.stack([upper + lower, lower, zero[:, None] * np.ones(3)], axis=1)
    markers = MarkerJoints(np.arange(0, 8, 0.01), arm, np.tile(np.eye(3), (800, 3, 1, 1)), shifts=(False, False, False))
    found = align(Clocked(np.arange(100) / 25, arm[100:500:4]), markers, [(0, 1, 2)])
    gap = found.rival_offset_s - found.placement.offset_s
    assert gap / 0.8 == pytest.approx(round(gap / 0.8), abs=0.02)
    assert round(gap / 0.8) != 0


def test_correlation_is_that_of_the_samples_both_have():
    """Against a plain sum over one lag after the other."""
    rng = np.random.default_rng(1)
    times_s = np.arange(300) / 100.0
    bend = np.cumsum(rng.normal(size=300)) * 4 + 60
    points = np.zeros((300, 3, 3))
    points[:, 0, 2], points[:, 2] = -1.0, np.stack([np.sin(np.radians(bend)), 0 * bend, np.cos(np.radians(bend))], 1)
    theirs = Clocked(times_s + 7.0, points)
    ours = Clocked(times_s[:200], points[60:260].copy())
    ours.points[20:30] = np.nan
    found = offsets_by_angles(ours, theirs, [(0, 1, 2)])
    assert found[0][1] == pytest.approx(7.6, abs=1e-9)
    assert found[0][0] == pytest.approx(1.0, abs=1e-6)
    angles = flexions(ours.points, [(0, 1, 2)])[:, 0], flexions(theirs.points, [(0, 1, 2)])[:, 0]
    for correlation, offset in found[1:]:
        shift = round((offset - 7.0) * 100)
        other = np.array([angles[1][k + shift] if 0 <= k + shift < 300 else np.nan for k in range(200)])
        both = np.isfinite(angles[0]) & np.isfinite(other)
        assert correlation == pytest.approx(np.corrcoef(angles[0][both], other[both])[0, 1], abs=1e-6)


def test_what_tells_no_time_is_said(body, marker_joints):
    still = Clocked(TIMES_S, np.repeat(joints_at(body, TIMES_S[:1]), 100, axis=0))
    with pytest.raises(SequenceError, match=r"no hinge turns by 2 degrees.*--offset"):
        align(still, marker_joints, HINGES)
    rng = np.random.default_rng(5)
    other = joints_at(body, TIMES_S)
    other[:, [2, 5]] = other[:, [1, 4]] + 0.2 * rng.normal(size=(100, 2, 3))
    with pytest.raises(SequenceError, match="do not vary together"):
        align(Clocked(TIMES_S, other), marker_joints, HINGES)
    given = align(Clocked(TIMES_S, joints_at(body, TIMES_S)), marker_joints, [], offset_s=OFFSET_S - 0.08)
    assert given.placement.offset_s == pytest.approx(OFFSET_S, abs=0.002)


@pytest.mark.parametrize("name", ["R-UpperBody", "R-Turn"])
@pytest.mark.parametrize("lost", [None, "left", "right"])
def test_recorded_markers_are_aligned_with_the_truth(data, tmp_path, name, lost):
    """Truth as the result. The joints' pairs lie up to 20 mm beside the centres, and the trunk hardly turns.

    Errors of the markers' elbows were counted without what slides on the cloth: 2 mm at either end of a bone of 0.24 m
    are up to a degree.
    """
    folder = data(f"room/{name}")
    truth = json.loads((folder / "markers" / "truth.json").read_text())
    result = tmp_path / "result"
    result.mkdir()
    with (folder / "gt_joints.csv").open(newline="") as file, (result / "joints.csv").open("w", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(("frame", "time_s", "person", "joint", "x_m", "y_m", "z_m"))
        for row in csv.DictReader(file):
            point = np.array([float(row[axis]) for axis in "xyz"])
            if lost and row["joint"] in (f"{lost[0]}_elbow", f"{lost[0]}_wrist"):
                point += (0.2, 0.1, 0.1)
            writer.writerow((row["frame"], int(row["frame"]) / 25, "1", row["joint"], *point))
    made = compare(result, folder / "markers" / "markers.trc", ROOT / "configs" / "markers" / "upper_body.toml")
    placed = made.alignment.placement
    assert placed.offset_s == pytest.approx(truth["marker_time_minus_video_time_s"], abs=0.002)
    wanted = np.array(truth["rotation_marker_from_world"])
    assert turn_error_deg(placed.rotation, wanted) < 0.3
    points = made.track.motion.points
    middle = np.nanmean(points, axis=(0, 1))
    assert np.linalg.norm(placed.in_their_world(middle) - (wanted @ middle + truth["translation_m"])) < 0.005
    if lost is None:
        angles = {angle.name: angle for angle in made.angles}
        for side in ("left", "right"):
            theirs = truth[f"elbow_{side[0].upper()}_markers_minus_truth_deg"]
            found = angles[f"{side}_elbow_flexion"]
            assert found.rms_deg == pytest.approx(theirs["rms"], abs=1)
            assert found.offset_deg == pytest.approx(-theirs["offset"], abs=1)
            assert found.rms_offset_removed_deg == pytest.approx(theirs["rms_offset_removed"], abs=1)
