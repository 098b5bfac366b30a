"""The rules that steer tracking, each with what takes its place where a benchmark switches it off.

The only place that knows them as rules: nothing in the package can be switched off by users.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tracker.foundation.errors import ConfigError, nearest

Off = Callable[..., Any]
"""(the function that the rule is, its arguments as `Given`) -> what is returned without the rule."""


@dataclass(frozen=True)
class Given:
    """Arguments of a call, of a method with its object."""

    places: tuple[Any, ...]
    names: Mapping[str, Any]


@dataclass(frozen=True)
class Rule:
    """A rule, where it is asked, and what is without it."""

    name: str
    group: str
    """`start`, `search`, `way back`, `doubt` or `sight`."""

    about: str
    row: str
    """Of the table of rules that a look through the house made (2026-11-28)."""

    places: tuple[str, ...]
    """`module:function` or `module:Class.method`, by the names that callers look them up by."""

    off: Off
    noticed: Callable[[Any, Any], bool] = field(default=lambda found, without: found is not without)
    """Whether what the rule returned differs from what there would be without it."""


def _argument(place: int, name: str = "") -> Off:
    """What the rule was given comes back."""

    def same(function: Callable[..., Any], given: Given) -> Any:
        return given.names[name] if name in given.names else given.places[place]

    return same


def _constant(value: Any) -> Off:
    return lambda function, given: value


def _as_list(function: Callable[..., Any], given: Given) -> list[Any]:
    return list(given.places[0])


def _only_lost(function: Callable[..., Any], given: Given) -> bool:
    """Nobody is looked for anew who is merely doubted."""
    estimate, before = given.places[:2]
    return bool((estimate.lost or before.lost) and function(*given.places, **given.names))


def _no_poses(function: Callable[..., Any], given: Given) -> Any:
    return np.empty((0, len(given.places[1]))), 0


def _any_poses(found: Any, without: Any) -> bool:
    return len(found[0]) > 0


def _told_otherwise(found: Any, without: Any) -> bool:
    """Whether an estimate, a step, or any of several has another pose or status."""
    if isinstance(found, Sequence):
        return any(_told_otherwise(one, other) for one, other in zip(found, without, strict=True))
    if hasattr(found, "estimates"):
        return _told_otherwise(found.estimates, without.estimates)
    if found is without:
        return False
    told = [(one.status, one.doubtful, sorted(one.ambiguous), sorted(one.vague)) for one in (found, without)]
    return told[0] != told[1] or not np.array_equal(found.q, without.q)


_TRACKING = "tracker.tracking"

RULES = (
    Rule("easier_start", "start", "an unsure start is looked for in later frames, and led back", "47",
         (f"{_TRACKING}.sequence:led_back",), _constant(None)),
    Rule("rehearsal", "start", "the likeliest starts are tracked some frames before one is chosen", "46",
         (f"{_TRACKING}.sequence:rehearsed",), _argument(0, "start")),
    Rule("unconfirmed", "start", "a start rather wrong that no frame confirms makes all frames doubtful", "29",
         (f"{_TRACKING}.windows:doubtful_in_all",), _argument(0),
         _told_otherwise),
    Rule("limbs_anew", "start", "limbs of a start are looked for alone, by contours and colours", "57",
         (f"{_TRACKING}.cycle_turn:in_likeliest_places",), _argument(1, "estimate"),
         _told_otherwise),
    Rule("exchanged", "search", "a weak limb changes places with its partner", "6",
         (f"{_TRACKING}.proposals.exchanged:propose",), _no_poses, _any_poses),
    Rule("elsewhere", "search", "a weak limb is looked for wherever it may be", "7, 34",
         (f"{_TRACKING}.proposals.elsewhere:propose",), _no_poses, _any_poses),
    Rule("refined_again", "search", "poses known from the body's fit are refined, and not predicted", "new",
         (f"{_TRACKING}.found_before:FoundBefore.gone_again",), _constant(())),
    Rule("second_pass", "way back", "windows with doubt, and first frames, are tracked back", "39, 40",
         (f"{_TRACKING}.windows:back",), _as_list, _told_otherwise),
    Rule("rivals", "way back", "poses of two ways are weighed, limb by limb", "41",
         (f"{_TRACKING}.cycle_turn:weighed",), _argument(1),
         _told_otherwise),
    Rule("found_anew", "way back", "statuses are rewritten after both ways", "42",
         (f"{_TRACKING}.windows:told_in_time", f"{_TRACKING}.coming_in:told_in_time"), _as_list, _told_otherwise),
    Rule("jumps", "doubt", "limbs that jump are doubted", "27",
         (f"{_TRACKING}.windows:with_jumps", f"{_TRACKING}.coming_in:with_jumps"), _as_list, _told_otherwise),
    Rule("vague", "doubt", "limbs that one view shows, or whose joints are vague, are doubted", "21, 22",
         (f"{_TRACKING}.cycle_turn:with_vague_limbs",), _argument(1, "estimate"),
         _told_otherwise),
    Rule("sought_anew", "doubt", "who is long doubted is looked for as if never seen", "33",
         (f"{_TRACKING}.cycle_turn:sought_anew",), _only_lost, lambda found, without: found != without),
    Rule("in_view", "doubt", "whom fewer than two views show is lost, a limb ambiguous", "23",
         (f"{_TRACKING}.outcome:judged_in_view",), _argument(2), _told_otherwise),
    Rule("in_space", "doubt", "of two persons in one place the worse is lost", "24",
         (f"{_TRACKING}.outcome:judged_in_space", f"{_TRACKING}.cycle_turn:judged_in_space"), _argument(1),
         _told_otherwise),
    Rule("still_lost", "doubt", "who was lost and few views show still is", "26",
         (f"{_TRACKING}.cycle_turn:still_lost",), lambda function, given: list(given.places[3]), _told_otherwise),
    Rule("hidden", "sight", "a view has no say in a limb it has not shown for some frames", "12",
         ("tracker.tracking.objective:not_shown_by",), _constant(None)),
    Rule("strangers", "sight", "what stands out and is nobody hides the persons", "16",
         (f"{_TRACKING}.cycle_turn:hide_strangers", f"{_TRACKING}.bootstrapping:hide_strangers"), _constant(None)),
)  # fmt: skip
"""All that are switched off or counted."""

GROUPS = tuple(dict.fromkeys(rule.group for rule in RULES))
"""Rules of one group are switched off together by its name."""


def chosen(words: str) -> tuple[Rule, ...]:
    """The rules of some names or groups.

    Args:
        words: with `+` between; empty for none.

    Raises:
        ConfigError: there is none of a name.
    """
    found: list[Rule] = []
    for word in filter(None, words.split("+")):
        named = [rule for rule in RULES if word in (rule.name, rule.group)]
        if not named:
            raise ConfigError(f'no rule or group "{word}"; {nearest(word, [*(rule.name for rule in RULES), *GROUPS])}')
        found += named
    return tuple(found)
