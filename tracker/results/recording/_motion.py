"""Data of exports: one person's poses over a run, segments in space, points on them."""

from __future__ import annotations

import logging
import re
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.bodies.body import BodyModel
from tracker.bodies.body.surface import segments_in_world
from tracker.bodies.scene import Person
from tracker.bodies.segments import Landmark
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.files import write_whole
from tracker.results.recording import RunContext
from tracker.tracking.estimate import Status
from tracker.tracking.trajectory import Step

_NOT_IN_A_NAME = re.compile(r"[\s\\*+/{}]")
"""Characters that OpenSim refuses, that end a name for a BVH reader, and the tab of a table."""


def exported_name(name: str) -> str:
    """The name with `_` for each such character: a BVH reader read "left thigh" and "left shin" as two "left"."""
    return _NOT_IN_A_NAME.sub("_", name)


Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""From our world, z up, to that of programs with y up: x stays, (x, y, z) becomes (x, z, -y)."""

_EVEN = 0.01
"""Share of an interval by which frames may deviate from even times, as at 29.97 fps written with six digits."""

_GAP = 0.75
"""Distance in intervals from the nearest frame beyond which a pose is not interpolated: more than jitter's half."""

log = logging.getLogger("tracker")

# Three markers spread around a segment.
_AROUND = np.radians([0.0, 120.0, 240.0])
_ALONG = np.radians([30.0, 0.0, -30.0])
"""Longitudes and latitudes of a segment's three surface points, around it and along it, which fix its turn."""


