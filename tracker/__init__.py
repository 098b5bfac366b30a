"""bodytrack: model-based, marker-less motion capture from calibrated views.

Nouns are the files of this package, verbs its folders; see the README's architecture section. For programs:
`tracker.load_result(folder)` loads what a run has left, `tracker.load_run(config)` makes one.
"""

from __future__ import annotations

import importlib

__version__ = "0.1.0"

_OFFERED = {"load_result": "result", "Result": "result", "Track": "person_track", "load_run": "run", "Run": "run"}
"""What the package offers by itself -> its module, which loads when it is asked for; `__init__.pyi` has the types."""


def __getattr__(name: str) -> object:
    """PEP 562: importing the package loads nothing, and so `bodytrack --help` is quick."""
    if name not in _OFFERED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_OFFERED[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_OFFERED])
