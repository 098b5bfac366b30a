"""Files of the package, and memory that stages have freed and the C library keeps."""

from __future__ import annotations

import contextlib
import ctypes
from pathlib import Path

from tracker.foundation.errors import ModelError, nearest

_PACKAGE = Path(__file__).parents[1]


def models_folder() -> Path:
    """Folder of the bundled body models: beside the package in a checkout, inside an installed package."""
    installed = _PACKAGE / "_models"
    return installed if installed.is_dir() else _PACKAGE.parent / "models"


def model_path(name: str) -> Path:
    """File of a bundled body model.

    Raises:
        ModelError: no model has that name.
    """
    path = models_folder() / f"{name}.toml"
    if not path.is_file():
        names = (file.stem for file in models_folder().glob("*.toml"))
        raise ModelError(f'no body model "{name}"; {nearest(name, names)}, or a path to a .toml file')
    return path


def give_back() -> None:
    """Returns free memory to the system, if the C library can (not on macOS, Windows, musl).

    A run with four views of 720x576 held 900 MiB before its body was fitted, of which 330 were free; before its first
    window it held 970, of which 260 were free. It takes 20 ms.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)
