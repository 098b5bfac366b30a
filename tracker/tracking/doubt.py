"""The reasons of doubt: a closed list; each decision gives its reason; see docs/doubt.md."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from tracker.foundation.errors import SequenceError


class Because(StrEnum):
    """A reason: its word in tables, its phrase, and the unit of its value and limit."""

    phrase: str
    """Phrase for a line of text, behind the name of a limb or a person."""

    unit: str
    """`%` for a share, `m`, `px`, or empty for a number of things."""

    def __new__(cls, word: str, phrase: str = "", unit: str = "") -> Because:
        """A member of the list."""
        member = str.__new__(cls, word)
        member._value_, member.phrase, member.unit = word, phrase, unit
        return member

    NOT_FOUND = "not_found", "nobody was found"
    UNEXPLAINED = "unexplained", "too little of the contour lies on edges of the images", "%"
    FEW_VIEWS = "few_views", "too few views show it"
    SAME_PLACE = "same_place", "another person stands in the same place", "%"
    LEFT_OVER = "left_over", "model and images leave over too much of each other's contour", "%"
    UNSURE_START = "unsure_start", "the start is more likely wrong than right, and no frame has confirmed it", "%"
    IMPROBABLE = "improbable", "it is more likely elsewhere than at its place", "%"
    TWO_POSES = "two_poses", "two poses explain the images almost equally well", "px"
    JUMP = "jump", "it jumps from one frame to another", "m"
    UNTOLD = "untold", "an older version of the program kept no reason"
    BRIDGED = "bridged", "an older version interpolated it across frames in which it was not found", "m"
    MOST_LIMBS = "most_limbs", "an older version found that most limbs may be elsewhere"
    IMPRECISE = "imprecise", "an older version found that the images hardly show the place of a joint", "m"
    HARDLY_SEEN = "hardly_seen", "an older version kept only that the images show little of it"


_LOSING = frozenset((Because.NOT_FOUND, Because.UNEXPLAINED, Because.FEW_VIEWS, Because.SAME_PLACE))
_VAGUE = frozenset((Because.IMPROBABLE, Because.TWO_POSES, Because.IMPRECISE, Because.HARDLY_SEEN))


@dataclass(frozen=True)
class Doubt:
    """One reason why a person's pose, or a limb of it, may be wrong; its estimate belongs to the person."""

    limb: str
    """Parameter group, for instance `left_arm`; empty for the person as a whole."""

    because: Because
    value: float | None = None
    """Measured value, as a share, in metres or px, or a number; None without a measurement."""

    limit: float | None = None
    """Its limit."""

    @property
    def loses(self) -> bool:
        """Whether the person is lost because of it."""
        return not self.limb and self.because in _LOSING

    @property
    def vague(self) -> bool:
        """Whether nothing contradicts the limb, but the images show little of its place."""
        return self.because in _VAGUE

    @property
    def measured(self) -> str:
        """Value and limit in words: `41 %, limit 30 %`; empty without a measurement."""
        if self.value is None or self.limit is None:
            return ""
        return f"{self._in_units(self.value)}, limit {self._in_units(self.limit)}"

    def _in_units(self, value: float) -> str:
        if self.because.unit == "%":
            return f"{100 * value:.0f} %"
        return f"{value:.2f} {self.because.unit}" if self.because.unit else f"{value:g}"

    @property
    def where(self) -> str:
        """The limb in words, or `whole body`."""
        return self.limb.replace("_", " ") or "whole body"

    def as_row(self) -> list[str | float | None]:
        """The doubt as a journal keeps it."""
        return [self.limb, str(self.because), self.value, self.limit]

    @staticmethod
    def of_row(row: list[str | float | None]) -> Doubt:
        """The inverse of `as_row`.

        Raises:
            SequenceError: a number that is not finite. ValueError, TypeError: not such a row.
        """
        limb, because, *numbers = row
        value, limit = (None if number is None else float(number) for number in numbers)
        if not all(math.isfinite(number) for number in (value, limit) if number is not None):
            raise SequenceError("a doubt whose numbers are not finite")
        return Doubt(str(limb), Because(str(because)), value, limit)


def in_words(doubts: Iterable[Doubt]) -> str:
    """Doubts in a line: `left arm, left leg: two poses explain the images almost equally well`; empty without any."""
    limbs: dict[Because, list[str]] = {}
    for doubt in doubts:
        limbs.setdefault(doubt.because, []).append(doubt.where)
    return "; ".join(f"{', '.join(names)}: {because.phrase}" for because, names in limbs.items())
