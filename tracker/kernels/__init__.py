"""Compiled inner loops; each has a plain twin that the tests hold it against. They import `foundation` alone.

Their code is the extension `tracker._native`, made of native/; files here name and explain it, a file a subject.
"""

from __future__ import annotations

from pathlib import Path

from tracker.foundation.native_sources import load_extension

load_extension(Path(__file__).parents[2])
