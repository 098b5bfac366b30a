"""Images that are averaged before persons are followed in them, for the cameras show these higher than is needed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tracker.errors import TrackerError
from tracker.reading import Reading
from tracker.rig import Rig
from tracker.rig_layouts import load_rig
from tracker.shown_size import fitting_downscale, shown_px


def sized(reading: Reading) -> Reading:
    """A reading that averages images as fits how high the cameras show persons, if it does not say how."""
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
    return f"images averaged over {factor} x {factor} pixels, persons are then some {shown_px(rig):.0f} pixels high"
