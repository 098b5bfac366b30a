"""The server that a browser looks at, on this machine only."""

from __future__ import annotations

import contextlib
import importlib
import io
from collections.abc import Iterator
from typing import Any

from tracker.foundation.errors import ConfigError

LOOPBACK = "127.0.0.1"
"""Nobody but this machine: what is shown are pictures of persons."""


@contextlib.contextmanager
def serving(port: int, wide: bool = False) -> Iterator[Any]:
    """A viser server on the loopback address, as long as it is used; on the next free port if this one is taken.

    Args:
        port: of the address.
        wide: whether what steers it needs much room.

    Raises:
        ConfigError: viser is not installed, or no port is free.
    """
    try:
        viser: Any = importlib.import_module("viser")
    except ImportError as error:
        raise ConfigError("bodytrack view needs the Python package viser: pip install viser") from error
    try:
        with _quiet():
            server = viser.ViserServer(host=LOOPBACK, port=port, label="bodytrack", verbose=False)
    except (OSError, RuntimeError) as error:
        raise ConfigError(f"--port {port}: cannot be listened to: {error}") from error
    # the button would open a tunnel to outside
    server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large" if wide else "medium")
    server.scene.set_up_direction("+z")
    try:
        yield server
    finally:
        with _quiet():
            server.stop()


def _quiet() -> contextlib.redirect_stdout[io.StringIO]:
    """Whatever viser prints, which it does even if it is not to be verbose."""
    return contextlib.redirect_stdout(io.StringIO())
