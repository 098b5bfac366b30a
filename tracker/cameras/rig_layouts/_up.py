"""Which way is up, as far as cameras that stand upright tell."""

from __future__ import annotations

from collections.abc import Sequence

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig


def up_remarks(cameras: Sequence[Camera]) -> tuple[str, ...]:
    """What to know where the world of a file has another axis up than z."""
    up = Rig(tuple(cameras)).likely_up if cameras else "z"
    if up == "z":
        return ()
    return (
        f"z is not up in this file, {up} seems to be: `bodytrack rig convert THIS rig.toml --up {up}` turns it, and "
        "--floor METRES tells where the floor lies along that axis",
    )
