"""Compiled inner loops; each has a plain twin that the tests hold it against. They import `foundation` alone.

Those of the extension `tracker._native` lie in native/, in the same folders; files here name and explain them.
"""

from __future__ import annotations

from pathlib import Path

from tracker.foundation.native_sources import load_extension

load_extension(Path(__file__).parents[2])
