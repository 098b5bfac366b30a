"""The world that a rig brings with it: which way is up, and where the floor is on which persons are looked for."""

from __future__ import annotations

import numpy as np

from tracker.cameras.rig import CAMERAS, Rig

_SURELY_UP = 0.75
"""Share of a whole vector that the mean of the cameras' up directions has, to be taken for the world's up."""

_LEAST_UP = 0.3
"""Vertical share of the up direction of most cameras, below which they are held sideways, or z is not up."""

_TURNED_DEG = 15.0
"""Between z and what all cameras hold up, from which it is told. Rooms that were calibrated well have 0 to 12, a desk
whose board lay obliquely in the first picture 28."""

_BELOW_M = 0.1
"""A lens lower than this is below a floor that is really there."""

_LOW_M = 0.2
"""Height at which cameras look that is too low for persons: they look at 0.6 to 1.3 m, at a desk whose board is the
world's origin at 0.07 m."""


def told_world(rig: Rig) -> str:
    """One line: where the calibration has the floor, and the cameras above it."""
    heights = [float(camera.centre[2]) for camera in rig.cameras]
    return (
        f"the calibration's world: z is up, the floor z = 0; cameras stand {min(heights):.2f} to {max(heights):.2f} m "
        f"above it and look at a place {float(rig.middle[2]):.2f} m above it"
    )


def world_doubts(rig: Rig) -> tuple[str, ...]:
    """What is unusual in the world of a rig, in one line each, with the command that mends it."""
    if up := _up_doubt(rig):
        return (up,)
    turned = _turned_doubt(rig)
    floor = _floor_doubt(rig.with_up(CAMERAS) if turned else rig, f" --up {CAMERAS}" if turned else "")
    return tuple(filter(None, (turned, floor)))


def _up_doubt(rig: Rig) -> str:
    """That another axis than z is up; of a rig that only its images tell of, with a question mark."""
    upwards = np.array([-camera.camera_from_world[1, :3] for camera in rig.cameras])
    mean, likely = upwards.mean(axis=0), rig.likely_up
    turn = (
        f"`bodytrack rig convert THIS rig.toml --up {likely} --floor Z` turns it, Z is where the floor is on that axis"
    )
    hung = ", or hang upside down" if likely == "-z" else ""
    if likely != "z" and np.abs(mean).max() > _SURELY_UP:
        return (
            f"the cameras are upright with the rig's {likely} axis up, expected z{hung}: persons would be looked for "
            f"lying; {turn}"
        )
    if np.median(upwards[:, 2]) < _LEAST_UP:
        what = f"is the world's z axis up? If {likely} is: {turn}" if likely != "z" else "is the world's z axis up?"
        return f"most cameras are tilted or upside down: {what}"
    return ""


def _turned_doubt(rig: Rig) -> str:
    up = rig.held_up
    turned_deg = 0.0 if up is None else float(np.degrees(np.arccos(np.clip(up[2], -1, 1))))
    if turned_deg < _TURNED_DEG:
        return ""
    return (
        f"the rig is turned: all cameras are upright about a direction {turned_deg:.0f} degrees off its z axis; did "
        "the board that is the world's origin lie obliquely? Persons would be looked for leaning: "
        f"`bodytrack rig convert THIS rig.toml --up {CAMERAS}` turns it"
    )


def _floor_doubt(rig: Rig, turn: str) -> str:
    low = min(rig.cameras, key=lambda camera: float(camera.centre[2]))
    height_m, looked_at_m = float(low.centre[2]), float(rig.middle[2])
    if height_m >= -_BELOW_M and looked_at_m >= _LOW_M:
        return ""
    found = (
        f"{low.name} is {-height_m:.2f} m below the floor: is z up and the origin on it?"
        if height_m < -_BELOW_M
        else f"the cameras look at a place {looked_at_m:.2f} m above the floor: is the origin on it?"
    )
    return (
        f"{found} Persons are looked for on z = 0. If the floor is lower, measure how high the lens of {low.name} is "
        f"above it, in metres: `bodytrack rig convert THIS rig.toml{turn} --floor Z`, where Z is {height_m:.2f} less "
        "that height"
    )
