"""Ways of filming: how `scripts/make_recordings.py` renders a movement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from benchmarks.carried import Carried, ball, barbell, racket, rucksack, skirt, stick
from benchmarks.refilmed import Change, adapting, grey, shaken, switched
from benchmarks.rooms import Standpoint
from tracker.synthesis.simulation.sequence import Recipe


@dataclass(frozen=True)
class Condition:
    """How it is filmed."""

    filmed: Recipe = field(default_factory=Recipe)
    """Whose rate, shutter, clothes, light, noise, delays and compression are taken."""

    n_views: int = 9
    """Of the rig's cameras, the first ones."""

    standpoints: tuple[Standpoint, ...] = ()
    """Where the cameras stand; empty for where the room's do."""

    downscale: int = 1
    """Pixels of the room's pictures, in both directions, to one."""

    turned_deg: float = 0.0
    """By how much each camera was turned, some way, after it was calibrated."""

    zoom: float = 1.0
    """How many times longer the lenses are than the room's: persons leave the pictures."""

    n_boxes: int = 0
    """Cupboards, each between the person and one of the first cameras."""

    sits: bool = False
    """Whether there is a chair where the person is at first."""

    repeats: bool = False
    """Whether the first view shows a frame twice, half-way, and is a frame behind from there on."""

    change: Change | None = None
    """What the cameras make of the images."""

    carried: Carried | None = None
    """What the person wears or carries that no model has."""

    n_others: int = 0
    """How many persons of other clips are there as well."""

    tells_of_all: bool = True
    """Whether all who are there are to be followed, not the first one alone."""


def _around(
    azimuths_deg: Sequence[float], height_m: float, away_m: float = 5.0, fisheye_px: float | None = None
) -> tuple[Standpoint, ...]:
    return tuple(Standpoint(azimuth, height_m, away_m, fisheye_px) for azimuth in azimuths_deg)


# The usual one films as the recordings of BODYTRACK_DATA/room are filmed.
CONDITIONS = {
    "usual": Condition(),
    "blurred": Condition(Recipe(exposure_s=0.02)),
    "plain": Condition(Recipe(wardrobe=2)),
    "three_views": Condition(n_views=3),
    "two_views": Condition(n_views=2),
    "arc": Condition(standpoints=_around((-60, -20, 20, 60), 1.5)),
    "narrow": Condition(standpoints=_around((-35, 0, 35), 1.3)),
    "pair": Condition(standpoints=_around((-35, 35), 1.3)),
    "low": Condition(standpoints=_around((0, 80, 170, 270), 0.6)),
    "high": Condition(standpoints=_around((0, 80, 170, 270), 4.0, 4.5)),
    "eight": Condition(standpoints=_around((0, 90, 180, 270), 0.8) + _around((45, 135, 225, 315), 2.8)),
    "wide": Condition(standpoints=_around((0, 80, 170, 270), 1.4, 1.8, 330.0)),
    "half_rate": Condition(Recipe(fps=12.5)),
    "double_rate": Condition(Recipe(fps=50.0)),
    "high_rate": Condition(Recipe(fps=200.0)),
    "small": Condition(downscale=2),
    "grainy": Condition(Recipe(noise_grey=6.0)),
    "noisy": Condition(Recipe(noise_grey=10.0)),
    "dark": Condition(Recipe(light=0.35)),
    "out_of_step": Condition(Recipe(delays_s=(0.0, 0.013, -0.008, 0.019))),
    "late": Condition(Recipe(delays_s=(0.0, 0.012, 0.024, 0.056))),
    "compressed": Condition(Recipe(constant_rate_factor=33)),
    "turned_cameras": Condition(turned_deg=0.2),
    "repeated": Condition(repeats=True),
    "zoomed": Condition(zoom=1.6),
    "furnished": Condition(n_boxes=1),
    "crammed": Condition(n_boxes=2),
    "seated": Condition(sits=True),
    "grey": Condition(change=grey),
    "adapting": Condition(change=adapting),
    "switched": Condition(change=switched),
    "shaken": Condition(change=shaken),
    "skirt": Condition(carried=skirt),
    "rucksack": Condition(carried=rucksack),
    "racket": Condition(carried=racket),
    "barbell": Condition(carried=barbell),
    "stick": Condition(carried=stick),
    "ball": Condition(carried=ball),
    "together": Condition(n_others=1),
    "three_together": Condition(n_others=2),
    "bystander": Condition(n_others=1, tells_of_all=False),
}
