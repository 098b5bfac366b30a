"""Views brought in step: what moves tells by how many frames each is late, and offsets correct it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from tracker.foundation.errors import ConfigError
from tracker.foundation.source_files import json_of
from tracker.images.inspection import Survey, changes
from tracker.images.reading import Reading, Sequence, later

MOST_ROUNDS = 3
"""Of looking, correcting and looking again: views that overlap more tell what is left."""

_FEWEST_FRAMES = 20
"""Of a recording of which it is said that they do not tell."""

_SETTINGS = ("offsets", "start", "stop", "on_missing")
"""Of a reading, by which delays are corrected."""


def in_step(reading: Reading, sequence: Sequence, seen: Survey) -> Reading | None:
    """The reading with the offsets that bring its views in step; None where they are, or are to stay as they are.

    Frames keep the numbers that they have in most views. The first and the last ones are left out where a view has no
    image of them.

    Args:
        reading: how the recording is read.
        sequence: the recording, opened so.
        seen: what its first frames show.
    """
    settings: Any = reading
    if getattr(reading, "in_step", "off") == "off":
        return None
    late = {name: told for v, name in enumerate(seen.rig.names) if (told := changes(seen, v))}
    if not late:
        return None
    added = {name: later(settings.offsets.get(name, 0), told) for name, told in late.items()}
    begin = max(-(one if isinstance(one, int) else one[0][1]) for one in added.values())
    start = settings.start + settings.stride * max(0, -((settings.start - begin) // settings.stride))
    last = settings.start + (sequence.n_frames - 1) * settings.stride
    stop = last + 1 - max(0, *(list(told.values())[-1] for told in late.values()))
    if stop <= start:
        return None
    changed: dict[str, Any] = {"offsets": {**settings.offsets, **added}, "start": start, "stop": stop}
    if any(after < before - 1 for told in late.values() for before, after in itertools.pairwise(told.values())):
        changed["on_missing"] = "skip"  # several images in turn were dropped
    corrected: Reading = replace(settings, **changed)
    return corrected


def untold(seen: Survey) -> str:
    """What is said of views of which nothing tells whether they are in step; empty if there are none."""
    told = seen.delays.told
    if told.all() or len(seen.foregrounds) < _FEWEST_FRAMES:
        return ""
    names = [name for name, one in zip(seen.rig.names, told, strict=True) if not one]
    verb = "shows" if len(names) == 1 else "show"
    whether = f"{' and '.join(names)} {verb} the same moments as the others" if told.any() else "views are in step"
    return f"views: too little moves in the first {len(seen.foregrounds)} frames to tell whether {whether}"


def corrections(asked: Any, reading: Any) -> dict[str, Any]:
    """The settings of a reading in which it differs from what was asked for, as `run.json` keeps them."""
    return {
        name: getattr(reading, name)
        for name in _SETTINGS
        if hasattr(reading, name) and getattr(reading, name) != getattr(asked, name)
    }


def corrected_before(reading: Reading, folder: Path | None) -> Reading:
    """A reading with what an interrupted run has corrected; as it is if that has corrected, or kept, nothing.

    Args:
        reading: how the recording is to be read.
        folder: result of the interrupted run; None for none.
    """
    try:
        kept: Any = {} if folder is None else json_of(folder / "run.json", ConfigError).get("images", {})
    except ConfigError:
        return reading
    told = {name: kept[name] for name in _SETTINGS if isinstance(kept, Mapping) and name in kept}
    changed: Reading = replace(reading, **told) if told else reading  # type: ignore[type-var]
    return changed


def told_of_delays(asked: Any, reading: Any) -> str:
    """What was corrected, in words; empty for nothing."""
    before, now = getattr(asked, "offsets", {}), getattr(reading, "offsets", {})
    views = [f"{name} {_words(before.get(name, 0), one)}" for name, one in now.items() if one != before.get(name, 0)]
    return f"views brought in step: {', '.join(views)}" if views else ""


def _words(before: Any, now: Any) -> str:
    if isinstance(before, int) and isinstance(now, int):
        images = now - before
        return f"was {abs(images)} image{'s' * (abs(images) > 1)} {'late' if images > 0 else 'early'}"
    pairs = ((0, now),) if isinstance(now, int) else now
    first, *others = pairs
    return f"has offset {first[1]}" + "".join(f", {offset} from frame {frame} on" for frame, offset in others)
