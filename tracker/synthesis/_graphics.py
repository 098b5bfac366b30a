"""Optional graphics libraries: loaded late, and what is missing said in one sentence."""

from __future__ import annotations

import importlib
from typing import Any

from tracker.foundation.errors import RenderError

SYSTEM_PACKAGES = "apt-get install -y --no-install-recommends libegl1 libgl1 libxrender1 libosmesa6"
NEWER_BINDING = 'pip install -U "PyOpenGL>=3.1.10"'


def library(name: str, use: str) -> Any:
    """An optional Python package.

    Args:
        name: the package.
        use: the component that needs it.

    Raises:
        RenderError: it is not installed, or it does not find the system libraries it needs.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package = name.partition(".")[0]
        if error.name == package:
            raise RenderError(f'synthesis "{use}" needs the Python package {package}: pip install {package}') from error
        raise unusable(use, error) from error
    except Exception as error:
        raise unusable(use, error) from error


def unusable(use: str, error: Exception) -> RenderError:
    """What to do about an exception of a graphics library, in one sentence."""
    first = next(iter(str(error).strip().splitlines()), "")
    kind = "" if type(error) is Exception else f"{type(error).__name__} "
    reason = " ".join(f"{kind}{first}".split())
    if "OSMesaCreateContextAttribs" in str(error):
        return RenderError(f'synthesis "{use}" needs a newer PyOpenGL than pyrender asks for: {NEWER_BINDING}')
    return RenderError(f'synthesis "{use}" finds no OpenGL it can use ({reason}): {SYSTEM_PACKAGES}')
