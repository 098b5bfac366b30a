"""The demonstration: a simulated recording, tracked from bootstrapping and compared with its truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from tracker.errors import ConfigError
from tracker.evaluation.comparison import Evaluation, evaluate
from tracker.run import Observer, RunResult, dated_folder, execute, link_latest, load_run
from tracker.simulation.sequence import Recipe, write_sequence


class CountingObserver(Observer, Protocol):
    """An observer that also shows counts."""

    def counted(self, what: str, done: int, total: int) -> None:
        """Shows how much of something is done."""


@dataclass(frozen=True)
class DemoOutcome:
    """What the demonstration left."""

    result: RunResult
    evaluation: Evaluation | None
    """None if it was interrupted before a frame was tracked."""


def run_demo(recipe: Recipe, output: Path | None, observer: CountingObserver) -> DemoOutcome:
    """Simulates, bootstraps without a given pose, tracks and compares.

    Args:
        recipe: the recording to simulate.
        output: result folder; None for `results/demo/TIME`.
        observer: told of the progress.

    Returns:
        The result in `tracking/`, and its errors; the recording is in `sequence/`.

    Raises:
        ConfigError: the folder holds something.
    """
    folder = output or dated_folder("demo")
    if folder.exists() and any(folder.iterdir()):
        raise ConfigError(f"{folder} is not empty: choose another --output")
    config = write_sequence(
        recipe, folder / "sequence", lambda done, total: observer.counted("simulating", done, total)
    )
    if output is None:
        link_latest(folder)
    result = execute(load_run(config), folder / "tracking", observer=observer)
    comparable = result.n_frames > 0
    return DemoOutcome(result, evaluate(result.folder, folder / "sequence") if comparable else None)
