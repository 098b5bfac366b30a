"""Commands that were called otherwise: the earlier spelling works as it did, and the new one is said."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from typer.core import TyperGroup

from tracker.running.commands.terminal import marked

_ANEW = "--overwrite"
"""What the earlier spelling of a report's command did unasked."""

EARLIER: dict[str, tuple[str, ...]] = {
    "batch": ("run", "--batch"),
    "evaluate": ("result", "evaluate", _ANEW),
    "smooth": ("result", "smooth"),
    "align": ("result", "align"),
    "export": ("result", "export", _ANEW, "--in-result"),
    "compare": ("result", "compare", _ANEW),
    "recognize": ("result", "recognize", _ANEW),
    "segment": ("result", "segment", _ANEW),
}
"""Earlier name -> the words that do the same now."""


class Commands(TyperGroup):
    """The commands, and those that were called otherwise."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Finds the command that the words name."""
        if (now := EARLIER.get(args[0])) is not None:
            if not ctx.resilient_parsing:  # as the shell completes
                _tell(args[0], " ".join(word for word in now if word not in (_ANEW, "--in-result")))
            args = [*now, *args[1:]]
        return super().resolve_command(ctx, args)


def _tell(before: str, now: str) -> None:
    told = f"`bodytrack {before}` is called `bodytrack {now}` now"
    Console(stderr=True).print(marked("look", told), highlight=False, soft_wrap=True)
