"""Least squares: delays and turns of views that bring contours and edges of tracked persons together.

An adjustment as in photogrammetry. The pose of each person in each frame is among the unknowns, so that the effect of a
displaced pose does not count as a delay.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers, frozen
from tracker.foundation.progress import Progress, silent
from tracker.results.alignment import DelayChange, ViewAlignment, beside_most
from tracker.results.alignment._equations import (
    POSE_SPREAD,
    Eliminated,
    Look,
    Sums,
    Unknowns,
    eliminated,
    jackknife,
    looks_of,
)
from tracker.results.alignment.moments import Moment, Tracked, rates_of, speed
from tracker.tracking.estimate import Estimate

FEWEST = 8
"""Least number of moments for a result."""

_FEWEST_BESIDE = 5
"""Least number of moments on each side of a change of delays."""

_SEEMS = 0.2
"""Share of a significant change from which on it is adjusted: pairs made with common delays show less of it."""

_GATES_PX = (12.0, 8.0, 6.0, 5.0, 5.0)
"""Largest distance of a pair in each round, px."""


def align(moments: Sequence[Moment], interval_s: float, progress: Progress = silent) -> ViewAlignment | None:
    """Delays and turns of the views; None if there are too few moments, or one view alone.

    Args:
        moments: of one rig, in the order of time.
        interval_s: from one frame to the next, seconds.
        progress: gets the rounds.
    """
    if len(moments) < FEWEST or len(moments[0].scene.rig) < 2:
        return None
    rig = moments[0].scene.rig
    task = _Task(moments, [looks_of(moment) for moment in moments], rig, interval_s, progress)
    poses = [moment.scene.persons[moment.person].q for moment in moments]
    whole = task.solved(_State(Unknowns.nothing(1, len(rig)), poses, ()), np.zeros(len(moments), np.int64))
    sigmas = jackknife(task.sums(whole, np.zeros(len(moments), np.int64)).without_each())
    n_delays = len(rig) - 1
    posed = list(zip(moments, whole.poses, strict=True))
    return ViewAlignment(
        rig,
        interval_s,
        frozen(interval_s * whole.unknowns.late_frames(0)),
        frozen(interval_s * np.r_[0.0, sigmas[:n_delays]]),
        frozen(whole.unknowns.turns),
        frozen(sigmas[n_delays:].reshape(-1, 3)),
        len(moments),
        frozen(np.mean([_place(moment) for moment in moments], axis=0)),
        float(np.mean([speed(moment.scene.persons[moment.person].body, q, moment.rates[0]) for moment, q in posed])),
        _change(task, whole),
    )


def turned(rig: Rig, turns: Array) -> Rig:
    """The rig with each camera turned in its place by a rotation vector (V, 3) in its coordinates, rad."""
    cameras = []
    for camera, turn in zip(rig.cameras, turns, strict=True):
        motion = np.eye(4)
        motion[:3, :3] = Rotation.from_rotvec(np.array(turn)).as_matrix()
        cameras.append(replace(camera, camera_from_world=motion @ camera.camera_from_world))
    return Rig(tuple(cameras))


@dataclass(frozen=True)
class _State:
    """Present state of the adjustment."""

    unknowns: Unknowns
    poses: Sequence[Array]
    told: Sequence[Eliminated]
    """Equations of the round before, one a moment."""


@dataclass(frozen=True)
class _Task:
    """Unknowns."""

    moments: Sequence[Moment]
    looks: Sequence[Sequence[Look]]
    rig: Rig
    interval_s: float
    progress: Progress

    def solved(self, state: _State, parts: Integers) -> _State:
        """After all rounds; each moment is in a part (M,) of the recording with its own delays."""
        for done, gate_px in enumerate(_GATES_PX):
            self.progress("comparing the views", done, len(_GATES_PX))
            state = self._round(state, parts, gate_px)
        self.progress("comparing the views", len(_GATES_PX), len(_GATES_PX))
        return state

    def sums(self, state: _State, parts: Integers) -> Sums:
        """The equations of a state's round before, with its moments in other parts."""
        unknowns = state.unknowns
        if parts.max() >= len(unknowns.delays):
            unknowns = Unknowns(np.repeat(unknowns.delays, parts.max() + 1, axis=0), unknowns.turns)
        return Sums.of(state.told, parts, unknowns, np.array([camera.matrix[0, 0] for camera in self.rig.cameras]))

    def _round(self, state: _State, parts: Integers, gate_px: float) -> _State:
        by_now = turned(self.rig, state.unknowns.turns)
        told = [
            eliminated(
                moment,
                [look.by(by_now) for look in looks],
                q,
                state.unknowns.late_frames(part),
                self.interval_s,
                gate_px,
            )
            for moment, looks, q, part in zip(self.moments, self.looks, state.poses, parts, strict=True)
        ]
        step = self.sums(replace(state, told=told), parts).step()
        poses = [
            one.moved(q, step[state.unknowns.columns(part)])
            for one, q, part in zip(told, state.poses, parts, strict=True)
        ]
        return _State(state.unknowns.moved(step), poses, told)


