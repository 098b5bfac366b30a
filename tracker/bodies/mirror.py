"""What of a body mirrors what: the words of its two sides, and the plane between them."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass

Side = tuple[str, str]


@dataclass(frozen=True)
class Mirror:
    """The symmetry of a body: names that differ in the word of a side only are a pair."""

    sides: Side = ("left", "right")
    """Words in names, between underscores: `left_thigh` and `right_thigh`, `front_left_paw` and `front_right_paw`."""

    across: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Normal of the plane of symmetry, which goes through the origin of the reference pose."""

    def of(self, name: str) -> str:
        """The name of the other side's part, parameter or landmark; the same name on the midline."""
        one, other = self.sides
        swapped = {one: other, other: one}
        return "_".join(swapped.get(word, word) for word in name.split("_"))

    def meant(self, name: str, names: Iterable[str]) -> list[str]:
        """Which of the names one stands for: itself, or both sides' where the word of the side is left out."""
        valid = tuple(names)
        if name in valid:
            return [name]
        found = [own for own in valid if name == _without(own, self.sides)]
        return sorted(found, key=lambda own: self.sides[1] in own.split("_"))


@functools.lru_cache(maxsize=4096)
def _without(name: str, sides: Side) -> str:
    """A name without the word of a side. Bodies made anew in a fit ask for the same ones again: a tenth of its time."""
    return "_".join(word for word in name.split("_") if word not in sides)
