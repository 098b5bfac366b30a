"""The world of a rig: which way is up, where the floor is, and what mends it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tracker.cameras.rig import CAMERAS, Rig, told_world, world_doubts
from tracker.cameras.rig_layouts import read_rig
from tracker.foundation.errors import CalibrationError
from tracker.synthesis.simulation.room import default_rig

ROOM = default_rig((360, 288))


def in_world(turn_deg: tuple[float, float, float], shift_m: float = 0.0) -> Rig:
    """The cameras of the room in a world that is turned, and then lifted."""
    world = np.eye(4)
    world[:3, :3] = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    world[2, 3] = shift_m
    return Rig(tuple(replace(one, camera_from_world=one.camera_from_world @ world) for one in ROOM.cameras))


def test_a_world_as_it_should_be_is_told_and_not_doubted() -> None:
    assert "z is up, the floor z = 0; cameras stand 2.20 to 2.50 m above it and look at a place 0." in told_world(ROOM)
    assert world_doubts(ROOM) == ()


def test_two_cameras_alone_that_face_each_other_are_told() -> None:
    names = ROOM.names
    told = {(one, other): world_doubts(ROOM.select((one, other))) for one in names for other in names if one < other}
    opposite = [line for lines in told.values() for line in lines]
    assert len(opposite) == 2, "of four cameras around a room"
    assert all("face each other" in line and "who faces where" in line for line in opposite)


def test_a_floor_above_a_camera_is_told_with_what_to_measure() -> None:
    (line,) = world_doubts(in_world((0, 0, 0), 2.5))
    assert "m below the floor: is z up and the origin on it?" in line
    assert "measure how high the lens" in line
    assert "rig convert THIS rig.toml --floor Z" in line


def test_cameras_that_look_at_the_floor_are_doubted() -> None:
    (line,) = world_doubts(in_world((0, 0, 0), 0.9))
    assert line.startswith("the cameras look at a place 0.0")


@pytest.mark.parametrize("turn_deg", [(28.0, 0.0, 0.0), (0.0, -20.0, 40.0)])
def test_a_turned_rig_is_told_and_turned_back(turn_deg: tuple[float, float, float]) -> None:
    turned = in_world(turn_deg)
    line, *_ = world_doubts(turned)
    assert line.startswith(
        f"the rig is turned: all cameras are upright about a direction {max(map(abs, turn_deg[:2])):.0f} d"
    )
    mended = turned.with_up(CAMERAS)
    assert world_doubts(mended) == ()
    np.testing.assert_allclose(
        [one.centre[2] for one in mended.cameras], [one.centre[2] for one in ROOM.cameras], atol=0.03
    )


def test_another_axis_that_is_up_is_named_with_the_command() -> None:
    (line,) = world_doubts(in_world((-90.0, 0.0, 0.0)))
    assert "upright with the rig's y axis up, expected z" in line or "-y axis up, expected z" in line
    assert "--up" in line


def test_what_two_cameras_hold_up_is_not_guessed() -> None:
    with pytest.raises(CalibrationError, match="expected three that look to different sides"):
        Rig(ROOM.cameras[:2]).with_up(CAMERAS)


def test_a_desk_whose_board_lay_obliquely_above_the_floor(data: Callable[[str], Path]) -> None:
    rig = read_rig(data("desk/camera_array.toml")).rig
    turned, floor = world_doubts(rig)
    assert "28 degrees off its z axis" in turned
    assert "below the floor" in floor
    assert "--up cameras --floor Z" in floor
    assert world_doubts(rig.with_up(CAMERAS, -1.2)) == ()
