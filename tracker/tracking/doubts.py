"""A run's doubts about its own result: in which frames, and where to look."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

from tracker.bodies.scene import Person
from tracker.evidence.measures.account import hidden_limbs
from tracker.tracking.doubt import Because
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.start import RATHER_RIGHT
from tracker.tracking.trajectory import Step

# More ranges, and more reasons, than this in one line are not read.
_MOST_RANGES, _MOST_REASONS = 4, 4

_APART_S = 0.25
"""Least time between frames of a list: one bad moment is one entry."""


class Judged(NamedTuple):
    """Reliability of a person's pose in a frame."""

    status: str
    n_ambiguous: int
    """Number of limbs that may be elsewhere."""

    explained: float
    """Explained share of the visible contour."""


def worst_first(
    times_s: Sequence[float], judged: Sequence[Sequence[Judged]], n_most: int = 12
) -> list[tuple[int, int]]:
    """Frames to check, the worst first: lost, doubtful, with ambiguous limbs, then least explained.

    Args:
        times_s: (T,) seconds.
        judged: (T, P) all persons in all frames.
        n_most: largest number.

    Returns:
        Positions of frame and person; those of one person lie some time apart.
    """
    grave: dict[str, int] = {Status.LOST: 0, Status.DOUBTFUL: 1}
    ranked = sorted(
        (grave.get(one.status, 2), -one.n_ambiguous, one.explained, t, k)
        for t, row in enumerate(judged)
        for k, one in enumerate(row)
    )
    chosen: list[tuple[int, int]] = []
    for _, _, _, t, k in ranked:
        near = any(abs(times_s[t] - times_s[other]) < _APART_S for other, who in chosen if who == k)
        if not near and len(chosen) < n_most:
            chosen.append((t, k))
    return chosen


_MOST_DOUBTED = 0.6
"""Share of frames in doubt from which on the run asks about the input. A woman hidden by a passer-by and a board,
tracked 8 mm off, has at most 0.58, counting single limbs as well; with cupboards before the person in two of four
views, in wrong poses, it is 0.9 to 1."""


