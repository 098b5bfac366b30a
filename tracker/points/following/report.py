"""The report of a following: one page that needs no other file."""

from __future__ import annotations

import base64
from pathlib import Path

from tracker.foundation.pages import filled
from tracker.points.following.summary import Summary


def report_html(name: str, summary: Summary, folder: Path, flat: bool) -> str:
    """Numbers and pictures of a result folder; `flat`: of one view alone."""
    warnings = list(summary.warnings)
    if summary.interrupted:
        warnings.insert(0, "The job was interrupted: what follows is of the frames before.")
    pictures = sorted(folder.glob("points_*.jpg"))
    content = {
        "name": name,
        "summary": summary,
        "flat": flat,
        "sigma": _sigma(summary),
        "warnings": warnings,
        "frames": [(int(path.stem.removeprefix("points_")), _uri(path)) for path in pictures],
        "snakes": _uri(folder / "snakes.jpg"),
        "trajectories": _uri(folder / "trajectories.png"),
        "counts": _uri(folder / "counts.png"),
        "files": sorted(path.name for path in folder.iterdir() if path.suffix in _TABLES),
    }
    return filled("tracker.points.following", "_report.html", content)


_TABLES = {".csv", ".trc", ".c3d", ".json"}


def _sigma(summary: Summary) -> str:
    if summary.median_sigma_mm is not None:
        return f"{summary.median_sigma_mm:.2f} mm"
    return "-" if summary.median_sigma_px is None else f"{summary.median_sigma_px:.3f} px"


def _uri(path: Path) -> str:
    """A picture as part of the page; empty where there is none."""
    if not path.is_file():
        return ""
    kind = "png" if path.suffix == ".png" else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"
