"""The space that several cameras see: how many of them see a whole person, where on the floor, and where to stand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.bodies.segments import Part
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.errors import CalibrationError, ConfigError
from tracker.synthesis import Synthesis

# Lengths are those of persons; of bodies below 0.8 m a share of them (`tracker.bodies.limbs.smallness`).
_CELLS = 160
"""Cells of the floor along its longer side."""

_FARTHEST_M = 12.0
"""From the middle of the cameras to where the floor is looked at, and half as far beside the outer ones: a person 12 m
away is 100 px high with a focal length of 720 px."""

_INSIDE_M, _BESIDE_M = 1.0, 3.0
"""Where the place that the cameras look at is farther away, or as near as this to the edge of the floor looked at, the
floor is looked at up to so far beyond it."""

_LEAST_PX, _USUAL_M = 100.0, 1.8
"""Height in a picture below which a person is too far away, and that of a usual one."""

_LEVELS = 7
"""Heights at which space is looked at."""

_ARMS_M = 0.35
"""Radius of a person with the arms hanging."""

_HEADINGS = 24
"""Directions that are tried for a path."""

_USUAL_DEG = -40.0
"""Heading of a simulated recording where nothing is said, see `tracker.synthesis.simulation.sequence.Recipe`."""


@dataclass(frozen=True)
class Floor:
    """Field of view of the cameras above each place of the floor."""

    x: Array
    """(W,) metres."""

    y: Array
    """(H,) metres."""

    heights: Array
    """(Z,) metres, from the floor to the top of the head."""

    whole: Integers
    """(H, W) cameras that see a whole person who stands there."""

    points: Integers
    """(Z, H, W) cameras that see a point above it, at each of the heights."""

    def area_m2(self, n: int) -> float:
        """Floor on which at least so many cameras see a whole person, square metres."""
        cell = float(self.x[1] - self.x[0]) * float(self.y[1] - self.y[0])
        return cell * int(np.count_nonzero(self.whole >= n))

    def volume_m3(self, n: int) -> float:
        """Space up to the top of the head that at least so many cameras see, cubic metres."""
        cell = float(self.x[1] - self.x[0]) * float(self.y[1] - self.y[0]) * float(self.heights[-1])
        return cell * float(np.mean(np.count_nonzero(self.points >= n, axis=(1, 2))))


def sizes(seen: Mapping[int, float], unit: str) -> str:
    """Number of cameras -> floor or space that so many or more see, in words; of small bodies it is a fraction of 1."""
    return ", ".join(f"{n} or more: {x:{'.2g' if 0 < x < 1 else '.1f'}} {unit}" for n, x in seen.items())


def sees(camera: Camera, points: Array) -> Mask:
    """(...,) whether a camera has world points (..., 3) in its picture."""
    pixels = camera.project(points)
    with np.errstate(invalid="ignore"):
        inside = ((pixels >= 0) & (pixels <= np.array(camera.size) - 1)).all(axis=-1)
    seen: Mask = np.asarray(inside & (camera.in_camera(points)[..., 2] > 0))
    return seen


def check_floor(rig: Rig) -> None:
    """Refuses cameras that cannot stand in a room whose floor is z = 0.

    Raises:
        CalibrationError: names a camera, and what to do.
    """
    for camera in rig.cameras:
        if camera.centre[2] <= 0:
            raise CalibrationError(
                f'camera "{camera.name}" is {-camera.centre[2]:.2f} m below the floor z = 0: bodies stand on it, z '
                "up; turn and move the world with bodytrack rig convert --up AXIS --floor METRES"
            )


def check_asked(rig: Rig, place: tuple[float, float] | None, heading_deg: float | None) -> None:
    """Refuses a place far from all cameras, as one in millimetres is, and a heading that is none.

    Raises:
        ConfigError: says where the cameras are.
    """
    if heading_deg is not None and not np.isfinite(heading_deg):
        raise ConfigError(f"--heading-deg {heading_deg}: expected degrees from the x axis")
    near = np.stack([*(camera.centre[:2] for camera in rig.cameras), _looked_at(rig)])
    low, high = near.min(axis=0) - _FARTHEST_M, near.max(axis=0) + _FARTHEST_M
    if place is not None and not ((low <= place) & (place <= high)).all():
        raise ConfigError(
            f"--place {place[0]:g} {place[1]:g}: far from all cameras, expected metres, x from {low[0]:.1f} to "
            f"{high[0]:.1f}, y from {low[1]:.1f} to {high[1]:.1f}"
        )


def floor_seen(rig: Rig, stature_m: float, share: float = 1.0) -> Floor:
    """Looks at every place of the floor z = 0 near the cameras.

    Args:
        rig: the cameras.
        stature_m: height of the person.
        share: of a person's lengths, for a body that is smaller than any.
    """
    centres = np.stack([camera.centre for camera in rig.cameras])[:, :2]
    middle = centres.mean(axis=0)
    farthest_m, inside_m, beside_m = share * _FARTHEST_M, share * _INSIDE_M, share * _BESIDE_M
    low = np.maximum(centres.min(axis=0) - farthest_m / 2, middle - farthest_m)
    high = np.minimum(centres.max(axis=0) + farthest_m / 2, middle + farthest_m)
    # cameras that all stand on one side may look at a place far beside them
    place = _looked_at(rig, share)
    low = np.where(place < low + inside_m, place - beside_m, low)
    high = np.where(place > high - inside_m, place + beside_m, high)
    step = float((high - low).max()) / _CELLS
    x, y = (np.arange(low[k], high[k] + step, step) for k in range(2))
    places = np.stack(np.meshgrid(x, y), axis=-1)
    heights = np.linspace(0.0, stature_m, _LEVELS)
    points = np.zeros((_LEVELS, *places.shape[:2]), dtype=np.int64)
    for camera in rig.cameras:
        points += np.stack([sees(camera, _above(places, height)) for height in heights])
    return Floor(x, y, heights, seen_whole(rig, places, stature_m, share), points)


def seen_whole(rig: Rig, places: Array, stature_m: float, share: float = 1.0) -> Integers:
    """(...,) cameras that see a whole person of such a height who stands at places (..., 2), metres.

    Args:
        rig: the cameras.
        places: x and y, metres.
        stature_m, share: see `floor_seen`.
    """
    whole: Integers = np.zeros(places.shape[:-1], dtype=np.int64)
    marks = _outline(stature_m, share * _ARMS_M)
    for camera in rig.cameras:
        whole += np.all([sees(camera, _above(places + mark[:2], mark[2])) for mark in marks], axis=0)
    return whole


def _looked_at(rig: Rig, share: float = 1.0) -> Array:
    """(2,) the place that the cameras look at, but not farther away than where a person is still large enough."""
    middle = np.mean([camera.centre[:2] for camera in rig.cameras], axis=0)
    way = rig.middle[:2] - middle
    farthest = share * _USUAL_M / _LEAST_PX * float(np.median([camera.matrix[0, 0] for camera in rig.cameras]))
    place: Array = middle + way * min(1.0, farthest / max(float(np.linalg.norm(way)), 1e-9))
    return place


def _above(places: Array, height: float) -> Array:
    """Points (..., 3) at a height above places (..., 2)."""
    return np.concatenate([places, np.full((*places.shape[:-1], 1), height)], axis=-1)


def _outline(stature_m: float, arms_m: float) -> Array:
    """(12, 3) points around a person, from the feet to the top of the head."""
    angles = np.arange(4) * np.pi / 2
    ring = arms_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.concatenate([np.column_stack([ring, np.full(4, height)]) for height in (0.0, stature_m / 2, stature_m)])


def best_place(floor: Floor) -> tuple[float, float]:
    """The middle of where most cameras see a whole person, or, if nowhere two do, of where two see most of one.

    Raises:
        CalibrationError: no two cameras see any place in common.
    """
    most = int(floor.whole.max())
    counts = floor.whole if most >= 2 else np.count_nonzero(floor.points >= 2, axis=0)
    most = int(counts.max())
    if most == 0:
        raise CalibrationError(
            "no place on the floor is seen by two cameras: turn them towards one another, or set them back; "
            "bodytrack rig check shows what each pair shares"
        )
    depth = distance_transform_edt(np.pad(counts >= most, 1))[1:-1, 1:-1]
    # of equally deep places the middle one
    rows, columns = np.nonzero(depth >= depth.max() - 1e-9)
    nearest = np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2)
    return float(floor.x[columns[nearest]]), float(floor.y[rows[nearest]])


def best_heading_deg(rig: Rig, body: BodyModel, poses: Array, place: tuple[float, float]) -> float:
    """The heading with which most cameras see most of a path whose middle lies at a place.

    Args:
        rig: the cameras.
        body: the person.
        poses: (T, dof) with heading 0 from the origin.
        place: x and y, metres.
    """
    points = body.landmarks_in_world(poses[:: max(len(poses) // 12, 1)])
    points = points - np.append(middle_of(body, poses), 0.0)

    def rank(heading_deg: float) -> tuple[float, float]:
        turned = _turned(points, np.radians(heading_deg)) + np.array([*place, 0.0])
        score = float(np.mean([sees(camera, turned).mean() for camera in rig.cameras]))
        # of equal ones that nearest to the usual one
        return round(score, 3), -abs((heading_deg - _USUAL_DEG + 180.0) % 360.0 - 180.0)

    return max((360.0 * k / _HEADINGS for k in range(_HEADINGS)), key=rank)


def start_of(body: BodyModel, poses: Array, heading_deg: float, place: tuple[float, float]) -> tuple[float, float]:
    """Where a path has to begin for its middle to lie at a place; poses (T, dof) go from the origin, heading 0."""
    middle = _turned(np.append(middle_of(body, poses), 0.0), np.radians(heading_deg))
    return place[0] - float(middle[0]), place[1] - float(middle[1])


def middle_of(body: BodyModel, poses: Array) -> tuple[float, float]:
    """The middle, x and y, of the way of the root over poses (T, dof), metres."""
    way = way_of(body, poses)[:, :2]
    x, y = ((way.min(axis=0) + way.max(axis=0)) / 2).tolist()
    return x, y


def way_of(body: BodyModel, poses: Array) -> Array:
    """(T, 3) where the root is at poses (T, dof), metres; the middle of what is fixed to the world."""
    if body.stays:
        middle = body.landmarks_in_world(poses).mean(axis=(0, 1))
        return np.tile(middle, (len(poses), 1))
    way: Array = poses[:, body.root.shifts]
    return way


def _turned(points: Array, angle: float) -> Array:
    cosine, sine = np.cos(angle), np.sin(angle)
    turned: Array = points @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return turned


# How much of every segment each view shows: inside the picture, and not behind another part.

_LONGEST_PX = 480
"""Longer side of the pictures in which visibility is looked up: a forearm is still some pixels wide."""

_FACING = 0.25
"""Cosine of the angle between a surface and the ray above which it faces the camera: the rim falls between pixels."""


def visible_shares(scene: Scene, poses: Array, synthesis: Synthesis) -> Array:
    """Shares of the surface of each part that a camera could see if nothing were before it or beyond the picture.

    Args:
        scene: one person, and the rig.
        poses: (B, dof).
        synthesis: says which part is seen at a pixel.

    Returns:
        (B, V, P) 0 to 1.
    """
    longest = max(max(camera.size) for camera in scene.rig.cameras)
    factor = max(1, round(longest / _LONGEST_PX))
    small = Scene(scene.persons, scene.rig.downscaled(factor) if factor > 1 else scene.rig)
    body = scene.persons[0].body
    shares = np.zeros((len(poses), len(small.rig), len(body.parts)))
    for b, q in enumerate(poses):
        pictures = synthesis.part_ids(small.with_pose(0, q))
        placements = body.world_from_part(q)
        for v, (camera, ids) in enumerate(zip(small.rig.cameras, pictures, strict=True)):
            for p, part in enumerate(body.parts):
                points, normals = _surface(part, placements[p])
                shares[b, v, p] = _share(camera, ids == p, points, normals)
    return shares


def _surface(part: Part, placement: Array) -> tuple[Array, Array]:
    """Points and unit normals (N, 3) spread over a part, in the world."""
    eta = np.linspace(-1.25, 1.25, 9)[:, None]
    omega = np.linspace(-np.pi, np.pi, 16, endpoint=False)[None, :]
    points, normals = part.shape.surface(eta, omega)
    turned = normals.reshape(-1, 3) @ placement[:3, :3].T
    return points.reshape(-1, 3) @ placement[:3, :3].T + placement[:3, 3], turned


def _share(camera: Camera, shown: Mask, points: Array, normals: Array) -> float:
    rays = points - camera.centre
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    facing = -(rays * normals).sum(axis=1) > _FACING
    if not facing.any():
        return 0.0
    pixels = camera.project(points[facing])
    height, width = shown.shape
    with np.errstate(invalid="ignore"):
        inside = ((pixels > -0.5) & (pixels < np.array([width, height]) - 0.5)).all(axis=1)
    inside &= camera.in_camera(points[facing])[:, 2] > 0
    columns, rows = np.round(pixels[inside]).astype(int).T
    return float(shown[rows, columns].sum()) / int(facing.sum())


def by_segment(body: BodyModel, shares: Array) -> dict[str, Array]:
    """Segment -> shares (B, V) of its parts, averaged by their length, from (B, V, P)."""
    found = {}
    lengths = np.array([float(part.shape.size.max()) for part in body.parts])
    for name in dict.fromkeys(part.segment for part in body.parts):
        chosen = [p for p, part in enumerate(body.parts) if part.segment == name]
        found[name] = np.average(shares[:, :, chosen], axis=2, weights=lengths[chosen])
    return found