@dataclass(frozen=True)
class Motion:
    """One person's movement."""

    name: str
    body: BodyModel
    times_s: Array
    """(T,) of the frames."""

    interval_s: float
    """Usual time from one frame to the next."""

    q: Array
    """(T, dof) poses; those of lost frames are not to be used."""

    lost: Mask
    """(T,) frames in which the person is lost."""

    covariances: Array
    """(T, dof, dof) of the poses; NaN where unknown."""

    shares: Array
    """(T, P) explained share of each part's visible contour; NaN if it is hidden, 0 in doubt or if it was filled in."""

    frames: tuple[int, ...] = ()
    """Numbers of the frames in the recording; empty for a movement at even times."""

    joint_sigmas_m: Array | None = None
    """(T, L) standard deviations of the landmarks, including the body's; NaN where unknown."""

    @cached_property
    def doubted(self) -> Mask:
        """(T,) found or filled-in frames in which nothing is reliable."""
        mask: Mask = ~self.lost & (np.nan_to_num(self.shares) == 0).all(axis=1)
        return mask

    @cached_property
    def filled(self) -> Array:
        """(T, dof) poses with lost frames interpolated in time, and held at the ends, for formats that need a pose.

        Angles take the shorter way round.
        """
        found = np.flatnonzero(~self.lost)
        if not len(found):
            return np.tile(self.body.rest(), (len(self.q), 1))
        known = np.where(self.body.rotates, np.unwrap(self.q[found], axis=0), self.q[found])
        times = self.times_s[found]
        filled: Array = np.stack([np.interp(self.times_s, times, column) for column in known.T], axis=1)
        filled[found] = self.q[found]
        return filled

    def told_filled(self, path: Path) -> None:
        """Logs the number of interpolated poses of a file, for formats that cannot mark them."""
        if self.lost.any():
            log.warning(
                "%s: %s is lost in %d of %d frames, whose poses are interpolated: the format cannot leave them out",
                path.name,
                self.name,
                int(self.lost.sum()),
                len(self.lost),
            )

    def even(self) -> Motion:
        """The movement at even times, for formats with one frame rate; itself if its times are even.

        Poses at uneven times are interpolated; a time far from all frames counts as lost.
        """
        n_frames = round((self.times_s[-1] - self.times_s[0]) / self.interval_s) + 1
        times = self.times_s[0] + self.interval_s * np.arange(n_frames)
        if n_frames == len(self.times_s) and np.abs(times - self.times_s).max() < _EVEN * self.interval_s:
            return self
        after = np.clip(np.searchsorted(self.times_s, times), 1, len(self.times_s) - 1)
        nearest = np.where(times - self.times_s[after - 1] <= self.times_s[after] - times, after - 1, after)
        gap = np.abs(self.times_s[nearest] - times) > _GAP * self.interval_s
        known = np.where(self.body.rotates, np.unwrap(self.filled, axis=0), self.filled)
        q = np.stack([np.interp(times, self.times_s, column) for column in known.T], axis=1)
        return Motion(
            self.name,
            self.body,
            times,
            self.interval_s,
            q,
            self.lost[nearest] | gap,
            self.covariances[nearest],
            self.shares[nearest],
            joint_sigmas_m=None if self.joint_sigmas_m is None else self.joint_sigmas_m[nearest],
        )

    def local(self, q: Array) -> Array:
        """Placements of the segments in their parents' (T, S, 4, 4), of roots in the world, metres."""
        placed = self.segments(q)
        local = np.array(placed)
        for k, segment in enumerate(self.body.segments):
            if segment.parent >= 0:
                local[:, k] = np.linalg.inv(placed[:, segment.parent]) @ placed[:, k]
        return local

    def slides(self, segment: int) -> bool:
        """Whether a segment's joint moves in its parent."""
        return any(not self.body.rotates[k] for k in self.body.segments[segment].parameters)

    def segments(self, q: Array) -> Array:
        """Placements of the segments (T, S, 4, 4): origin in the joint, axes of the reference pose, metres."""
        return segments_in_world(self.body, q)

    def points(self, q: Array, marks: Iterable[Landmark]) -> Array:
        """Marks on the body in the world (T, M, 3), metres."""
        chosen = tuple(marks)
        motions = self.body.world_from_parameters(q)[:, [mark.parameter for mark in chosen]]
        points = np.array([mark.point for mark in chosen])
        world: Array = (motions[..., :3, :3] @ points[..., None])[..., 0] + motions[..., :3, 3]
        return world

    def sigmas(self, marks: Iterable[Landmark]) -> Array:
        """Standard deviation of marks in space (T, M): root of the summed variances of x, y, z, metres."""
        chosen = tuple(marks)
        parameters = np.array([mark.parameter for mark in chosen])
        world = self.points(self.q, chosen)
        rows = []
        for q, points, covariance in zip(self.q, world, self.covariances, strict=True):
            jacobian = self.body.point_jacobian(q, points, parameters)
            rows.append(np.sqrt(np.maximum(np.einsum("mik,kl,mil->m", jacobian, covariance, jacobian), 0)))
        sigmas_m = np.array(rows)
        names = self.body.landmark_names
        if self.joint_sigmas_m is not None and self.joint_sigmas_m.shape[1] == len(names):
            for m, mark in enumerate(chosen):
                if mark.name in names:
                    told = self.joint_sigmas_m[:, names.index(mark.name)]
                    sigmas_m[:, m] = np.where(np.isfinite(told), told, sigmas_m[:, m])
        return sigmas_m


class Motions:
    """The movements of all persons, collected frame by frame."""

    def __init__(self, run: RunContext) -> None:
        self._run = run
        self._steps: list[tuple[float, list[tuple[Array, bool, Array, Array, Array]]]] = []
        self._frames: list[int] = []

    def add(self, step: Step) -> None:
        """Takes the poses of one frame."""
        rows = []
        for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
            account = estimate.account
            with np.errstate(invalid="ignore", divide="ignore"):
                shares = account.explained_px / account.visible_px
            for group in estimate.ambiguous:
                shares[person.body.parts_of(group)] = 0
            if estimate.doubtful or estimate.status is Status.FILLED:
                shares[:] = 0
            sigmas_m = estimate.joint_sigmas_m
            told = np.full(len(person.body.landmarks), np.nan) if sigmas_m is None else sigmas_m
            rows.append((estimate.q, estimate.lost, estimate.covariance, shares, told))
        self._steps.append((step.frame.time_s, rows))
        self._frames.append(step.frame.index)

    def all(self) -> list[Motion]:
        """One a person; empty without a frame."""
        if not self._steps:
            return []
        return [self._of(k, person) for k, person in enumerate(self._run.scene.persons)]

    def _of(self, k: int, person: Person) -> Motion:
        times = np.array([time_s for time_s, _ in self._steps])
        q, lost, covariances, shares, sigmas_m = (
            np.array(column) for column in zip(*(r[k] for _, r in self._steps), strict=True)
        )
        told = person.name, person.body, times, self._run.interval_s
        return Motion(*told, q, lost, covariances, shares, tuple(self._frames), sigmas_m)


