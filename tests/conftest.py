"""What several test files share."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data() -> Callable[[str], Path]:
    """Path of a recording in the folder BODYTRACK_DATA; skips the test, saying what is missing."""

    def path(relative: str) -> Path:
        root = os.environ.get("BODYTRACK_DATA")
        found = Path(root, relative) if root else None
        if found is None or not found.exists():
            pytest.skip(f"needs BODYTRACK_DATA/{relative}")
        return found

    return path