@dataclass(frozen=True)
class Doubts:
    """Frames that need a check before use."""

    n_frames: int = 0
    n_views: int = 0
    """Names of the rig's views."""

    lost: tuple[int, ...] = ()
    """Numbers of the frames in which a person is lost."""

    doubtful: tuple[int, ...] = ()
    """Numbers of the frames in which a person is doubtful, and none is lost."""

    persons: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Of several persons, the lost or doubtful one -> frames."""

    ambiguous: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Limb, with the person's name if there are several -> frames in which it may be elsewhere."""

    untrusted: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """View -> frames in which its foreground was not used."""

    missing: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """View -> frames without an image of it."""

    hidden: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Limb, and the view that something hides it from -> frames. Others show it: information, not a doubt."""

    strangers: tuple[int, ...] = ()
    """Frames in which another person is beside the tracked ones. Information, not a doubt."""

    turned_round: tuple[str, ...] = ()
    """Persons whose given start pose fits less well than the same turned round."""

    unfaced: bool = False
    """Whether persons were found by two cameras alone that face each other, see `Step.may_face_the_other_way`."""

    confidences: Mapping[str, float] = field(default_factory=dict)
    """Person found in the first start -> share of such starts that are right, see `start.confidence`."""

    found: frozenset[str] = frozenset()
    """Names of the persons found so far."""

    grave: tuple[int, ...] = ()
    """Frames in which more than a single limb of a person is in doubt, or a person who has come in is lost."""

    n_before: int = 0
    """Frames at the beginning without persons: all are lost."""

    why_unfound: str = ""
    """Why no person was found in the last searched frame."""

    n_in_doubt: int = 0
    """Frames with a lost or doubtful person, or an ambiguous limb."""

    reasons: Mapping[tuple[str, Because], int] = field(default_factory=dict)
    """Limb, or `lost` or `doubtful`, with the person's name if there are several, and the reason -> frames."""

    def after(self, step: Step) -> Doubts:
        """The doubts one frame on."""
        frame, names = step.frame.index, step.scene.rig.names
        verdicts = {estimate.verdict for estimate in step.estimates}
        pairs = list(zip(step.scene.persons, step.estimates, strict=True))
        found = self.found | {person.name for person, one in pairs if not one.lost}
        turned = () if step.start is None else step.start.turned_round
        lost, doubtful = Status.LOST in verdicts, Status.DOUBTFUL in verdicts and Status.LOST not in verdicts
        return Doubts(
            n_frames=self.n_frames + 1,
            n_views=len(names),
            lost=(*self.lost, frame) if lost else self.lost,
            doubtful=(*self.doubtful, frame) if doubtful else self.doubtful,
            persons=_with(self.persons, frame, _persons_in_doubt(step)),
            ambiguous=_with(self.ambiguous, frame, _limbs_in_doubt(step)),
            untrusted=_with(self.untrusted, frame, (names[v] for v in step.untrusted)),
            missing=_with(self.missing, frame, (names[v] for v in step.frame.missing)),
            hidden=_with(self.hidden, frame, _hidden(step)),
            strangers=(*self.strangers, frame) if step.strangers else self.strangers,
            turned_round=(*self.turned_round, *(step.scene.persons[k].name for k in turned)),
            unfaced=self.unfaced or step.may_face_the_other_way,
            confidences=self.confidences or _by_name(step),
            found=found,
            grave=(*self.grave, frame) if any(_is_grave(one, who.name in found) for who, one in pairs) else self.grave,
            n_before=self.n_before + (not found),
            why_unfound=step.why_unfound or self.why_unfound,
            n_in_doubt=self.n_in_doubt + any(one.doubts for one in step.estimates),
            reasons=dict(Counter(self.reasons) + Counter(reasons_in(step))),
        )

    @property
    def none(self) -> bool:
        """Whether there is nothing to check."""
        starts = self.turned_round or self.unfaced or self.unlikely
        return not (self.lost or self.doubtful or self.ambiguous or starts)

    @property
    def nobody(self) -> bool:
        """Whether every person is lost in every frame."""
        return self.n_frames > 0 and not self.found

    @property
    def unlikely(self) -> tuple[str, ...]:
        """Persons whose start is more likely wrong than right, except those with a warning about their given pose."""
        told = self.turned_round
        return tuple(who for who, sure in self.confidences.items() if sure < RATHER_RIGHT and who not in told)

    def advice(self) -> str:
        """Advice if more is in doubt than a single limb; empty otherwise.

        A person who has not come in yet is in no doubt, and frames before the first person do not count. One limb alone
        does not count either: an arm that no view shows well may be ambiguous throughout, and the rest exact.
        """
        n_frames = self.n_frames - self.n_before
        if len(self.grave) <= _MOST_DOUBTED * n_frames:
            return ""
        few = ", or film with more cameras: two are few" if self.n_views == 2 else ""
        return (
            f"{len(self.grave)} of {n_frames} frames in doubt are more than hard movement causes: look at the overlay; "
            "begin at another frame (reading.start) if the first pose is wrong, paint furniture before the person "
            "(reading.occluders), check stature, model and calibration, and whether views are exchanged" + few
        )

    def sentence(self) -> str:
        """One line for the terminal: how many frames, which limbs, where to look."""
        unused = [f"foreground of {view} not used in {len(f)}{_where(f)}" for view, f in sorted(self.untrusted.items())]
        unused += [f"{view} missing in {len(f)}{_where(f)}" for view, f in sorted(self.missing.items())]
        unused += [f"{limb} in {len(f)}{_where(f)}" for limb, f in sorted(self.hidden.items())]
        if self.strangers:
            unused.append(f"another person beside in {len(self.strangers)}{_where(self.strangers)}")
        if self.none:
            return "; ".join([f"no frame of {self.n_frames} lost, doubtful or with an ambiguous limb", *unused])
        found = [f"{name} may be turned round from the given start on" for name in self.turned_round]
        if self.unfaced:
            found.append("the two cameras face each other and do not tell who faces where")
        found += [
            f"{name}'s start pose is more likely wrong than right (confidence {self.confidences[name]:.2f})"
            for name in self.unlikely
        ]
        whole = [f"{who} in {len(frames)}{_where(frames)}" for who, frames in sorted(self.persons.items())]
        if not whole:
            whole.append(f"{len(self.lost)} lost{_where(self.lost)}")
            whole += [f"{len(self.doubtful)} doubtful{_where(self.doubtful)}"] if self.doubtful else []
        found.append(f"of {self.n_frames} frames {', '.join(whole)}")
        for limb, frames in sorted(self.ambiguous.items(), key=lambda item: -len(item[1])):
            found.append(f"{limb} ambiguous in {len(frames)}{_where(frames)}")
        if self.why_unfound and not self.found:
            found.append(f"nobody was found: {self.why_unfound}")
        return "; ".join([", ".join(found), *unused])

    def why(self) -> str:
        """The last line for the terminal: the commonest reasons, each with its limb or person and number of frames."""
        if not self.reasons:
            return ""
        ranked = sorted(self.reasons.items(), key=lambda item: (-item[1], item[0]))
        told = [f"{n} {what}: {because.phrase}" for (what, because), n in ranked[:_MOST_REASONS]]
        more = ", ..." if len(ranked) > len(told) else ""
        return f"{self.n_in_doubt} of {self.n_frames} frames in doubt: {', '.join(told)}{more}"


