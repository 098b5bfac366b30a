"""`bodytrack` in a process in which rules are switched off, and in which all others are counted.

python -m benchmarks.switched_run RULES run config.toml ...
"""

from __future__ import annotations

import functools
import importlib
import json
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.pair_table import keep_pairs
from benchmarks.switches import RULES, Given, Rule, chosen

FILE = "rules.json"
"""Rule -> how often it was asked, and how often that made a difference; in the folder it is run in."""


def main() -> None:
    """Runs the command line that follows the rules to be switched off."""
    off = set(chosen(sys.argv.pop(1)))
    keep_pairs()
    asked, noticed = Counter[str](), Counter[str]()
    for rule in RULES:
        for place in rule.places:
            owner, name = _owner(place)
            setattr(owner, name, _counted(getattr(owner, name), rule, rule in off, asked, noticed))
    try:
        importlib.import_module("tracker.__main__").main()
    finally:
        Path(FILE).write_text(json.dumps({"asked": asked, "noticed": noticed}), encoding="utf-8")


def _owner(place: str) -> tuple[Any, str]:
    module, _, path = place.partition(":")
    *owners, name = path.split(".")
    return functools.reduce(getattr, owners, importlib.import_module(module)), name


def _counted(
    function: Callable[..., Any], rule: Rule, is_off: bool, asked: Counter[str], noticed: Counter[str]
) -> Callable[..., Any]:
    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        asked[rule.name] += 1
        given = Given(args, kwargs)
        if is_off:
            return rule.off(function, given)
        found = function(*args, **kwargs)
        noticed[rule.name] += bool(rule.noticed(found, rule.off(lambda *_, **__: found, given)))
        return found

    return call


if __name__ == "__main__":
    main()
