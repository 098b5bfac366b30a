"""Movements that `scripts/make_recordings.py` renders: which file, by whom and where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Clip:
    """What is done by whom and where."""

    file: str
    """Below `motions`."""

    person: str
    room: str
    """The recording whose empty room it is."""

    from_s: float = 0.0
    to_s: float = 60.0
    heading_deg: float = 0.0
    ahead_m: float = 0.0
    """How far the middle of the way lies behind that of the room, metres; before it is where somebody comes in from."""

    waits_s: float = 0.0
    """How long the person stays where the movement begins before it does."""

    movement: str = ""
    """Of `laboratory.toml`, in place of a file."""

    partner: str = ""
    """The clip whose person is there as well where there are several; empty for the first one of the other person."""


# Chosen by their names and lengths, before any was tracked; kick, punch and walks were left out, for recordings of
# BODYTRACK_DATA/room show some.
CLIPS = {
    "dance": Clip("deepmimic/humanoid3d_dance_b.txt", "theo", "V-Dance", partner="ballroom_1"),
    "spinkick": Clip("deepmimic/humanoid3d_spinkick.txt", "rita", "K-Kick", heading_deg=60),
    "cartwheel": Clip("deepmimic/humanoid3d_cartwheel.txt", "theo", "N-Stride", 0.0, 2.12, 120),
    "jump": Clip("deepmimic/humanoid3d_jump.txt", "rita", "V-Dance", heading_deg=-30),
    "roll": Clip("deepmimic/humanoid3d_roll.txt", "theo", "K-Kick", heading_deg=30),
    "get_up_from_back": Clip("deepmimic/humanoid3d_getup_faceup.txt", "rita", "P-Floor", heading_deg=90),
    "get_up_from_front": Clip(
        "deepmimic/humanoid3d_getup_facedown.txt", "theo", "N-Stride", heading_deg=-70, partner="jump"
    ),
    "crawl": Clip("deepmimic/humanoid3d_crawl.txt", "rita", "V-Dance", heading_deg=150),
    "spin": Clip("deepmimic/humanoid3d_spin.txt", "theo", "R-Turn", 0.0, 2.16),
    "martial_arts_1": Clip("cmu/135_06-martialArts.amc", "theo", "K-Kick", 4.0, 6.4, partner="martial_arts_2"),
    "martial_arts_2": Clip("cmu/135_06-martialArts.amc", "rita", "P-Floor", 12.0, 14.4, 45),
    "ballroom_1": Clip("cmu/131_04-dance.amc", "rita", "N-Stride", 1.0, 3.4, 90),
    "ballroom_2": Clip("cmu/131_04-dance.amc", "theo", "V-Dance", 5.0, 7.4, -120),
    # Chosen after the others, when there was nothing left to choose by them.
    "backflip": Clip("deepmimic/humanoid3d_backflip.txt", "theo", "V-Dance", heading_deg=40),
    "dancing": Clip("deepmimic/humanoid3d_dance_a.txt", "rita", "P-Floor", heading_deg=-30),
    "martial_arts_3": Clip("cmu/135_06-martialArts.amc", "rita", "V-Dance", 8.0, 10.4, 110),
    "martial_arts_4": Clip("cmu/135_06-martialArts.amc", "theo", "P-Floor", 18.0, 20.4, -60),
    "martial_arts_5": Clip("cmu/135_06-martialArts.amc", "theo", "N-Stride", 22.0, 24.4, 200),
    "ballroom_3": Clip("cmu/131_04-dance.amc", "theo", "K-Kick", 3.0, 5.4, 30),
    # Whole recordings: half a minute of fists that strike, nine seconds of a dance.
    "martial_arts_whole_1": Clip("cmu/135_06-martialArts.amc", "rita", "K-Kick", heading_deg=70),
    "martial_arts_whole_2": Clip("cmu/135_06-martialArts.amc", "theo", "V-Dance", heading_deg=-40),
    "ballroom_whole_1": Clip("cmu/131_04-dance.amc", "theo", "P-Floor"),
    "ballroom_whole_2": Clip("cmu/131_04-dance.amc", "rita", "K-Kick", heading_deg=120),
    # Others of BODYTRACK_DATA/room do these.
    "punch": Clip("deepmimic/humanoid3d_punch.txt", "rita", "P-Floor", heading_deg=100),
    "kick": Clip("deepmimic/humanoid3d_kick.txt", "theo", "V-Dance", heading_deg=-100),
    # These are not by chance: nobody is in the pictures at first, or at last.
    "walking_in": Clip("cmu/07_08-walk.amc", "rita", "V-Dance", heading_deg=30, ahead_m=-2.6),
    "walking_in_late": Clip(
        "cmu/07_08-walk.amc",
        "rita",
        "V-Dance",
        heading_deg=30,
        ahead_m=-2.6,
        waits_s=4.5,
        partner="ballroom_whole_1",
    ),
    "walking_out": Clip("cmu/07_05-walk.amc", "theo", "K-Kick", heading_deg=-70, ahead_m=2.6),
    # What persons do in laboratories.
    "sit_to_stand": Clip("", "theo", "V-Dance", heading_deg=50, movement="sit_to_stand"),
    "squat_1": Clip("", "rita", "K-Kick", heading_deg=-20, movement="squat_arms_crossed"),
    "squat_2": Clip("", "theo", "V-Dance", heading_deg=110, movement="squat_arms_crossed"),
    "lunge": Clip("", "theo", "N-Stride", heading_deg=140, movement="lunge"),
    "lift": Clip("", "rita", "P-Floor", heading_deg=200, movement="lift"),
    "running": Clip("", "rita", "V-Dance", heading_deg=-75, movement="running_on_the_spot"),
    "throw": Clip("", "theo", "K-Kick", heading_deg=20, movement="throw"),
    "hands_behind_back_1": Clip("", "rita", "K-Kick", heading_deg=40, movement="hands_behind_back"),
    "hands_behind_back_2": Clip("", "theo", "N-Stride", heading_deg=170, movement="hands_behind_back"),
    "tree": Clip("", "theo", "P-Floor", heading_deg=60, movement="tree"),
    "legs_crossed": Clip("", "rita", "N-Stride", heading_deg=-40, movement="legs_crossed"),
    "pockets": Clip("", "theo", "V-Dance", heading_deg=-150, movement="pockets"),
    "kneeling": Clip("", "rita", "V-Dance", heading_deg=10, movement="kneeling"),
    "hands_behind_head": Clip("", "theo", "P-Floor", heading_deg=-110, movement="hands_behind_head"),
}


def others(clip: Clip, n: int) -> list[Clip]:
    """Clips of those who are there as well: the partner, else somebody else, then those that follow in the table."""
    first = CLIPS[clip.partner] if clip.partner else next(one for one in CLIPS.values() if one.person != clip.person)
    return [first, *(one for one in CLIPS.values() if one not in (clip, first))][:n]


def names_of(clips: Sequence[Clip]) -> list[str]:
    """The persons' names, numbered where somebody is there twice."""
    persons = [clip.person for clip in clips]
    seen = [persons[: k + 1].count(name) for k, name in enumerate(persons)]
    return [name if n == 1 else f"{name}_{n}" for name, n in zip(persons, seen, strict=True)]
