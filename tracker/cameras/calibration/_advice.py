"""What to do better: words for weak spots of a calibration."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tracker.cameras.calibration._adjustment import Adjustment
from tracker.cameras.calibration._determinability import Held
from tracker.foundation.arrays import Integers

_ROWS, _COLUMNS = ("upper", "middle", "lower"), ("left", "central", "right")
# Above 0.98, the variance of one parameter is more than 25 times what it would be with the other one known.
_CORRELATED = 0.98
# With twice the standard error, four times as many corners tell as much.
_BELONGING = 2.0


def coverage(adjustment: Adjustment, view: int) -> Integers:
    """(3, 3) number of images of targets in each ninth of a view."""
    width, height = adjustment.sizes[view]
    pixels = adjustment.observations.pixels[adjustment.used & (adjustment.observations.views == view)]
    columns = np.clip((3 * (pixels[:, 0] + 0.5) / width).astype(int), 0, 2)
    rows = np.clip((3 * (pixels[:, 1] + 0.5) / height).astype(int), 0, 2)
    counts = np.bincount(3 * rows + columns, minlength=9)
    return counts.reshape(3, 3).astype(np.int64)


def advice(adjustment: Adjustment, what: str, n_objects: int) -> tuple[str, ...]:
    """Sentences about what a better recording would do.

    Args:
        adjustment: the calibration.
        what: the thing moved, for instance `bar`.
        n_objects: how many positions of it were used.
    """
    return (*_about_views(adjustment, what), *_about_all(adjustment, what, n_objects))


def _about_views(adjustment: Adjustment, what: str) -> Iterator[str]:
    noises = [adjustment.rms_px(v) for v in range(len(adjustment.names))]
    for v, name in enumerate(adjustment.names):
        mine = adjustment.observations.views == v
        empty = [region(row, column) for row, column in zip(*np.nonzero(coverage(adjustment, v) == 0), strict=True)]
        if empty:
            yield f"camera {name} saw no {what} in its {listed(empty)} third: move it there; distortion is a guess"
        rejected = float(1 - adjustment.used[mine].mean())
        if rejected > 0.15:
            yield f"camera {name}: {100 * rejected:.0f} % of its images were gross errors: look at its picture"
        if len(noises) > 2 and noises[v] > 2 * float(np.median(noises)):
            yield (
                f"camera {name} fits with {noises[v]:.2f} px, the others with {np.median(noises):.2f} px: is it in "
                "focus, fixed, and not moved during the recording?"
            )


def _why(held: Held) -> str:
    if held.turns_back_px is not None:
        return f"with it the lens turns back {held.turns_back_px:.0f} px from the centre, inside the image"
    return f"{held.correlation:+.2f} with {held.partner}"


def _about_all(adjustment: Adjustment, what: str, n_objects: int) -> Iterator[str]:
    if n_objects < 50:
        yield f"{n_objects} positions of the {what} are few: 100 to 200 that fill the volume are better"
    for name in adjustment.names:
        held = [entry for entry in adjustment.held if entry.camera == name]
        if held:
            words = [f"{entry.parameter} ({_why(entry)})" for entry in held]
            yield (
                f"camera {name}: {listed(words)} cannot be determined from this recording, so the usual value was "
                f"kept: record the {what} at more depths, directions and corners"
            )
    interesting = [entry for entry in adjustment.correlations(_CORRELATED) if not _expected(entry[1], entry[2])]
    for value, first, second in interesting[:5]:
        yield f"{first} and {second} are correlated by {value:+.3f}: tilted and nearer positions would part them"
    if adjustment.bent_m > 0:
        yield (
            f"corners of the board seem to be up to {1000 * adjustment.bent_m:.2g} mm from where they should be: glue "
            "it to something flat and measure its squares; the standard errors count that"
        )
    if adjustment.inflation > _BELONGING:
        yield (
            f"residuals of a picture belong together: standard errors are {adjustment.inflation:.1f} times those of "
            "independent ones; hold the board still against blur, and record more positions"
        )
    if adjustment.s0 > 2:
        yield (
            f"the images are {adjustment.s0:.1f} times as noisy as assumed ({adjustment.sigma_px:g} px): state "
            "sigma_px as it is, or look for blur, motion and cameras out of step"
        )


def _expected(first: str, second: str) -> bool:
    """Radial terms are always correlated with one another, and so are shifts of a principal point and turns."""
    placing = ("rotation", "centre", "principal point", "camera constant", "decentring")
    placed = all(any(word in name for word in placing) for name in (first, second))
    return placed or ("radial" in first and "radial" in second)


def region(row: int, column: int) -> str:
    """A ninth of an image in words."""
    return "centre" if row == column == 1 else f"{_ROWS[row]} {_COLUMNS[column]}"


def listed(words: list[str]) -> str:
    """`a, b and c`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
