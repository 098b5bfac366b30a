"""Units of length, as files and people name them."""

from __future__ import annotations

METRES_PER_UNIT = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""By their signs."""

_WORDS = {
    "m": ("meter", "meters", "metre", "metres"),
    "dm": ("decimeter", "decimeters", "decimetre", "decimetres"),
    "cm": ("centimeter", "centimeters", "centimetre", "centimetres"),
    "mm": ("millimeter", "millimeters", "millimetre", "millimetres"),
    "in": ("inch", "inches"),
    "ft": ("foot", "feet"),
}
_SIGN_OF = {word: sign for sign, words in _WORDS.items() for word in (sign, *words)}


def unit_sign(unit: str) -> str | None:
    """The sign of a unit of length, as programs write it (`mm`, `[mm]`, `Millimetres`); None where it is none."""
    return _SIGN_OF.get(unit.strip(" \t\0[]().").lower())


def metres_in(unit: str) -> float | None:
    """Metres in a unit of length, as programs write it; None where it is none."""
    sign = unit_sign(unit)
    return None if sign is None else METRES_PER_UNIT[sign]
