"""Weighs the start poses of a person by the posterior: in their own frame, and in the next ones until one is sure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import TypeVar

import numpy as np

from tracker.bodies.limbs import are_apart, turned_round
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence import GUESSED
from tracker.evidence.measures.part_colours import colours_when_asked
from tracker.foundation.arrays import Array
from tracker.images.sight import Sight
from tracker.synthesis import side_by_side
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.cycle_turn import advance, objective_of, settled
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.hypotheses import hypothesis
from tracker.tracking.limb_probabilities import limb_probabilities, limbs_left_over
from tracker.tracking.start import Hypothesis, Start
from tracker.tracking.strangers import hide_strangers
from tracker.tracking.trajectory import Step

# Frames closer than this show hardly anything new.
_LEAST_GAP_S = 0.03
# A pose so much less probable than the best one is given up, nats. See docs/lab/weighed_starts.md.
_GIVEN_UP_NATS = 15.0
# Less probable after so many frames, no pose is the right one, and every limb is searched for in each frame: it took 97
# of the 123 s of a first start without plates, to choose among three that are all wrong.
_HOPELESS, _TOLD_AFTER = 0.2, 3

_Value = TypeVar("_Value")

Reopen = Callable[[], Iterator[Frame]]
"""Opens the frames of the sequence anew, from the first one."""


def rehearsed(start: Start, frame: Frame, scene: Scene, cycle: Cycle, reopen: Reopen | None) -> Start:
    """The start with the hypotheses of each person weighed, and the probability of the best one as its sureness.

    A silhouette looks the same from the front and from behind; colours of parts, elbows and knees do not. So the best
    pose turned round is one of them. A person who stands still gives no information, however long it takes. A given
    pose stays; if another one is more probable, the given one becomes unsure.

    Args:
        start: from the initialization.
        frame: of the start.
        scene: the persons and the rig.
        cycle: the components; its loss rule gives the number of frames, and the limit of uncertainty.
        reopen: opens the sequence anew; None if only this frame may be used.
    """
    if cycle.loss.rehearse == 0 or start.by_keypoints:
        return start
    # A hypothesis that is lost, or long in doubt, must not be rescued by a new bootstrapping: that pose would be judged
    # in its place. Without plates five of them took 215 of the 336 s that a start took.
    held = replace(cycle, loss=replace(cycle.loss, lost_below=0.0, least_views=0), seeks=False)
    start = replace(start, sureness=start.sureness or (1.0,) * len(start.hypotheses))
    for k, ranking in enumerate(start.hypotheses):
        if not ranking:
            continue
        tried = _within_reach(start, k, frame, scene, cycle)
        ranking = _Rehearsal(start, k, frame, scene, held).weighed(tried, reopen)
        chosen = next((one for one in ranking if one.given), ranking[0])
        start = replace(
            start,
            poses=_with(start.poses, k, chosen.q),
            hypotheses=_with(start.hypotheses, k, ranking),
            sureness=_with(start.sureness, k, chosen.probability),
        )
    return start


def _within_reach(start: Start, k: int, frame: Frame, scene: Scene, cycle: Cycle) -> list[Hypothesis]:
    """Hypotheses of person k that the frame does not rule out, with the best one turned round; a given one stays.

    A coarse search's pose that faces the other way has limbs elsewhere, and loses because of these. See
    docs/lab/facing.md.
    """
    scene, ranking = scene.with_poses(start.poses), start.hypotheses[k]
    body, poses = scene.persons[k].body, [one.q for one in ranking]
    turns = bool(body.start.turn) and not any(one.given for one in ranking)
    if turns:
        poses.append(turned_round(body, ranking[0].q))
    if len(poses) == 1:
        return list(ranking)
    objective = cycle.stages.objective(frame, scene, k, cycle.synthesis.contours(scene, k, np.array(poses)))
    if turns:
        other = hypothesis(body, cycle.estimation.estimate(objective, poses[-1][None]))
        ranking = (*ranking, other) if all(are_apart(body, one.q, other.q) for one in ranking) else ranking
    nats = objective.nats(np.array([one.q for one in ranking]))
    pairs = zip(ranking, nats - nats.min(), strict=True)
    return [one for one, behind in pairs if one.given or behind <= _GIVEN_UP_NATS]


def nats_in(frame: Frame, scene: Scene, k: int, poses: Array, cycle: Cycle) -> Array:
    """(B,) how improbable poses (B, dof) of a scene's person k are, by one observation of a frame, nats.

    The others are in their places; see `Objective.nats`.
    """
    sight = Sight(frame, cycle.plates)
    hide_strangers(sight, scene, cycle.synthesis)
    observed = cycle.evidence.observe(sight, cycle.synthesis.contours(scene, k, poses), GUESSED)
    return objective_of(scene, k, cycle, observed, colours_when_asked(sight)).nats(poses)


@dataclass(frozen=True)
class _Trial:
    """One hypothesis during the rehearsal."""

    hypothesis: Hypothesis
    scene: Scene
    state: State
    found: tuple[Estimate, ...]
    """Its estimates in all frames so far."""

    behind: tuple[float, ...] = ()
    """By how much it is less probable than the best one in each of them, nats."""

    @property
    def behind_nats(self) -> float:
        """The mean of it: frames in a row tell much the same."""
        return fmean(self.behind)


@dataclass(frozen=True)
class _Rehearsal:
    """What hypotheses of person k are followed with."""

    start: Start
    k: int
    frame: Frame
    scene: Scene
    cycle: Cycle

    def weighed(self, tried: Sequence[Hypothesis], reopen: Reopen | None) -> tuple[Hypothesis, ...]:
        """The hypotheses with their probabilities, the most probable one first."""
        cycle, name = self.cycle, self.scene.persons[self.k].name
        trials, beaten = self._compared(side_by_side(cycle.synthesis, self._begun, tried), self.frame), list[_Trial]()
        for n, later in enumerate(_following(self.frame, reopen, cycle.loss.rehearse)):
            ranking = self._told([*trials, *beaten])
            if ranking[0].probability >= cycle.loss.sure or (n >= _TOLD_AFTER and ranking[0].probability < _HOPELESS):
                break
            poses = f"{len(trials)} pose{'s' * (len(trials) > 1)} of {name}"
            cycle.progress(
                f"start: {poses} followed into frame {later.index}, {n + 1} of {cycle.loss.rehearse} at most"
            )

            def continued(trial: _Trial, later: Frame = later) -> _Trial:
                return self._continued(trial, later)

            every = self._compared(self._different(side_by_side(cycle.synthesis, continued, trials)), later)
            trials = [one for one in every if one.hypothesis.given or one.behind_nats <= _GIVEN_UP_NATS]
            beaten += [one for one in every if all(one is not other for other in trials)]
        return self._told([*trials, *beaten])

    def _compared(self, trials: Sequence[_Trial], frame: Frame) -> list[_Trial]:
        """The trials after a comparison of their poses by one observation of a frame, the most probable ones first."""
        behind = np.zeros(1)
        if len(trials) > 1:
            poses = np.array([trial.found[-1].q for trial in trials])
            nats = nats_in(frame, trials[0].scene, self.k, poses, self.cycle)
            behind = nats - nats.min()
        found = [replace(one, behind=(*one.behind, float(b))) for one, b in zip(trials, behind, strict=True)]
        return sorted(found, key=lambda one: one.behind_nats)

    def _different(self, trials: Sequence[_Trial]) -> list[_Trial]:
        """The most probable of those at one pose, or the given one.

        Two right hypotheses with different arms at first made each other unsure: six more starts were searched, two
        minutes, though both had been the same for nine frames.
        """
        body, kept = self.scene.persons[self.k].body, list[_Trial]()
        for trial in sorted(trials, key=lambda one: (not one.hypothesis.given, one.behind_nats)):
            if all(are_apart(body, trial.found[-1].q, other.found[-1].q) for other in kept):
                kept.append(trial)
        return kept

    def _told(self, trials: Sequence[_Trial]) -> tuple[Hypothesis, ...]:
        """The hypotheses as followed, with the probability that each is the right one and right at all.

        Its pose is that at the end of the first frame; a given pose stays as given. A leg beside its place was
        corrected before the pose was tracked on; when the run began at the old pose again, that leg was 0.11 m off in
        all frames, and nothing in doubt (docs/lab/rehearsed_pose.md).
        """
        shares = np.exp(-np.array([trial.behind_nats for trial in trials]))
        told = [self._on_average(one, float(share)) for one, share in zip(trials, shares / shares.sum(), strict=True)]
        return tuple(told[n] for n in np.argsort(-shares, kind="stable"))

    def _on_average(self, trial: _Trial, share: float) -> Hypothesis:
        """The hypothesis with its shares in all frames, and its probability beside others of some share."""
        body, accounts = self.scene.persons[self.k].body, [estimate.account for estimate in trial.found]
        limbs = [limbs_left_over(body, account) for account in accounts]
        return replace(
            trial.hypothesis,
            q=trial.hypothesis.q if trial.hypothesis.given else trial.found[0].q,
            distance_px=fmean(estimate.distance_px for estimate in trial.found),
            explained=fmean(account.explained for account in accounts),
            left_over=fmean(account.left_over for account in accounts),
            limbs_left_over={limb: fmean(own[limb] for own in limbs) for limb in limbs[0]},
            probability=share * fmean(_right(self.scene, self.k, one) for one in trial.found[1:] or trial.found),
        )

    def _begun(self, one: Hypothesis) -> _Trial:
        scene = self.scene.with_poses(self.start.poses).with_pose(self.k, one.q)
        sight, cycle = Sight(self.frame, self.cycle.plates), self.cycle
        hide_strangers(sight, scene, cycle.synthesis)
        observed = cycle.evidence.observe(sight, cycle.synthesis.contours(scene), GUESSED)
        # Or the right one loses by limbs that are elsewhere: it left 0.42 over instead of 0.20.
        estimates, scene = settled(sight, scene, cycle, observed, Status.BOOTSTRAPPED, (self.k,))
        step = Step(self.frame, scene, estimates, cycle.synthesis.contours(scene))
        state = State.before(scene).after(sight, step, cycle.evidence, cycle.loss)
        return _Trial(one, scene, state, (estimates[self.k],))

    def _continued(self, trial: _Trial, frame: Frame) -> _Trial:
        sight, cycle = Sight(frame, self.cycle.plates), self.cycle
        step = advance(sight, trial.scene, cycle, trial.state)
        state = trial.state.after(sight, step, cycle.evidence, cycle.loss)
        return replace(trial, scene=step.scene, state=state, found=(*trial.found, step.estimates[self.k]))


def _right(scene: Scene, k: int, estimate: Estimate) -> float:
    """Probability that a pose is right at all: that of its least probable limb."""
    limbs = limb_probabilities(scene.persons[k].body, estimate)
    return min(limbs.values(), default=estimate.account.explained)


def _following(frame: Frame, reopen: Reopen | None, n: int) -> Iterator[Frame]:
    """At most n frames after one, far enough apart."""
    last_s, left = frame.time_s, n
    for later in () if reopen is None else reopen():
        if left > 0 and later.index > frame.index and later.time_s - last_s >= _LEAST_GAP_S:
            last_s, left = later.time_s, left - 1
            yield later
        if left == 0:
            return


def _with(values: tuple[_Value, ...], k: int, value: _Value) -> tuple[_Value, ...]:
    return (*values[:k], value, *values[k + 1 :])
