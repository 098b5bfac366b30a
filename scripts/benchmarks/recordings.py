"""Every recording in BODYTRACK_DATA that has a truth, from several starts: the median beside the worst."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.checkout import Code
from benchmarks.detected_joints import print_beside
from benchmarks.recorded import Recorded, recorded
from benchmarks.recording_run import Asked, folder_of, scored
from benchmarks.scores import Score, add_scores, by_person, read_scores
from benchmarks.scores_picture import draw
from benchmarks.start_scores import print_starts

# Enough to compile, start, and track.
_QUICK_FRAMES = 4
_Value = Callable[[Score], float]
_ERRORS: dict[str, tuple[_Value, str]] = {
    "joints mm": (lambda one: one.mean_mm, ".0f"),
    "offsets removed": (lambda one: one.removed_mm, ".0f"),
    "in trunk's axes": (lambda one: one.turned_mm, ".0f"),
    "< 100 mm %": (lambda one: 100 * one.under_100, ".0f"),
    "elbows deg": (lambda one: one.elbows_deg, ".1f"),
    "offset removed": (lambda one: one.elbows_removed_deg, ".1f"),
    "knees deg": (lambda one: one.knees_deg, ".1f"),
    "offset removed ": (lambda one: one.knees_removed_deg, ".1f"),
    "over told sigma: joints": (lambda one: one.joints_over_sigma, ".1f"),
    "elbows": (lambda one: one.elbows_over_sigma, ".1f"),
    "knees": (lambda one: one.knees_over_sigma, ".1f"),
}
_FLAGS: dict[str, tuple[_Value, str]] = {
    "lost": (lambda one: one.lost, ".0f"),
    "> 100 mm, no flag": (lambda one: one.wrong - one.wrong_flagged, ".0f"),
    "flagged": (lambda one: one.wrong_flagged, ".0f"),
    "joint > 150 mm, no flag": (lambda one: one.limb_off - one.limb_off_flagged, ".0f"),
    "flagged ": (lambda one: one.limb_off_flagged, ".0f"),
    "false flags": (lambda one: one.false_flags, ".0f"),
    "start confidence": (lambda one: one.confidence, ".2f"),
}
_TIMES: dict[str, tuple[_Value, str]] = {
    "CPU s": (lambda one: one.cpu_s, ".0f"),
    "CPU ms a frame": (lambda one: 1000 * one.cpu_s / max(one.n_frames, 1), ".0f"),
    "its frames, median": (lambda one: 1000 * one.frame_s, ".0f"),
    "slowest tenth": (lambda one: 1000 * one.slow_frame_s, ".0f"),
}
_LEGEND = (
    "median / worst of the starts. Errors over the frames not lost; < 100 mm: share of all frames that have a pose so "
    "near on average; flag: the frame is doubtful, or that joint ambiguous. CPU: all threads, with reading and start; "
    "that of single frames is known with --set passes=1 alone"
)
_MORE_IS_BETTER = "< 100 mm %", "start confidence"


@dataclass(frozen=True)
class Plan:
    """What the command line asks for."""

    only: str
    models: tuple[str, ...]
    acquired: bool
    plates: bool
    n_starts: int
    settings: tuple[str, ...]
    quick: bool
    keypoints: bool = False
    """Only recordings with 2-D detections; these are evidence beside the default, and what starts."""

    def runs(self, recordings: list[Recorded]) -> Iterator[tuple[Recorded, Asked]]:
        """All that is run: every recording once, before the next start."""
        chosen = [one for one in recordings if self.only.lower() in one.name.lower()]
        chosen = [one for one in chosen if one.plates or not self.plates]
        chosen = [one for one in chosen if one.keypoints or not self.keypoints]
        for k in range(self.n_starts):
            for model in self.models:
                for one in chosen[:1] if self.quick else chosen:
                    starts = one.starts(self.n_starts)
                    if k < len(starts):
                        stop = min(starts[k] + _QUICK_FRAMES, one.n_frames) if self.quick else one.n_frames
                        settings = (*(one.with_keypoints() if self.keypoints else ()), *self.settings)
                        yield one, Asked(model, self.acquired, self.plates, settings, starts[k], stop)


def compare(console: Console, plan: Plan, checkout: Path, output: Path) -> None:
    """Runs what is planned and has not been run yet, and prints the tables.

    Args:
        console: where to.
        plan: what is run.
        checkout: whose package is run.
        output: keeps each run's folder, the acquired models and `scores.csv`.
    """
    if "BODYTRACK_DATA" not in os.environ:
        console.print("BODYTRACK_DATA is not set: no recordings to track")
        return
    os.nice(10)
    recordings, left_out = recorded(Path(os.environ["BODYTRACK_DATA"]).resolve())
    for line in left_out:
        console.print(line, highlight=False, soft_wrap=True)
    runs, code = list(plan.runs(recordings)), Code(checkout.resolve())
    if not runs:
        names = ", ".join(one.name for one in recordings) or "none"
        console.print(f"nothing to track: of the recordings there ({names}) none is what is asked for", soft_wrap=True)
        return
    output.mkdir(parents=True, exist_ok=True)
    table = output / "scores.csv"
    scores: list[Score] = []
    with suppress(KeyboardInterrupt):
        for n, (recording, asked) in enumerate(runs, start=1):
            begin = time.perf_counter()
            found = known(table, recording, asked, code)
            if not found:
                with console.status(f"{n} of {len(runs)}: {_title(recording, asked)}"):
                    found = scored(recording, asked, code, output.resolve())
                add_scores(table, found)
            scores += found
            for one in found:
                _tell(console, f"{n} of {len(runs)}: {_title(recording, asked)}", one, time.perf_counter() - begin)
    if scores:
        _print(console, scores, code)
        print_starts(console, scores)
        draw(scores, output / "scores.png")
        console.print(f"as a picture: {output / 'scores.png'}", highlight=False, soft_wrap=True)
    if plan.keypoints:
        print_beside(console, [(one, asked, folder_of(one, asked, code, output) / "result") for one, asked in runs])


def _title(recording: Recorded, asked: Asked) -> str:
    return f"{recording.name}, {asked.model}{', acquired' if asked.acquired else ''}, from frame {asked.start}"


def _tell(console: Console, title: str, score: Score, seconds: float) -> None:
    found = score.failed or (
        f"{score.person} {score.mean_mm:.0f} ({score.removed_mm:.0f}) mm, {score.lost} lost, "
        f"{score.limb_off} with a joint off, {score.limb_off_flagged} of them flagged"
    )
    console.print(f"{title}: {found}, {seconds:.0f} s", highlight=False, soft_wrap=True, markup=False)


def known(table: Path, recording: Recorded, asked: Asked, code: Code) -> list[Score]:
    """Rows of the same run by the same code."""
    told = asked.told
    wanted = recording.name, asked.model, asked.acquired, asked.plates, told, asked.start, asked.stop, code.digest
    return [row for row in read_scores(table) if row.key == tuple(map(str, wanted))]


def _print(console: Console, scores: list[Score], code: Code) -> None:
    for title, columns in (("errors", _ERRORS), ("flags", _FLAGS), ("time", _TIMES)):
        table = Table(title=f"{title}, commit {code.commit} ({code.digest})", title_justify="left")
        for name in ("recording", "model", "starts"):
            table.add_column(name, no_wrap=True)
        for name in columns:
            table.add_column(name, justify="right")
        for label, group in _grouped(scores).items():
            table.add_row(*label, *_cells(group, columns))
        console.print(table)
    console.print(_LEGEND, style="dim", soft_wrap=True)
    for one in scores:
        if one.failed or one.exchanged:
            what = one.failed or f"{one.person} is in the place of {one.exchanged}"
            console.print(
                f"{one.recording}, {one.model}, from frame {one.start}: {what}", highlight=False, markup=False
            )


def _grouped(scores: list[Score]) -> dict[tuple[str, str, str], list[Score]]:
    """Rows of the same person and model, by their labels."""
    groups: dict[tuple[str, str], list[Score]] = {}
    persons = by_person(sorted(scores, key=lambda one: (one.recording, one.model, one.start)))
    n_persons = Counter(recording for recording, _ in persons)
    for (recording, person), rows in persons.items():
        name = f"{recording} {person}" if n_persons[recording] > 1 else recording
        for one in rows:
            groups.setdefault((name, one.model), []).append(one)
    return {(*label, " ".join(str(one.start) for one in group)): group for label, group in groups.items()}


def _cells(group: list[Score], columns: dict[str, tuple[_Value, str]]) -> list[str]:
    good = [one for one in group if not one.failed]
    # who is lost throughout has no errors, which must not make the worst look better
    gone = [one.is_lost_throughout for one in good] if columns is _ERRORS else [False]
    cells = []
    for name, (value, shown) in columns.items():
        values = [value(one) for one in good]
        if np.isfinite(values).any():
            worst = np.nanmin(values) if name in _MORE_IS_BETTER else np.nanmax(values)
            hidden = any(gone) and not np.isfinite(values).all()
            told = "failed" if len(good) < len(group) else "lost" if hidden else f"{worst:{shown}}"
            cells.append(f"{np.nanmedian(values):{shown}} / {told}")
        else:
            cells.append("failed" if not good else "lost" if all(gone) else "-")
    return cells
