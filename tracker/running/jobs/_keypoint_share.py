"""What keypoints changed in a run: whose start was theirs, and of which limbs they decided the verdict."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from tracker.bodies.scene import Scene
from tracker.evidence import Evidence
from tracker.evidence.keypoints import KeypointEvidence, ObservedKeypoints
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.together import TogetherEvidence
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.limb_probabilities import limbs_left_over
from tracker.tracking.trajectory import Step

_MOST_NAMED = 4
"""Limbs that are named in a line."""


class KeypointShare:
    """The frames of a run so far, with what their accounts would be without the keypoints' part."""

    def __init__(self, evidence: Evidence, doubt_above: float) -> None:
        """Nothing is counted yet.

        Args:
            evidence: of the run.
            doubt_above: share of a limb's contour that is left over, from which on the run doubts it.
        """
        self._doubt_above, self._n_frames, self._started = doubt_above, 0, ""
        self._held, self._doubted = Counter[str](), Counter[str]()
        self._frames: dict[str, set[int]] = {"held": set(), "doubted": set()}
        self._keypoints, self._share = _part_of(evidence)

    def kept(self, steps: Iterable[Step]) -> Iterator[Step]:
        """The frames of a run as they come."""
        for step in steps:
            self._add(step)
            yield step

    def told(self) -> str:
        """What keypoints changed, in a sentence; empty where the run has none."""
        if self._keypoints is None or not self._n_frames:
            return ""
        parts = [self._started] if self._started else []
        parts.append(
            f"without them {_limbs(self._held, len(self._frames['held']), self._n_frames)} would be in doubt"
            if self._held
            else "no limb would be in doubt for want of them"
        )
        if self._doubted:
            parts.append(
                f"{_limbs(self._doubted, len(self._frames['doubted']), self._n_frames)} are in doubt by them alone"
            )
        return f"keypoints: {'; '.join(parts)}"

    def _add(self, step: Step) -> None:
        if self._keypoints is None:
            return
        self._n_frames += 1
        if step.start is not None and not self._started:
            self._started = (
                f"the start in frame {step.frame.index} is {'' if step.start.by_keypoints else 'not '}theirs"
            )
        missing = set(step.frame.missing)
        seen = tuple(v not in missing for v in range(len(step.scene.rig)))
        blank = replace(step.frame, images=(None,) * len(seen), masks=())
        observed = ObservedKeypoints(blank, seen)
        scene = step.scene.with_poses(tuple(one.q for one in step.estimates))
        for k, estimate in enumerate(step.estimates):
            if not estimate.lost:
                own = self._keypoints.account(Comparison(scene, k, CpuSynthesis(), observed), estimate.q)
                self._count(step.frame.index, scene, k, estimate.account, own)

    def _count(self, frame: int, scene: Scene, k: int, account: Account, own: Account) -> None:
        if not own.visible_px.any() or not account.visible_px.any():
            return
        person = scene.persons[k]
        both = limbs_left_over(person.body, account)
        images = limbs_left_over(person.body, _without(account, own, self._share))
        for limb in person.body.limbs:
            name = limb if len(scene.persons) == 1 else f"{person.name}'s {limb}"
            if both[limb] <= self._doubt_above < images[limb]:
                self._held[name] += 1
                self._frames["held"].add(frame)
            elif images[limb] <= self._doubt_above < both[limb]:
                self._doubted[name] += 1
                self._frames["doubted"].add(frame)


def _part_of(evidence: Evidence) -> tuple[KeypointEvidence | None, float]:
    """The keypoints among a run's evidence, and their share of its accounts; None where they are none of several."""
    if isinstance(evidence, TogetherEvidence):
        for one, weight in zip(evidence.of, evidence.refining, strict=True):
            if isinstance(one, KeypointEvidence) and 0 < weight < sum(evidence.refining):
                return one, weight / sum(evidence.refining)
    return None, 0.0


def _without(account: Account, own: Account, share: float) -> Account:
    """An account without the part of one kind of evidence; see `tracker.evidence.measures.account.summed`."""
    visible = np.maximum(account.visible_px - share * own.visible_px, 0.0) / (1 - share)
    explained = np.clip(account.explained_px - share * own.explained_px, 0.0, None) / (1 - share)
    missed = np.maximum(account.missed_px - share * own.missed_px, 0.0) / (1 - share)
    return replace(account, visible_px=visible, explained_px=np.minimum(explained, visible), missed_px=missed)


def _limbs(counted: Counter[str], n_frames: int, n_all: int) -> str:
    named = [f"{limb} {n}" for limb, n in counted.most_common(_MOST_NAMED)]
    more = len(counted) - len(named)
    others = f" and {more} more" if more else ""
    n = sum(counted.values())
    return f"{n} limb{'s' * (n > 1)} in {n_frames} of {n_all} frames ({', '.join(named)}{others})"
