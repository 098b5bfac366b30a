"""Rehearsal: start poses that one frame cannot decide are tracked into the next frames, which decide."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from statistics import fmean
from typing import TypeVar

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import are_apart, turned_round
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence import GUESSED
from tracker.images.sight import Sight
from tracker.synthesis import side_by_side
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.cycle_turn import advance, settled
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.hypotheses import beside_turned
from tracker.tracking.limb_probabilities import limbs_left_over
from tracker.tracking.loss import LossRule
from tracker.tracking.start import Hypothesis, Start, limbs_shown, surely_faces, sureness
from tracker.tracking.strangers import hide_strangers
from tracker.tracking.trajectory import Step

# Frames closer than this show hardly anything new.
_LEAST_GAP_S = 0.03
# So many frames in which all hypotheses are doubtful end a rehearsal: every limb of theirs is searched for in each. It
# took 97 of the 123 s of a first start without plates, to choose among three that are all wrong.
_HOPELESS_AFTER = 4
# So many frames tell who is beaten, and end a rehearsal where the best one is sure. In six of eight starts the best one
# was sure by then; it was also the best one after ten frames, and right in the five with a truth. See
# docs/lab/start_costs.md.
_TOLD_AFTER = 3
# A hypothesis that leaves over so many times as much in as many frames is dropped; a fifth less decides. In eight
# starts of six recordings twelve hypotheses met it, 0.18 to 0.6 m off.
_BEATEN = 1.5
# A lead that decides, see `start.sureness`. If all are doubtful and none has it, the first frame's ranking holds: the
# first pose of push-ups was 0.20 m off, the one by later frames 0.38; those of the man at his desk
# (docs/lab/upper_bodies.md) 0.02 to 0.13 m, and 0.27.
_DECIDES = 0.2

_Value = TypeVar("_Value")

Reopen = Callable[[], Iterator[Frame]]
"""Opens the frames of the sequence anew, from the first one."""


def rehearsed(start: Start, frame: Frame, scene: Scene, cycle: Cycle, reopen: Reopen) -> Start:
    """The start with the hypotheses of uncertain persons ranked by tracking them on.

    A silhouette looks the same from the front and from behind; elbows and knees bend one way only. A person who stands
    still gives no information, however long it takes. A given pose stays; if another one can be tracked better, the
    given one becomes unsure.

    Args:
        start: from the initialization.
        frame: of the start.
        scene: the persons and the rig.
        cycle: the components; its loss rule gives the number of frames, and the limit of uncertainty.
        reopen: opens the sequence anew.
    """
    if cycle.loss.rehearse == 0:
        return start
    start, known = _beside_turned_round(start, frame, scene, cycle), _all_known(frame, cycle)
    for k, sure in enumerate(start.sureness):
        if sure >= cycle.loss.sure or len(start.hypotheses[k]) < 2:
            continue
        ranking = _ranked(start, k, frame, scene, cycle, _following(frame, reopen, cycle.loss.rehearse))
        found = _sureness(ranking, known)
        pose = next((one.q for one in ranking if one.given), ranking[0].q)
        start = replace(
            start,
            poses=_with(start.poses, k, pose),
            hypotheses=_with(start.hypotheses, k, ranking),
            sureness=_with(start.sureness, k, found),
        )
    return start


def _beside_turned_round(start: Start, frame: Frame, scene: Scene, cycle: Cycle) -> Start:
    """The start with each person's best pose turned round among the hypotheses, and its lead as sureness.

    A coarse search's pose that faces the other way has limbs elsewhere, and loses because of these. See
    docs/lab/facing.md.
    """
    for k, sure in enumerate(start.sureness):
        body, ranking = scene.persons[k].body, start.hypotheses[k]
        if not ranking or not body.start.turn or any(one.given for one in ranking):
            continue
        turned = turned_round(body, ranking[0].q)
        both = beside_turned(frame, scene.with_poses(start.poses), k, turned, cycle.stages)
        mine, other = (next((one for one in both if one.given == given), None) for given in (True, False))
        if mine is None or other is None:
            continue
        start = replace(start, sureness=_with(start.sureness, k, min(sure, surely_faces(mine, other))))
        if all(are_apart(body, one.q, other.q) for one in ranking):
            start = replace(start, hypotheses=_with(start.hypotheses, k, (*ranking, other)))
    return start


def _all_known(frame: Frame, cycle: Cycle) -> bool:
    """Whether plates or masks are known everywhere."""
    return all(
        frame.mask(v) is not None or (plate is not None and plate.unknown is None)
        for v, plate in enumerate(cycle.plates)
    )


def _sureness(ranking: tuple[Hypothesis, ...], known: bool) -> float:
    """Sureness of the first hypothesis; if plates do not show limbs, multiplied by that of its worst limb."""
    return sureness(ranking) * (1.0 if known else limbs_shown(ranking[0]))


@dataclass(frozen=True)
class _Trial:
    """One hypothesis during the rehearsal."""

    hypothesis: Hypothesis
    scene: Scene
    state: State
    found: tuple[Estimate, ...]
    """Its estimates in all frames so far."""

    @property
    def left_over(self) -> float:
        """Mean left-over share."""
        return fmean(estimate.account.left_over for estimate in self.found)


def _ranked(
    start: Start, k: int, frame: Frame, scene: Scene, cycle: Cycle, following: Iterator[Frame]
) -> tuple[Hypothesis, ...]:
    """The hypotheses of person k with their mean left-over shares, the best one first."""
    # A hypothesis that is lost, or long in doubt, must not be rescued by a new bootstrapping: that pose would be judged
    # in its place. Without plates five of them took 215 of the 336 s that a start took.
    held = replace(cycle.loss, lost_below=0.0, least_views=0)
    cycle = replace(cycle, loss=held, seeks=False)

    def begun(one: Hypothesis) -> _Trial:
        return _begun(one, start, k, frame, scene, cycle)

    person, known, beaten = scene.persons[k], _all_known(frame, cycle), list[_Trial]()
    body = person.body
    trials = side_by_side(cycle.synthesis, begun, start.hypotheses[k])
    for n, later in enumerate(following, start=1):
        followed = f"{len(trials)} poses of {person.name} followed into frame {later.index}"
        cycle.progress(f"start: {followed}, {n} of {cycle.loss.rehearse} at most")

        def continued(trial: _Trial, later: Frame = later) -> _Trial:
            return _continued(trial, k, Sight(later, cycle.plates), cycle)

        trials = _different(side_by_side(cycle.synthesis, continued, trials), body)
        beaten += [trial for trial in trials if _beaten(trial, trials[0])]
        trials = [trial for trial in trials if not _beaten(trial, trials[0])]
        so_far = _in_order(*([_on_average(trial, body) for trial in those] for those in (trials, beaten)))
        if len(trials) > 1 and all(_hopeless(trial, held) for trial in trials):
            return so_far if _decided(so_far) else _as_begun(trials + beaten, start.hypotheses[k], body)
        if len(trials) == 1 or (n >= _TOLD_AFTER and _sureness(so_far, known) >= held.sure):
            break
    return _in_order(*([_on_average(trial, body) for trial in those] for those in (trials, beaten)))


def _decided(ranking: tuple[Hypothesis, ...]) -> bool:
    """Whether the first hypothesis leaves over so much less than the second that it is the right one."""
    return len(ranking) < 2 or ranking[0].left_over <= (1 - _DECIDES) * ranking[1].left_over


def _as_begun(trials: list[_Trial], begun: tuple[Hypothesis, ...], body: BodyModel) -> tuple[Hypothesis, ...]:
    """Hypotheses in the order of the beginning: frames in which all are in doubt do not decide."""
    places = {id(one): n for n, one in enumerate(begun)}
    ordered = sorted(trials, key=lambda trial: places[id(trial.hypothesis)])
    return tuple(_on_average(trial, body) for trial in ordered)


def _in_order(followed: list[Hypothesis], beaten: list[Hypothesis]) -> tuple[Hypothesis, ...]:
    """The best first; dropped ones keep their distance, because later frames may be harder."""
    least = _BEATEN * min(one.left_over for one in followed)
    behind = [replace(one, left_over=max(one.left_over, least)) for one in beaten]
    return tuple(sorted([*followed, *behind], key=lambda one: one.left_over))


def _different(trials: list[_Trial], body: BodyModel) -> list[_Trial]:
    """Those that leave over least first; of several at one pose the best, or the given one.

    Two right hypotheses with different arms at first left over 0.084 and 0.081, so that neither was sure: six more
    starts were searched, two minutes, though both had been the same for nine frames.
    """
    kept: list[_Trial] = []
    for trial in sorted(trials, key=lambda one: (not one.hypothesis.given, one.left_over)):
        if all(are_apart(body, trial.found[-1].q, other.found[-1].q) for other in kept):
            kept.append(trial)
    return sorted(kept, key=lambda one: one.left_over)


def _beaten(trial: _Trial, best: _Trial) -> bool:
    """Whether a hypothesis has left over so much more than the best one that later frames cannot change it."""
    return len(trial.found) > _TOLD_AFTER and trial.left_over > _BEATEN * best.left_over


def _hopeless(trial: _Trial, rule: LossRule) -> bool:
    """Whether a hypothesis was doubtful in all last frames, except the first one, in which no colours are known."""
    last = trial.found[1:][-_HOPELESS_AFTER:]
    return len(last) == _HOPELESS_AFTER and all(one.account.left_over > rule.doubtful_above for one in last)


def _on_average(trial: _Trial, body: BodyModel) -> Hypothesis:
    """The hypothesis with its explained and left-over shares in all frames, and its first tracked pose.

    The pose is that at the end of the first frame; a given pose stays as given. A leg beside its place was corrected
    before the pose was tracked on; when the run began at the old pose again, that leg was 0.11 m off in all frames, and
    nothing in doubt (docs/lab/rehearsed_pose.md).
    """
    accounts = [estimate.account for estimate in trial.found]
    limbs = [limbs_left_over(body, account) for account in accounts]
    return replace(
        trial.hypothesis,
        q=trial.hypothesis.q if trial.hypothesis.given else trial.found[0].q,
        distance_px=fmean(estimate.distance_px for estimate in trial.found),
        explained=fmean(account.explained for account in accounts),
        left_over=trial.left_over,
        limbs_left_over={limb: fmean(own[limb] for own in limbs) for limb in limbs[0]},
    )


def _begun(one: Hypothesis, start: Start, k: int, frame: Frame, scene: Scene, cycle: Cycle) -> _Trial:
    scene = scene.with_poses(start.poses).with_pose(k, one.q)
    sight = Sight(frame, cycle.plates)
    hide_strangers(sight, scene, cycle.synthesis)
    observed = cycle.evidence.observe(sight, cycle.synthesis.contours(scene), GUESSED)
    # Or the right one loses by limbs that are elsewhere: it left 0.42 over instead of 0.20.
    estimates, scene = settled(sight, scene, cycle, observed, Status.BOOTSTRAPPED, (k,))
    step = Step(frame, scene, estimates, cycle.synthesis.contours(scene))
    state = State.before(scene).after(sight, step, cycle.evidence, cycle.loss)
    return _Trial(one, scene, state, (estimates[k],))


def _continued(trial: _Trial, k: int, sight: Sight, cycle: Cycle) -> _Trial:
    step = advance(sight, trial.scene, cycle, trial.state)
    found = (*trial.found, step.estimates[k])
    return _Trial(trial.hypothesis, step.scene, trial.state.after(sight, step, cycle.evidence, cycle.loss), found)


def _following(frame: Frame, reopen: Reopen, n: int) -> Iterator[Frame]:
    """At most n frames after one, far enough apart."""
    last_s, left = frame.time_s, n
    for later in reopen():
        if left > 0 and later.index > frame.index and later.time_s - last_s >= _LEAST_GAP_S:
            last_s, left = later.time_s, left - 1
            yield later
        if left == 0:
            return


def _with(values: tuple[_Value, ...], k: int, value: _Value) -> tuple[_Value, ...]:
    return (*values[:k], value, *values[k + 1 :])
