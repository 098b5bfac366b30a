"""The smooth result of a tracking job, beside the raw one."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from dataclasses import replace

from tracker.config import component_name
from tracker.errors import ConfigError
from tracker.jobs._recorded import TrackOutcome
from tracker.recording import Recording
from tracker.result import load_result
from tracker.smoothed import FOLDER, write_smoothed
from tracker.smoothing import Smoothing


def check_smoothing(smoothing: Smoothing, interval_s: float, recordings: Iterable[Recording]) -> None:
    """What would fail after the last frame fails before the first one.

    Args:
        smoothing: what is asked for.
        interval_s: from one frame to the next, seconds.
        recordings: what is written, and so what there is to smooth.

    Raises:
        ConfigError: the raw result lacks what is smoothed, or see `tracker.smoothing.Smoothing.check`.
    """
    smoothing.check(interval_s)
    uses = {component_name(type(recording)) for recording in recordings}
    if missing := {"journal", "run_json"} - uses:
        raise ConfigError(f"smoothing needs the recordings journal and run_json; add {', '.join(sorted(missing))}")


def smoothed(outcome: TrackOutcome, smoothing: Smoothing) -> TrackOutcome:
    """The outcome with the smooth result beside the raw one, in place of that of an interrupted run."""
    shutil.rmtree(outcome.folder / FOLDER, ignore_errors=True)
    folder = write_smoothed(load_result(outcome.folder), smoothing)
    return replace(outcome, files=(*outcome.files, folder))
