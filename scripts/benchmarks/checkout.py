"""A checkout of the package, of whatever commit, run as a process of its own."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

SCRIPTS = Path(__file__).parents[1]


@dataclass(frozen=True)
class Code:
    """A checkout of the package that is run."""

    folder: Path

    @cached_property
    def digest(self) -> str:
        """Eight digits that change with any source file or model."""
        files = [path for name in ("tracker", "models") for path in (self.folder / name).rglob("*") if path.is_file()]
        sources = sorted(path for path in files if path.suffix in (".py", ".toml", ".comp"))
        content = b"".join(str(path.relative_to(self.folder)).encode() + path.read_bytes() for path in sources)
        return hashlib.sha256(content).hexdigest()[:8]

    @cached_property
    def commit(self) -> str:
        """The commit checked out, with a + where files differ from it."""
        command = ["git", "-C", str(self.folder), "describe", "--always", "--abbrev=7", "--dirty=+", "--exclude=*"]
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()

    def run(self, arguments: list[str], folder: Path, module: str = "tracker") -> str:
        """Runs `bodytrack` with these arguments in a folder; what it complained about, empty if it succeeded.

        Args:
            arguments: of the command line.
            folder: where it is run.
            module: the package, or one beside it that runs its command line.
        """
        paths = [str(self.folder), str(SCRIPTS)]
        settings = {"PYTHONPATH": os.pathsep.join(paths), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        if data := os.environ.get("BODYTRACK_DATA"):
            settings["BODYTRACK_DATA"] = str(Path(data).resolve())
        done = subprocess.run(
            [sys.executable, "-m", module, *arguments],
            cwd=folder,  # python -m looks there first: no checkout may be there
            env={**os.environ, **settings},
            capture_output=True,
            text=True,
            check=False,
        )
        (folder / "printed.txt").write_text(done.stdout + done.stderr, encoding="utf-8")
        return "" if done.returncode == 0 else (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[-1]
