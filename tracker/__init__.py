"""bodytrack: model-based, marker-less motion capture from calibrated views.

For programs: `tracker.load_run(config)` makes a run, `tracker.load_result(folder)` loads what one has left.
`dir(tracker)` lists the public names; docs/python.md shows their use, and the stable ones.
"""

from __future__ import annotations

import importlib

__version__ = "0.1.0"

_OFFERED = {
    "Result": "results.result",
    "Run": "running.programs",
    "Track": "results.result",
    "TrackerError": "foundation.errors",
    "evaluate": "running.programs",
    "export": "running.programs",
    "load_result": "results.result",
    "load_run": "running.programs",
    "simulate": "running.programs",
    "smooth": "running.programs",
}
"""Public name -> its module, which loads on demand; `__init__.pyi` has the types."""


def __getattr__(name: str) -> object:
    """PEP 562: importing the package loads nothing, so `bodytrack --help` is quick."""
    if name not in _OFFERED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_OFFERED[name]}"), name)


def __dir__() -> list[str]:
    """The public names."""
    return [*sorted(_OFFERED), "__version__"]
