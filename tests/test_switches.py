"""Rules that benchmarks switch off and count: each is where it is said to be, and is what it is said to be."""

from __future__ import annotations

import importlib
from collections import Counter
from functools import reduce
from pathlib import Path
from typing import Any

import pytest

from tracker.foundation.errors import ConfigError

SCRIPTS = Path(__file__).parents[1] / "scripts"


@pytest.fixture
def switches(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(SCRIPTS)
    return importlib.import_module("benchmarks.switches")


def test_rules_have_names_of_their_own_and_are_chosen_by_them(switches: Any) -> None:
    names = [rule.name for rule in switches.RULES]
    assert max(Counter((*names, *switches.GROUPS)).values()) == 1
    assert [rule.name for rule in switches.chosen("jumps+rivals")] == ["jumps", "rivals"]
    assert {rule.name for rule in switches.chosen("way back")} == {"second_pass", "rivals", "found_anew"}
    assert switches.chosen("") == ()
    with pytest.raises(ConfigError, match="jumps"):
        switches.chosen("jump")


def test_rules_are_where_they_are_switched_off(switches: Any) -> None:
    for place in (place for rule in switches.RULES for place in rule.places):
        module, _, path = place.partition(":")
        assert callable(reduce(getattr, path.split("."), importlib.import_module(module)))


def test_a_rule_is_counted_or_replaced(switches: Any) -> None:
    def without(function: Any, given: Any) -> Any:
        return given.places[0]

    def more(value: int) -> int:
        return value + (value > 1)

    rule = switches.Rule("more", "start", "one more", "1", (), without, lambda one, other: one != other)
    asked, noticed = Counter[str](), Counter[str]()
    run = importlib.import_module("benchmarks.switched_run")
    on, off = (run._counted(more, rule, is_off, asked, noticed) for is_off in (False, True))
    assert [on(1), on(2), off(2)] == [1, 3, 2]
    assert (asked["more"], noticed["more"]) == (3, 1)


@pytest.mark.parametrize("name", ["rivals", "vague", "rehearsal", "limbs_anew"])
def test_without_a_rule_comes_back_what_it_was_given(switches: Any, name: str) -> None:
    (rule,) = switches.chosen(name)
    places = (object(), object(), object())
    assert rule.off(None, switches.Given(places, {})) in places
