"""Entry point of the `bodytrack` command."""

from __future__ import annotations

import os


def main() -> None:
    """Starts the command line; many small solves are faster on one BLAS thread each, by up to ten times."""
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    from tracker.cli import main as command_line

    command_line()
