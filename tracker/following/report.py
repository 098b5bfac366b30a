"""The report of a following: one page that needs no other file."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping
from pathlib import Path

_STYLE = "body{font:15px sans-serif;max-width:1100px;margin:2em auto;color:#222}img{max-width:100%}"
_STYLE += "td{padding:.15em 1em .15em 0}td+td{text-align:right}.warn{background:#fff3cd;padding:.6em}"


def report_html(name: str, summary: Mapping[str, object], folder: Path) -> str:
    """Numbers and pictures of a result folder."""
    rows = "".join(
        f"<tr><td>{html.escape(key.removeprefix('n_').replace('_', ' '))}</td><td>{_shown(value)}</td></tr>"
        for key, value in summary.items()
        if value is not None and key != "warnings"
    )
    pictures = [*sorted(folder.glob("points_*.jpg"))]
    pictures += [folder / name for name in ("snakes.jpg", "trajectories.png", "counts.png")]
    parts = [_picture(path) for path in pictures if path.is_file()]
    legend = "green: followed by their key patch; orange: a new key; blue: found again; white: new; grey: their way"
    return (
        f"<!doctype html><meta charset='utf-8'><title>{html.escape(name)}</title><style>{_STYLE}</style>"
        f"<h1>{html.escape(name)}: followed points</h1>{_warning(summary)}<table>{rows}</table>"
        f"<p>{legend}</p>{''.join(parts)}\n"
    )


def _warning(summary: Mapping[str, object]) -> str:
    """What a reader must not overlook."""
    warnings = summary["warnings"]
    said = list(warnings) if isinstance(warnings, tuple | list) else []
    if summary["interrupted"]:
        said.insert(0, "The job was interrupted: what follows is of the frames before.")
    return "".join(f"<p class='warn'>{html.escape(str(warning))}</p>" for warning in said)


def _shown(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else html.escape(str(value))


def _picture(path: Path) -> str:
    kind = "png" if path.suffix == ".png" else "jpeg"
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f"<h2>{html.escape(path.stem.replace('_', ' '))}</h2><img src='data:image/{kind};base64,{data}'>"
