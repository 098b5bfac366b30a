"""The sources of the extension `tracker._native`, and whether it was built from the ones beside it.

native/build.py runs this file before anything is installed: it imports nothing but the standard library and errors.
"""

from __future__ import annotations

import hashlib
import importlib
from pathlib import Path

from tracker.foundation.errors import InstallationError

_EXTENSION = "tracker._native"


def digest_of(folder: Path) -> str:
    """Digest of all inputs of a build of the extension.

    Args:
        folder: `native/` of a checkout.
    """
    told = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.suffix in (".cpp", ".hpp") or path.name == "CMakeLists.txt":
            told.update(f"{path.relative_to(folder).as_posix()}\0".encode() + path.read_bytes() + b"\0")
    return told.hexdigest()[:16]


def load_extension(root: Path) -> None:
    """Imports the extension, and checks that it was built from the checkout's sources: old code never runs unnoticed.

    Args:
        root: folder of the package; one without `native/` is not a checkout.

    Raises:
        InstallationError: it is missing, cannot run on this machine, or was built from other sources.
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
