"""Models of OpenSim's own, scaled and moved by OpenSim as the persons of finished runs moved."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tracker.foundation.configuration.tables import build
from tracker.foundation.errors import ConfigError
from tracker.running.programs import export

_FLEXIONS = ("hip", "knee", "elbow")


def compare(console: Console, results: Sequence[Path], models: Sequence[str]) -> None:
    """Prints a row a person and model: markers, mm, and flexions less ours, degrees, constant part +- RMS of the rest.

    Raises:
        ConfigError: a result or a model cannot be read, or OpenSim did not move a model.
    """
    table = Table(title="OpenSim's inverse kinematics of our markers, flexions less ours", title_justify="left")
    for column in ("result", "person and model", "frames", "markers RMS", "largest", *_FLEXIONS):
        table.add_column(column, justify="left" if column in ("result", "person and model") else "right")
    for result in results:
        for model in models:
            recording = build("recording", {"use": "opensim", "model": model}, "--model", Path())
            with tempfile.TemporaryDirectory() as folder, console.status(f"{result} {model}"):
                outcomes = [path for path in export(result, [recording], Path(folder)) if path.suffix == ".json"]
                if not outcomes:
                    raise ConfigError(f"{result}: OpenSim did not move {model}, see above")
                for path in outcomes:
                    table.add_row(str(result), path.stem, *_cells(json.loads(path.read_text())))
    console.print(table)


def _cells(outcome: dict[str, object]) -> list[str]:
    differences = outcome["opensim_less_ours_deg"]
    assert isinstance(differences, dict)
    cells = [str(outcome["frames"]), f"{outcome['marker_rms_mm']}", f"{outcome['marker_largest_mm']}"]
    for joint in _FLEXIONS:
        sides = [differences.get(f"{side}_{joint}_flexion") for side in ("left", "right")]
        cells.append(", ".join(f"{one['offset']:+.1f} +- {one['rms']:.1f}" for one in sides if one))
    return cells
