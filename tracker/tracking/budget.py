"""When another search is worth its time: after each one in vain the wait is longer."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Tries:
    """Searches for a person, or for a limb, that is in doubt."""

    vain: int = 0
    """Searches one after the other that have not ended the doubt."""

    frames: int = 0
    """Frames since the last one; without one, since the doubt began."""

    share: float = 0.0
    """Of a limb: what the last search in vain has left over."""

    def due(self, wait: int, first: int = 0, growth: int = 2, most: int = 1 << 30) -> bool:
        """Whether it is time for the next search.

        Args:
            wait: frames after the first search in vain.
            first: frames before the first search.
            growth: how many times as long the wait is after each further search in vain.
            most: most frames.
        """
        return self.frames >= (min(wait * growth ** (self.vain - 1), most) if self.vain else first)

    def after(self, searched: bool, share: float = 0.0) -> Tries:
        """One frame on, in which doubt is left, and what is left over of a limb that was searched."""
        return Tries(self.vain + 1, 1, share) if searched else replace(self, frames=self.frames + 1)