def euler_angles(matrices: Array, order: Literal["ZXY", "XYZ"]) -> Array:
    """Angles (*B, 3), rad, of rotations (*B, 3, 3) one about the axes of the other.

    Where the middle one is 90 degrees the outer two turn about one axis, and the last is 0.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        angles: Array = Rotation.from_matrix(matrices).as_euler(order)
    return angles


class MotionRecorder:
    """Writes a file of each person's whole movement at the end; `filled` names a format that needs every pose."""

    def __init__(self, run: RunContext, write: Callable[[Motion, Path], Path], filled: str = "") -> None:
        self._folder, self._motions, self._write, self._filled = run.folder, Motions(run), write, filled

    def write(self, step: Step) -> None:
        """Adds one frame."""
        self._motions.add(step)

    def finish(self) -> tuple[Path, ...]:
        """Writes the files; formats that need every pose leave out persons that are lost in all frames."""
        files: list[Path] = []
        for motion in self._motions.all():
            if self._filled and motion.lost.all():
                log.warning("%s is lost in all %d frames: no %s", motion.name, len(motion.lost), self._filled)
            else:
                files.append(self._write(motion, self._folder))
        return tuple(files)


def markers_of(body: BodyModel) -> tuple[Landmark, ...]:
    """The landmarks, and three points on the surface of each segment's largest part.

    With joint centres alone a segment can turn about the line between them: OpenSim's inverse kinematics turned a neck
    by 52 degrees.
    """
    surface = []
    for segment in body.segments:
        parts = [part for part in body.parts if part.segment == segment.name]
        if not parts:
            continue
        largest = max(parts, key=lambda part: float(np.prod(part.shape.size)))
        points, _ = largest.shape.surface(_ALONG, _AROUND)
        points = points @ largest.model_from_part[:3, :3].T + largest.model_from_part[:3, 3]
        names = (f"{segment.name}_surface_{k}" for k in (1, 2, 3))
        surface += [Landmark(n, segment.end, p, segment.name) for n, p in zip(names, points, strict=True)]
    return (*body.landmarks, *surface)


def trc_text(title: str, names: Sequence[str], times_s: Array, interval_s: float, points: Array) -> bytes:
    """The content of a TRC file.

    Args:
        title: for its first line.
        names: of the markers.
        times_s: (T,) of the frames.
        interval_s: usual time from one frame to the next.
        points: (T, M, 3) metres; NaN where there is none.
    """
    rate, n_frames = f"{1 / interval_s:.6g}", str(len(points))
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{title}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        "\t".join([rate, rate, n_frames, str(len(names)), "m", rate, "1", n_frames]),
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{k}" for k in range(1, len(names) + 1) for axis in "XYZ"),
        "",
    ]
    for k, (time_s, row) in enumerate(zip(times_s, points.reshape(len(points), -1), strict=True), start=1):
        # An empty cell breaks OpenSim.
        cells = ("NaN" if np.isnan(value) else f"{value:.6f}" for value in row)
        lines.append(f"{k}\t{time_s:.6f}\t" + "\t".join(cells))
    return ("\n".join(lines) + "\n").encode()


# Writing of XML files.

Node = ElementTree.Element


def child(parent: Node, tag: str, text: str = "", **attributes: str) -> Node:
    """Adds an element with a text, or none."""
    node = ElementTree.SubElement(parent, tag, attributes)
    node.text = text or None
    return node


def write_xml(path: Path, root: Node) -> None:
    """Writes a file of elements, indented, as a whole."""
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    write_whole(path, f'<?xml version="1.0" encoding="UTF-8" ?>\n{text}\n')
