"""When another search is worth its time: the wait grows after each one in vain."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Tries:
    """Searches for a doubtful person or limb."""

    vain: int = 0
    """Consecutive searches that have not ended the doubt."""

    frames: int = 0
    """Frames since the last search; without one, since the doubt began."""

    share: float = 0.0
    """Left-over share after the last search in vain, for a limb."""

    def due(self, wait: int, first: int = 0, growth: int = 2, most: int = 1 << 30) -> bool:
        """Whether the next search is due.

        Args:
            wait: frames after the first search in vain.
            first: frames before the first search.
            growth: factor of the wait after each further search in vain.
            most: largest wait, frames.
        """
        return self.frames >= (min(wait * growth ** (self.vain - 1), most) if self.vain else first)

    def after(self, searched: bool, share: float = 0.0) -> Tries:
        """The searches after another frame with doubt, and the left-over share of a searched limb."""
        return Tries(self.vain + 1, 1, share) if searched else replace(self, frames=self.frames + 1)
