"""Chooses evidence by the recording: foregrounds if there are plates or masks, else colours of the parts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.evidence import Evidence, EvidencePicture, Memory, Observed
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.motion import MotionEvidence
from tracker.evidence.regions import RegionEvidence
from tracker.evidence.silhouettes import SilhouetteEvidence
from tracker.evidence.together import TogetherEvidence
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.components import component
from tracker.images.plate import Plate
from tracker.images.sight import Sight
from tracker.kernels.descent import Kinds

WITHOUT_PLATES = "no background plates"
WHERE_NOBODY_STAYS = "foreground where nobody stays"
"""Its message if plates are absent, or unknown behind persons who stay."""

# A silhouette in one view alone shows no depth; see also `initialization.auto`.
_LEAST_VIEWS = 2
# Contours of a simulated person's own model leave over 0.6 px, those of real and rendered persons 1.5 to 1.9. If the
# model is exact, colours only repeat the outline that taught them: with contours at three times their weight joints of
# two simulations were 1.3 and 2.1 mm off instead of 2.0 and 3.3; at 0.6 and 1 persons whom the model does not fit were
# 1 to 4 mm worse.
_EXACT_PX = 1.2


@dataclass(frozen=True, eq=False)
class _Seen:
    """An observation, and its evidence."""

    by: Evidence
    observed: Observed


@component
class AutoEvidence(Evidence):
    """`with_plates` if two views or more have plates or masks, otherwise `without`.

    `partly` if a person stays before plates that the recording makes itself.
    """

    # See docs/lab/defaults_with_plates.md.
    with_plates: Evidence = TogetherEvidence(
        of=(ContourEvidence(), SilhouetteEvidence(), RegionEvidence(from_start=False), MotionEvidence()),
        ranking=(1.0, 1.0, 0.0, 0.0),
        refining=(0.3, 0.0, 1.0, 0.3),
        exact_px=(_EXACT_PX, 0.0, 0.0, 0.0),
    )
    """Evidence for views with plates or masks: contours and foregrounds rank poses, colours and contours refine them.
    Compared with contours alone in refinements, joints were better on all of eight recordings that started right, by 1
    to 14 mm, in less time, because fewer limbs are searched. Colours in the ranking gained nothing."""

    # See docs/lab/colours_alone.md.
    without: Evidence = TogetherEvidence(
        of=(ContourEvidence(), RegionEvidence(), MotionEvidence()),
        ranking=(0.3, 1.0, 0.0),
        refining=(0.3, 1.0, 0.3),
        exact_px=(_EXACT_PX, 0.0, 0.0),
    )
    """Evidence without plates. Contours count 0.3: with 1 all of four recordings are worse."""

    partly: Evidence = TogetherEvidence(
        of=(ContourEvidence(), SilhouetteEvidence(), RegionEvidence(), MotionEvidence()),
        ranking=(0.3, 0.3, 1.0, 0.0),
        refining=(0.3, 0.0, 1.0, 0.3),
        exact_px=(_EXACT_PX, 0.0, 0.0, 0.0),
    )
    """Evidence if plates show what is behind arms and legs, and hardly anything behind the trunk."""

    def check(self, scene: Scene) -> None:
        """Refuses what any of them refuses."""
        for one in (self.with_plates, self.without, self.partly):
            one.check(scene)

    def takes_part_plates(self) -> bool:
        """True, because `partly` is made for them."""
        return True

    def told(self, known: Sequence[object | None]) -> str:
        """Its choice; see `tracker.evidence.Evidence.told`."""
        views = f"{sum(one is not None for one in known)} of {len(known)} views have plates or masks"
        if any(isinstance(one, Plate) and one.recorded for one in known):
            views += ", which the recording itself has made"
        stays = any(isinstance(one, Plate) and one.stays for one in known)
        foreground = "" if not _enough(known) else f"{WHERE_NOBODY_STAYS}, " if stays else "foreground, "
        what = f"contours, {foreground}colours and motion of the parts"
        return f"{what}, {views}" if any(one is not None for one in known) else f"{what}, {WITHOUT_PLATES}"

    def look(self, sight: Sight, around: Contours) -> None:
        """Prepares the chosen evidence."""
        self._chosen(sight).look(sight, around)

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> _Seen:
        """Observation of the chosen evidence."""
        one = self._chosen(sight)
        return _Seen(one, one.observe(sight, expected, memory))

    def observe_again(self, asked: Comparison, q: Array) -> _Seen:
        """Repeated observation of the chosen evidence."""
        return _Seen(_by(asked), _by(asked).observe_again(_put(asked), q))

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) its distances, px."""
        return _by(asked).distances(_put(asked), poses)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Its equations."""
        return _by(asked).equations(_put(asked), q, gate_px)

    def kinds(self, asked: Comparison) -> Kinds | None:
        """Its compiled form, and the kinds that are called."""
        found = _by(asked).kinds(_put(asked))
        if found is None or not found.asked:
            return found
        return found._replace(asked=tuple(one._replace(ask=partial(_passed_on, one.ask)) for one in found.asked))

    def account(self, asked: Comparison, q: Array) -> Account:
        """Its account."""
        return _by(asked).account(_put(asked), q)

    def learned(self, memory: Memory, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask) -> Memory:
        """Its knowledge."""
        return self._chosen(sight).learned(memory, sight, scene, fitted, trusted)

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """Its pictures."""
        return _by(asked).pictures(_put(asked), sight, view)

    def _chosen(self, sight: Sight) -> Evidence:
        if sight.frame.masks or not any(plate is not None and plate.stays for plate in sight.plates):
            return self.with_plates if sight.frame.masks or _enough(sight.plates) else self.without
        return self.partly


def _enough(known: Sequence[object | None]) -> bool:
    return sum(one is not None for one in known) >= min(_LEAST_VIEWS, len(known))


def _by(asked: Comparison) -> Evidence:
    one: Evidence = asked.observed.by
    return one


def _passed_on(ask: Callable[..., Any], asked: Comparison, q: Array, gate_px: float) -> Any:
    """Answer of one of the chosen evidence's kinds."""
    return ask(_put(asked), q, gate_px)


def _put(asked: Comparison) -> Comparison:
    """The question for the chosen evidence."""
    return asked.put(asked.observed.observed)
