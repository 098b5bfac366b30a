"""Lengths of things that are moved before cameras: those given in another unit than metres are told."""

from __future__ import annotations

from tracker.foundation.lengths import METRES_PER_UNIT

_UNITS = {"mm": "mm", "cm": "cm", "in": "inches"}
"""Units in which people measure boards and bars, and how they call them."""

_SHORTEST = 0.15
"""Focal length as a share of an image's longer side below which no pinhole lens is: 147 degrees wide."""


def square_fault(length_m: float) -> str | None:
    """Why the side of a board's square, or of its marker, cannot be so many metres; None if it can."""
    return _fault(length_m, (0.004, 0.25), 0.5, "a square of a board")


def bar_fault(length_m: float) -> str | None:
    """Why a bar that somebody carries cannot be so many metres long; None if it can."""
    return _fault(length_m, (0.1, 5.0), 10.0, "a bar")


def focal_fault(focal_px: float, view: str, size: tuple[int, int]) -> str | None:
    """Why no lens of a view has such a focal length, px; None if one may have."""
    least = _SHORTEST * max(size)
    if focal_px >= least:
        return None
    return (
        f'focal_px = {focal_px:g} for view "{view}", expected at least {least:.0f} for {size[0]}x{size[1]} px: of a '
        "focal length in mm, it is that length times the image's width in px over the sensor's width in mm"
    )


def _fault(length_m: float, usual_m: tuple[float, float], most_m: float, thing: str) -> str | None:
    """That a thing is longer than `most_m`, with what it would be in other units where that is usual."""
    if length_m <= most_m:
        return None
    offers = [
        f"{length_m * METRES_PER_UNIT[unit]:.6g} if {length_m:g} {name} are meant"
        for unit, name in _UNITS.items()
        if usual_m[0] <= length_m * METRES_PER_UNIT[unit] <= usual_m[1]
    ]
    expected = f"expected metres, {most_m:g} at most"
    return f"{thing} is not {length_m:g} m long, {': '.join(filter(None, [expected, ', '.join(offers)]))}"
