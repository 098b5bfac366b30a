"""Has Python load the extension of the sanitized build: scripts/sanitized.sh puts this folder on PYTHONPATH."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType

_BUILT = Path(__file__).resolve().parents[2] / "build" / f"native-{sys.implementation.cache_tag}-sanitize"


class _Sanitized(MetaPathFinder):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "tracker._native":
            return None
        (extension,) = _BUILT.glob("_native*.so")
        return spec_from_file_location(fullname, extension)


sys.meta_path.insert(0, _Sanitized())
