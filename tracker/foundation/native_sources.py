"""The sources of the extension `tracker._native`, and whether it was built from those beside it.

native/build.py runs this file before anything is installed: it imports nothing but the standard library and errors.
"""

from __future__ import annotations

import hashlib
import importlib
from pathlib import Path

from tracker.foundation.errors import InstallationError

_EXTENSION = "tracker._native"


def digest_of(folder: Path) -> str:
    """Digest of all that a build of the extension depends on.

    Args:
        folder: `native/` of a checkout.
    """
    told = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.suffix in (".cpp", ".hpp") or path.name == "CMakeLists.txt":
            told.update(f"{path.relative_to(folder).as_posix()}\0".encode() + path.read_bytes() + b"\0")
    return told.hexdigest()[:16]


def load_extension(root: Path) -> None:
    """Imports the extension; what it was built from must be what a checkout holds: old code never runs unnoticed.

    Args:
        root: folder that the package lies in; one without `native/` is no checkout.

    Raises:
        InstallationError: there is none, it cannot run on this machine, or other sources lie beside it.
    """
    remedy = root / "scripts" / "build_native.sh"
    try:
        found = importlib.import_module(_EXTENSION)
    except ImportError as error:
        raise InstallationError(f"{error}; in a checkout, build the extension by {remedy}") from error
    if (root / "native").is_dir() and digest_of(root / "native") != found.SOURCES:
        raise InstallationError(
            f"{found.__file__} was built from other sources than those in {root / 'native'}; build it anew by {remedy}"
        )
