"""Lengths of things that are moved before cameras: those given in another unit than metres are told."""

from __future__ import annotations

_UNITS = {"mm": 0.001, "cm": 0.01, "inches": 0.0254}
"""Units in which people measure boards and bars, metres each."""


def square_fault(length_m: float) -> str | None:
    """Why the side of a board's square, or of its marker, cannot be so many metres; None if it can."""
    return _fault(length_m, 0.004, 0.5, "a square of a board")


def bar_fault(length_m: float) -> str | None:
    """Why a bar that somebody carries cannot be so many metres long; None if it can."""
    return _fault(length_m, 0.1, 10.0, "a bar")


def _fault(length_m: float, least_m: float, most_m: float, thing: str) -> str | None:
    """That a thing is longer than `most_m`, with what it would be in other units, not below `least_m`."""
    if length_m <= most_m:
        return None
    offers = [
        f"{length_m * unit:.6g} if {length_m:g} {name} are meant"
        for name, unit in _UNITS.items()
        if least_m <= length_m * unit <= most_m
    ]
    expected = f"expected metres, {most_m:g} at most"
    return f"{thing} is not {length_m:g} m long, {': '.join(filter(None, [expected, ', '.join(offers)]))}"
