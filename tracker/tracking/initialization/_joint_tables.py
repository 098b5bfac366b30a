"""Start poses from a table of joint centres: of a marker system, another program, or an earlier result."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.keypoints import meant, plain_name
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError, nearest
from tracker.foundation.source_files import frame_in, number_in
from tracker.tracking.initialization._inverse_kinematics import fitted_pose

Row = dict[str, str]

_LEAST_MARKS = 6
"""Number of joints that fix a pose for a start: hips and shoulders, and two more."""

_FAR_M = 0.15
"""Mean distance from which on the joints are not the body's, metres."""


def is_joint_table(rows: list[Row]) -> bool:
    """Whether rows have a joint each, and not a pose."""
    return bool(rows) and "joint" in rows[0]


def pose_from_joints(rows: list[Row], body: BodyModel, index: int, path: Path) -> Array:
    """The pose (dof,) that fits the joints of a frame, or of the nearest earlier one, or the first.

    All rows are read, so that a wrong one is found before its frame.

    Args:
        rows: with the columns `frame`, `joint`, `x`, `y`, `z` (or `x_m`, ...), of one person, metres.
        body: owner of the pose.
        index: number of the frame.
        path: for messages.

    Raises:
        ConfigError: a column or joints are missing, or the body does not fit them.
    """
    axes = ("x_m", "y_m", "z_m") if "x_m" in rows[0] else ("x", "y", "z")
    for column in ("frame", *axes):
        if column not in rows[0]:
            raise ConfigError(f'{path}: no column "{column}" beside "joint"; {nearest(column, rows[0])}')
    places: dict[int, dict[str, Array]] = {}
    for row in rows:
        if all(row[axis] for axis in axes):
            of_frame = places.setdefault(frame_in(row, path, ConfigError), {})
            of_frame[row["joint"]] = np.array([number_in(row, axis, path, ConfigError) for axis in axes])
    if not places:
        raise ConfigError(f"{path}: no joint in it has a position")
    frame = max((number for number in places if number <= index), default=min(places))
    return _fitted(places[frame], body, frame, path)


def _fitted(places: dict[str, Array], body: BodyModel, frame: int, path: Path) -> Array:
    """The pose (dof,) of a body at the joints of a frame, name -> (3,) metres."""
    found = {mark: point for name, point in places.items() if (mark := _landmark(name, body)) is not None}
    # a joint that is called as ours is means ours, whatever else could
    found |= {name: point for name, point in places.items() if name in body.landmark_names}
    if len(found) < _LEAST_MARKS:
        raise ConfigError(
            f'{path}: frame {frame}: {len(found)} of the joints are landmarks of model "{body.name}", expected '
            f"{_LEAST_MARKS}; joints: {', '.join(places)}; landmarks: {', '.join(body.landmark_names)}"
        )
    pose, left_m = fitted_pose(body, meant(tuple(found), body), np.array(list(found.values())), np.ones(len(found)))
    if left_m.mean() > _FAR_M:
        raise ConfigError(
            f'{path}: frame {frame}: model "{body.name}" stays {left_m.mean():.2f} m from the joints on '
            f"average, expected less than {_FAR_M} m: they must be in metres, in the world of the calibration"
        )
    return pose


def _landmark(name: str, body: BodyModel) -> str | None:
    """The landmark of a joint of another program; a head may be its middle or its top and has none."""
    for own, others in body.joints.aliases.items():
        if name in others and own in body.landmark_names:
            return own
    plain = plain_name(name)
    return plain if plain in body.landmark_names and name.lower() != "head" else None
