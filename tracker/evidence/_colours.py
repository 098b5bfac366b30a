"""What region evidence remembers: the colours inside and outside of every part, in every view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask, frozen
from tracker.kernels.regions import (
    EVEN,
    N_COLOURS,
    Looks,
    Picture,
    Samples,
    Tables,
    hides,
    learn_lines,
    tabulate_posteriors,
)

FLOOR = 2e-4
"""Share that a colour never seen has: one of 4096 bins by chance."""

_MOST_ODDS = 4.0
"""Bound on the logarithm of the odds of one pixel: no single one proves anything."""

_STRANGE, _ALIKE = 0.4, 0.5
"""A view's colours of a part are those of something else if their likeness to those in other views is below the first,
and below the second times that of the view most alike. A part hidden at the start: 60 mm without, 44 mm with."""

_LEAST_LEFT = 0.3
"""Share of a part's colours that must be its own for them to be kept."""

_BOTH_SIDES = 0.5
"""Likeness of the colours on both sides of a contour from which on one thing is before both."""


@dataclass(frozen=True)
class Colours:
    """Tables of a scene's parts; a frozen value."""

    tables: Tables
    posteriors: Image
    """(V, P, 4096) see `tabulate_posteriors`."""

    known: Mask
    """(V, P) parts whose inside was learnt in a view."""

    half_extents: Array
    """(P,) smaller half extent of each part across its axis, metres."""

    @staticmethod
    def none(n_views: int, shapes: Array) -> Colours:
        """Nothing learnt yet of parts with packed shapes (P, 7)."""
        layout = (n_views, len(shapes), N_COLOURS)
        inside, outside = (frozen(np.zeros(layout), np.float32) for _ in range(2))
        hiders: Array32 = frozen(np.zeros((n_views, N_COLOURS)), np.float32)
        known: Mask = frozen(np.zeros(layout[:2]), np.bool_)
        posteriors: Image = frozen(np.full(layout, EVEN), np.uint8)
        return Colours(Tables(inside, outside, hiders), posteriors, known, frozen(shapes[:, :2].min(axis=1)))

    @property
    def looks(self) -> Looks:
        """For the kernels."""
        return Looks(self.tables, self.posteriors, self.known, self.half_extents)

    def after(
        self,
        picture: Picture,
        samples: Samples,
        beside: Integers,
        cameras: Array,
        useful: Mask,
        spans: tuple[float, float],
    ) -> Colours:
        """The colours one frame on.

        Args:
            picture: colours seen.
            samples: contours of the scene at its estimated poses.
            beside: (V, M, 2) parts seen beside them.
            cameras: (V, 29) from `Rig.packed`.
            useful: (V, M) samples to learn from.
            spans: distance of places on a line, metres; weight of the frame in the running mean.
        """
        tables = Tables(*(values.copy() for values in self.tables))
        learning = picture, samples, beside, cameras, self.half_extents, useful, *spans, self.posteriors
        changed = learn_lines(*learning, tables)
        known = self.known | tables.inside.any(axis=2)
        changed |= corrected(tables, known & ~self.known, known)
        posteriors = self.posteriors.copy()
        tabulate_posteriors(tables, (FLOOR, _MOST_ODDS), changed, posteriors)
        for values in (*tables, posteriors, known):
            values.setflags(write=False)
        return Colours(tables, posteriors, known, self.half_extents)


def corrected(tables: Tables, fresh: Mask, known: Mask) -> Mask:
    """Takes out of colours learnt for the first time those of what hides the part.

    A part hidden at the start teaches the colours of what hides it, and they are unlike those in all other views: it
    gets the mean of those. What is then seen on both sides of its contour hides other parts of that view as well.

    Args:
        tables: in and out.
        fresh: (V, P) learnt in this frame for the first time.
        known: (V, P) learnt at all.

    Returns:
        (V, P) parts whose colours, or those of what hides them, were changed.
    """
    inside, changed = tables.inside, np.zeros_like(fresh)
    for p in np.flatnonzero(fresh.any(axis=0)):
        views = np.flatnonzero(known[:, p])
        if len(views) < 3:
            # Of two that differ nobody knows which is right.
            continue
        roots = np.sqrt(inside[views, p])
        coefficients = roots @ roots.T
        alike = (coefficients.sum(axis=1) - np.diag(coefficients)) / (len(views) - 1)
        strange = (alike < _STRANGE) & (alike < _ALIKE * alike.max()) & fresh[views, p]
        for v in views[strange]:
            if np.sqrt(inside[v, p]) @ np.sqrt(tables.outside[v, p]) > _BOTH_SIDES:
                np.maximum(tables.hiders[v], inside[v, p], out=tables.hiders[v])
                changed[v] = True
        if strange.any():
            inside[views[strange], p] = inside[views[~strange], p].mean(axis=0)
            changed[views[strange], p] = True
    for v, p in np.argwhere(fresh & changed):
        others = np.flatnonzero(known[:, p] & (np.arange(len(known)) != v))
        if len(others):
            _take_out(tables.hiders[v], inside[others, p].mean(axis=0), inside[v, p])
    return changed


def _take_out(hider: Array32, elsewhere: Array32, table: Array32) -> None:
    """Takes the colours of what hides a part out of its table (4096,); those it has elsewhere stay."""
    table[hides(hider, elsewhere)] = 0
    left = table.sum()
    if left < _LEAST_LEFT:
        table[:] = elsewhere
    else:
        table /= left
