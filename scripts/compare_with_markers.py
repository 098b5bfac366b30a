"""Compares a result with a marker system; the same as `bodytrack compare`."""

from __future__ import annotations

import typer
from rich.console import Console

from tracker.commands.compare import compare
from tracker.errors import TrackerError


def main() -> None:
    """Runs the command; a mistake is one line, exit code 2."""
    try:
        typer.run(compare)
    except (TrackerError, OSError) as error:
        Console(stderr=True).print(f"[red]error:[/] {error}", soft_wrap=True)
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
