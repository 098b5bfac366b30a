"""The smooth result of a tracking job, beside the raw one."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Iterable
from dataclasses import replace

from tracker.foundation.configuration.tables import component_name
from tracker.foundation.errors import ConfigError
from tracker.results.recording import Recording
from tracker.results.recording.journal import FILE as JOURNAL
from tracker.results.result import load_result
from tracker.results.smoothed_result import FOLDER, Pictures, write_smoothed
from tracker.results.smoothing import Smoothing
from tracker.running.jobs._recorded import TrackOutcome

_SHOWN = "report", "overlay"

log = logging.getLogger("tracker")


def check_smoothing(smoothing: Smoothing, interval_s: float, recordings: Iterable[Recording]) -> None:
    """What would fail after the last frame fails before the first one.

    Args:
        smoothing: what is asked for.
        interval_s: from one frame to the next, seconds.
        recordings: what is written, and so what there is to smooth.

    Raises:
        ConfigError: the raw result lacks what is smoothed, or see `tracker.results.smoothing.Smoothing.check`.
    """
    smoothing.check(interval_s)
    uses = {component_name(type(recording)) for recording in recordings}
    if missing := {"journal", "run_json"} - uses:
        raise ConfigError(f"smoothing needs the recordings journal and run_json; add {', '.join(sorted(missing))}")


def smoothed(outcome: TrackOutcome, smoothing: Smoothing, pictures: Pictures) -> TrackOutcome:
    """The outcome with the smooth result beside the raw one, in place of that of an interrupted run.

    It has a report and an overlay if the raw one has; after an interruption nobody waits for them.
    Of a run that was interrupted in its first window, which is kept when it has been tracked back, there is none yet.
    """
    shutil.rmtree(outcome.folder / FOLDER, ignore_errors=True)
    if outcome.interrupted and not (outcome.folder / JOURNAL).stat().st_size:
        log.warning("not smoothed: no frame is kept before its window has been tracked back")
        return outcome
    shown = [one for one in pictures.recordings if component_name(type(one)) in _SHOWN]
    drawn = None if outcome.interrupted or not shown else replace(pictures, recordings=tuple(shown))
    folder = write_smoothed(load_result(outcome.folder), smoothing, pictures=drawn)
    return replace(outcome, files=(*outcome.files, folder))
