"""Entry point of the `bodytrack` command and of `python -m tracker`."""

from __future__ import annotations

import os

# Many small solves are up to ten times faster on one BLAS thread each; numpy reads this when it is loaded.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

from tracker.running.cli import main  # noqa: E402

if __name__ == "__main__":
    main()
