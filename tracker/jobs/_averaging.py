"""Images that are made smaller or larger before persons are followed in them, as high as fits the pixels set there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tracker.errors import TrackerError
from tracker.reading import Reading
from tracker.rig import Rig
from tracker.rig_layouts import load_rig
from tracker.shown_size import fitting_downscale, shown_px


def sized(reading: Reading) -> Reading:
    """A reading that makes images as large as fits how high the cameras show persons, if it does not say how."""
    if getattr(reading, "downscale", 1) is not None:
        return reading
    settings: Any = reading  # of whatever kind, it has a rig and views
    try:
        rig = load_rig(settings.rig, settings.views)
    except TrackerError:
        return reading  # opening it tells what is wrong
    averaged: Reading = replace(settings, downscale=fitting_downscale(rig))
    return averaged


def averaging(rig: Rig) -> str:
    """What was done to the images of a rig before they are looked at; empty for nothing."""
    factor = rig.cameras[0].downscale
    if factor == 1:
        return ""
    done = "enlarged twice" if factor < 1 else f"averaged over {factor:g} x {factor:g} pixels"
    return f"images {done}, persons are then some {shown_px(rig):.0f} pixels high"
