"""Compiled inner loops; each has a plain twin that the tests hold it against."""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path


def _forget_stale_code(folder: Path) -> None:
    """Deletes machine code made from other sources than those in the folder.

    numba compiles anew what was changed itself, but not what calls it: code of two versions would be mixed.
    """
    digest = hashlib.sha256()
    for source in sorted(folder.glob("*.py")):
        digest.update(source.read_bytes())
    stamp = folder / "__pycache__" / "sources.sha256"
    with contextlib.suppress(OSError):
        if stamp.is_file() and stamp.read_text(encoding="ascii") == digest.hexdigest():
            return
        stamp.parent.mkdir(exist_ok=True)
        for code in stamp.parent.glob("*.nb[ci]"):
            code.unlink(missing_ok=True)
        stamp.write_text(digest.hexdigest(), encoding="ascii")


_forget_stale_code(Path(__file__).parent)