def reasons_in(step: Step) -> Iterator[tuple[str, Because]]:
    """Doubtful limbs and persons of a frame, with the reasons."""
    for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
        alone = len(step.estimates) == 1
        for doubt in estimate.reasons:
            whole = str(estimate.verdict) if alone else f"{person.name} {estimate.verdict}"
            yield _of(step, person, doubt.where) if doubt.limb else whole, doubt.because


def _with(told: Mapping[str, tuple[int, ...]], frame: int, names: Iterable[str]) -> dict[str, tuple[int, ...]]:
    """A message, and the frame for each of the names."""
    return {**told, **{name: (*told.get(name, ()), frame) for name in names}}


def _by_name(step: Step) -> dict[str, float]:
    """Confidences in a frame with a start; empty elsewhere."""
    return {person.name: sure for person, sure in zip(step.scene.persons, step.start_confidence, strict=False)}


def _persons_in_doubt(step: Step) -> Iterator[str]:
    """The lost or doubtful of several persons in a frame."""
    for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
        if len(step.estimates) > 1 and estimate.verdict in (Status.LOST, Status.DOUBTFUL):
            yield f"{person.name} {estimate.verdict}"


def _limbs_in_doubt(step: Step) -> Iterator[str]:
    """Ambiguous limbs in a frame, with the person's name if there are several."""
    for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
        for group in () if estimate.lost else estimate.ambiguous:
            yield _of(step, person, group.replace("_", " "))


def _hidden(step: Step) -> Iterator[str]:
    """Limbs that something hides in a view of a frame."""
    for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
        for v, group in hidden_limbs(person.body, estimate.account):
            yield f"{_of(step, person, group.replace('_', ' '))} hidden from {step.scene.rig.names[v]}"


def _of(step: Step, person: Person, what: str) -> str:
    return f"{person.name}'s {what}" if len(step.estimates) > 1 else what


def _is_grave(estimate: Estimate, has_come_in: bool) -> bool:
    """Whether more than a single limb of a person is in doubt."""
    return has_come_in if estimate.lost else estimate.doubtful or len(estimate.ambiguous) > 1


def _where(frames: tuple[int, ...]) -> str:
    """` (frames 3-17, 40, ...)`, ` (frame 4)`; empty without frames."""
    if not frames:
        return ""
    parts = [f"{first}-{last}" if last > first else str(first) for first, last in ranges(frames)]
    more = ", ..." if len(parts) > _MOST_RANGES else ""
    return f" ({'frame' if len(frames) == 1 else 'frames'} {', '.join(parts[:_MOST_RANGES])}{more})"


def ranges(frames: Iterable[int]) -> list[tuple[int, int]]:
    """First and last of each run of successive numbers, in order."""
    numbers = sorted(frames)
    breaks = [0, *(k + 1 for k, (one, other) in enumerate(pairwise(numbers)) if other > one + 1), len(numbers)]
    return [(numbers[first], numbers[end - 1]) for first, end in pairwise(breaks) if end > first]
