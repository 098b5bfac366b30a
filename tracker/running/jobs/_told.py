"""What a tracking run tells of itself: what components chose by themselves, and what looks wrong in the input."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from pathlib import Path

from tracker.foundation.errors import ConfigError
from tracker.foundation.progress import WARNING, Progress
from tracker.foundation.source_files import json_of
from tracker.results.recording import RunContext
from tracker.running.jobs import Job, ResultFolder, described, versions
from tracker.running.jobs._delivered import chosen_settings
from tracker.running.jobs._persons import OpenedTrack

log = logging.getLogger("tracker")


class Findings:
    """What looks wrong in the input of a run, told as soon as it is found."""

    def __init__(self, wanted: bool, progress: Progress, earlier: Iterable[str] = ()) -> None:
        self.lines = list(earlier)
        """All that was told so far, each once; it grows while the run goes on."""

        self._wanted, self._progress = wanted, progress

    def add(self, found: Iterable[str]) -> None:
        """Tells more of it, one line each; nothing where the input is not to be looked at."""
        for line in found if self._wanted else ():
            log.warning("%s%s", WARNING, line)
            self._progress(f"{WARNING}{line}")
            if line not in self.lines:  # a resumed run may find again what it has told before
                self.lines.append(line)


def told_before(folder: Path) -> tuple[str, ...]:
    """What an interrupted run has found in its input; nothing if it has kept no `run.json` that can be read."""
    try:
        return tuple(map(str, json_of(folder / "run.json", ConfigError)["findings"]))
    except (ConfigError, KeyError, TypeError):
        return ()


def tell_choices(choices: Mapping[str, str], progress: Progress) -> None:
    """Says what was chosen by itself, if anything was.

    Args:
        choices: stage -> what it goes by; empty where the configuration says it.
        progress: told of each.
    """
    for stage, choice in choices.items():
        if choice:
            log.info("%s: %s", stage, choice)
            progress(f"{stage}: {choice}")


def run_context(
    job: Job, opened: OpenedTrack, folder: ResultFolder, choices: Mapping[str, str], findings: Findings
) -> RunContext:
    """What recordings need to know of a run, and keep with its result.

    Args:
        job: what is done.
        opened: its recording, and the persons with the bodies that they are tracked with.
        folder: where results go.
        choices: as of `tell_choices`.
        findings: those so far; those to come are kept as well.
    """
    sequence = opened.sequence
    details = {
        "config": described(job),
        "choices": {stage: choice for stage, choice in choices.items() if choice},
        "versions": versions(),
        "inputs": dict(folder.inputs),
        "findings": findings.lines,
        "bodies": {name: model.about for name, model in opened.models.items()},
    }
    if chosen := chosen_settings(getattr(job, "reading", None), sequence):
        details["images"] = chosen
    return RunContext(
        name=job.name,
        folder=folder.path,
        scene=opened.scene,
        fps=sequence.fps,
        interval_s=sequence.interval_s,
        n_frames=sequence.n_frames,
        details=details,
        resumed=frozenset(opened.done or ()),
    )
