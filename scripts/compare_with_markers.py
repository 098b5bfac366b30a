"""Compares a result with a marker system; the same as `bodytrack result compare`."""

from __future__ import annotations

import typer

from tracker.foundation.errors import TrackerError
from tracker.running.commands import print_error
from tracker.running.commands.result import compare


def main() -> None:
    """Runs the command; a mistake is one line, exit code 2."""
    try:
        typer.run(compare)
    except (TrackerError, OSError) as error:
        print_error(error)
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
