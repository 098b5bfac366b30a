"""Components that need graphics libraries, where those are installed."""

from __future__ import annotations

from typing import Any

import pytest
from sections import made

from tracker.bodies.scene import Scene
from tracker.foundation.errors import RenderError


def working(use: str, scene: Scene) -> Any:
    """A synthesis; the test is skipped, saying what is missing, where it cannot work."""
    synthesis = made("synthesis", use)
    try:
        synthesis.silhouettes(scene)
    except RenderError as error:
        pytest.skip(str(error))
    return synthesis