def _change(task: _Task, whole: _State) -> DelayChange | None:
    """The most likely change of delays between two moments; None if none is likely.

    The equations of the whole show the candidates; each split of them is a solution of small systems. Only a likely
    change is adjusted, and then again where its moments place it.
    """
    at = [moment.frame.index for moment in task.moments]
    n, every = len(at), np.arange(len(at))
    splits = [k for k in range(_FEWEST_BESIDE, n - _FEWEST_BESIDE + 1) if at[k - 1] < at[k]]
    if not splits:
        return None
    best = max(splits, key=lambda k: task.sums(whole, _after(every, k)).gain)
    if not _told_change(task, whole, _after(every, best)).likely(_SEEMS * task.interval_s):
        return None
    both = Unknowns(np.repeat(whole.unknowns.delays, 2, axis=0), whole.unknowns.turns)
    tried: dict[int, _State] = {}
    while best not in tried:
        first = task.solved(_State(both, whole.poses, ()), _after(every, best))
        tried[best] = task.solved(replace(first, told=()), _after(every, best))
        better_before = np.cumsum(_dearer_after(tried[best], best))
        best = max(splits, key=lambda k: better_before[k - 1])
    found = _told_change(task, tried[best], _after(every, best))
    return found if found.likely(task.interval_s) else None


def _after(every: Integers, split: int) -> Integers:
    """(M,) part of each moment: 1 from the split on."""
    return (every >= split).astype(np.int64)


def _dearer_after(state: _State, split: int) -> Array:
    """(M,) extra cost of a moment with the delays after the split against those before it."""
    step = np.zeros(len(state.told[0].vector))
    n_delays = state.unknowns.delays.shape[1]
    step[:n_delays] = state.unknowns.delays[1] - state.unknowns.delays[0]
    costs = []
    for k, one in enumerate(state.told):
        there = step if k < split else -step
        cost = one.vector @ there + 0.5 * there @ one.matrix @ there
        costs.append(cost if k < split else -cost)
    return np.array(costs)


def _told_change(task: _Task, state: _State, parts: Integers) -> DelayChange:
    """Delays in two parts of the recording by the equations of a state."""
    sums = task.sums(state, parts)
    first = int(parts.argmax())
    delays = [
        np.array([sums.at.moved(step).late_frames(part) for step in (sums.step(), *sums.without_each())])
        for part in (0, 1)
    ]
    before, after = (task.interval_s * one for one in delays)
    steps = beside_most(after - before)
    return DelayChange(
        (task.moments[first - 1].frame.index, task.moments[first].frame.index),
        frozen(before[0]),
        frozen(before[0] + steps[0]),
        frozen(jackknife(steps[1:])),
    )


def _place(moment: Moment) -> Array:
    """(3,) middle of the person's joints, metres."""
    person = moment.scene.persons[moment.person]
    place: Array = person.body.landmarks_in_world(person.q[None])[0].mean(axis=0)
    return place


_STEP_GATES_PX = (10.0, 8.0, 6.0, 6.0)
"""Largest distance of a contour and its edge in each step, px."""


def in_step(
    scene: Scene, frames: Sequence[Tracked], found: ViewAlignment, images: Iterable[Frame]
) -> Iterator[tuple[int, tuple[Estimate, ...]]]:
    """The estimates of all persons at the first view's moment.

    Each view is compared with the pose that the movement has reached when that view films: the pose in question, moved
    on during the view's delay as the tracked poses move. Lost persons stay as they are.

    Args:
        scene: the persons, and the rig that they were tracked with.
        frames: the poses found.
        found: delays of the views.
        images: the recording from its start on.

    Yields:
        Number of a frame and its estimates.
    """
    rates = [rates_of(person.body, frames, k) for k, person in enumerate(scene.persons)]
    places = {one.index: t for t, one in enumerate(frames)}
    for frame in images:
        t = places.get(frame.index)
        if t is None:
            continue
        estimates = list(frames[t].estimates)
        posed = scene.with_poses(tuple(estimate.q for estimate in estimates))
        for k, estimate in enumerate(estimates):
            if not estimate.lost:
                q = at_one_moment(Moment(frame, posed, k, rates[k][t]), found.delays_at(frame.index))
                estimates[k] = replace(estimate, q=q)
        yield frame.index, tuple(estimates)


def at_one_moment(moment: Moment, delays_s: Array) -> Array:
    """(dof,) the pose of a person when the first view films.

    Args:
        moment: the images, the pose as tracked and its movement.
        delays_s: (V,) delay of each view against the first one.
    """
    person, looks = moment.scene.persons[moment.person], looks_of(moment)
    spread = np.where(person.body.rotates, *POSE_SPREAD)
    q = person.q
    for gate_px in _STEP_GATES_PX:
        matrix, vector = np.diag(spread**-2), (q - person.q) / spread**2
        for look in looks:
            residuals, jacobian, _, weights = look.rows(moment.later(q, delays_s[look.view]), gate_px)
            weighted = weights[:, None] * jacobian
            matrix, vector = matrix + jacobian.T @ weighted, vector + weighted.T @ residuals
        q = person.body.clamped(q - np.linalg.solve(matrix, vector))
    return frozen(q)
