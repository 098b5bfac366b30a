"""What each rule that steers tracking is worth: the same runs with it and without."""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.checkout import Code
from benchmarks.recorded import Recorded, recorded
from benchmarks.recording_run import Asked, folder_of, scored
from benchmarks.recordings import known
from benchmarks.scores import Score, add_scores
from benchmarks.switched_run import FILE
from benchmarks.switches import GROUPS, RULES, chosen

_TURNED = 'initialization={use="pca",hypotheses=1,turn_step_deg=90.0}'
"""A start that is often wrong: the first of few."""


@dataclass(frozen=True)
class Condition:
    """Frames of a recording, and how they are seen."""

    name: str
    recording: str
    first: int
    n_frames: int
    plates: bool = True
    two_views: bool = False
    keypoints: bool = False
    settings: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """What it is called."""
        return f"{self.name}, {self.recording}"

    def asked(self, recording: Recorded, start: int) -> Asked:
        """The run with all rules, begun some frames later."""
        settings = (*(recording.with_keypoints() if self.keypoints else ()), *self.settings)
        if self.two_views:
            settings = (*settings, f"reading.views={json.dumps(_two_of(recording))}")
        first = self.first + start
        stop = min(first + self.n_frames, recording.n_frames)
        return Asked("human", False, self.plates, settings, first, stop, counted=True)


CONDITIONS = (
    Condition("plates", "R-Turn", 0, 40),
    Condition("plates", "T-Punch-light", 0, 40),
    Condition("plates", "V-Dance", 20, 40),
    Condition("no plates", "K-Kick", 20, 40, plates=False),
    Condition("no plates", "R-Turn", 30, 40, plates=False),
    Condition("two cameras", "K-Kick", 0, 40, two_views=True),
    Condition("two cameras", "N-Stride", 0, 40, two_views=True),
    Condition("bad start", "D-TwoElbowRot", 0, 40, settings=(_TURNED,)),
    Condition("bad start", "V-Dance", 0, 40, settings=(_TURNED,)),
    Condition("keypoints", "P-Floor", 0, 40, plates=False, keypoints=True),
    Condition("two persons", "DO-Two", 20, 30),
    Condition("8 frames a second", "K-Kick", 0, 80, settings=("reading.stride=3",)),
    Condition("8 frames a second", "V-Dance", 0, 90, settings=("reading.stride=3",)),
)
"""Hard stretches of recordings; half of the rules were made for one of these, none for all."""

_STEP = 3
"""Frames between the starts of one condition: what a start tells of chance."""


def _two_of(recording: Recorded) -> list[str]:
    """The first and the second view by name: in the room they face each other, 150 degrees apart, except for one."""
    before, _, behind = Path(str(recording.reading["path"])).name.partition("{view}")
    return [path.name[len(before) : -len(behind)] for path in recording.videos()][:2]


_FRAMES: tuple[Callable[[Score], int], ...] = (
    lambda one: one.limb_off,
    lambda one: one.limb_off - one.limb_off_flagged,
    lambda one: one.false_flags,
    lambda one: one.lost,
)
"""off, silent, false, lost: frames of a run."""


@dataclass(frozen=True)
class Run:
    """A condition from a start, without some rules."""

    condition: Condition
    without: str
    scores: tuple[Score, ...]
    asked: dict[str, int]
    noticed: dict[str, int]


def compare(console: Console, rules: str, only: str, n_starts: int, checkout: Path, output: Path) -> None:
    """Runs what has not been run yet, and prints a row a rule or group.

    Args:
        console: where to.
        rules: names and groups, commas between; each is switched off by itself, those joined by `+` together.
        only: conditions and recordings whose name holds this.
        n_starts: runs of each condition, some frames apart.
        checkout: whose package is run; it must have the rules.
        output: keeps each run's folder and `scores.csv`.
    """
    if "BODYTRACK_DATA" not in os.environ:
        console.print("BODYTRACK_DATA is not set: no recordings to track")
        return
    wanted = rules.split(",") if rules else list(GROUPS)
    for words in wanted:
        chosen(words)
    os.nice(10)
    found = {one.name: one for one in recorded(Path(os.environ["BODYTRACK_DATA"]).resolve())[0]}
    conditions = [one for one in CONDITIONS if one.recording in found and only.lower() in one.title.lower()]
    code, runs = Code(checkout.resolve()), list[Run]()
    output.mkdir(parents=True, exist_ok=True)
    plan = [(one, k, words) for k in range(n_starts) for one in conditions for words in ("", *wanted)]
    with suppress(KeyboardInterrupt):
        for n, (condition, k, words) in enumerate(plan, start=1):
            begin, told = time.perf_counter(), f"{n} of {len(plan)}: {condition.title}, {k}"
            if (same := _unchanged(runs, condition, words)) is not None:
                runs.append(same)
                continue
            with console.status(f"{told}, without {words or 'nothing'}"):
                runs.append(_run(condition, k, words, found[condition.recording], code, output))
            mm = [f"{one.failed or f'{one.mean_mm:.1f} ({one.removed_mm:.1f}) mm'}" for one in runs[-1].scores]
            seconds = time.perf_counter() - begin
            console.print(f"{told}, without {words or 'nothing'}: {', '.join(mm)}, {seconds:.0f} s", highlight=False)
    console.print(_table(runs, wanted, code))
    console.print(
        "asked: in runs with all rules; made a difference: returned something else than without it. The rest: sums and "
        "worst over conditions and starts, without the rule less with it; spread: largest change of a mean between "
        "starts that are three frames apart. off, silent, false: frames, as `recordings` has them",
        style="dim",
        soft_wrap=True,
    )


def _unchanged(runs: Sequence[Run], condition: Condition, words: str) -> Run | None:
    """The run with all rules under another name, where those to be left out made no difference in it: runs repeat."""
    with_all = next((one for one in reversed(runs) if not one.without), None)
    if not words or with_all is None or with_all.condition != condition or not with_all.asked:
        return None
    if any(with_all.noticed.get(rule.name, 0) for rule in chosen(words)):
        return None
    return replace(with_all, without=words, asked={}, noticed={})


def _run(condition: Condition, k: int, without: str, recording: Recorded, code: Code, output: Path) -> Run:
    asked = replace(condition.asked(recording, k * _STEP), without=without)
    scores = known(output / "scores.csv", recording, asked, code)
    if not scores:
        scores = scored(recording, asked, code, output.resolve())
        add_scores(output / "scores.csv", scores)
    counted = folder_of(recording, asked, code, output) / FILE
    told = json.loads(counted.read_text(encoding="utf-8")) if counted.is_file() else {"asked": {}, "noticed": {}}
    return Run(condition, without, tuple(scores), told["asked"], told["noticed"])


def _table(runs: Sequence[Run], wanted: Sequence[str], code: Code) -> Table:
    table = Table(title=f"what rules are worth, commit {code.commit}", title_justify="left")
    columns = "asked", "made a difference", "mm", "worst mm", "spread", "off", "silent", "false", "lost", "CPU %"
    table.add_column("without", no_wrap=True)
    for name in columns:
        table.add_column(name, justify="right")
    for words in wanted:
        table.add_row(words, *_cells(runs, words))
    return table


def _cells(runs: Sequence[Run], words: str) -> Iterator[str]:
    """Those of a row: counts of the rules, and what is different without them."""
    asked, noticed = Counter[str](), Counter[str]()
    for run in runs:
        if not run.without:
            asked.update(run.asked)
            noticed.update(run.noticed)
    names = {rule.name for rule in chosen(words)}
    yield str(sum(asked[name] for name in names))
    yield str(sum(noticed[name] for name in names))
    pairs = list(zip(_persons(runs, ""), _persons(runs, words), strict=False))
    if not pairs:
        yield from ("-",) * 8
        return
    more = np.array([other.mean_mm - one.mean_mm for one, other in pairs])
    yield f"{np.nanmean(more):+.1f}"
    yield f"{np.nanmax(more):+.1f}"
    yield f"{_spread(runs):.1f}"
    for value in _FRAMES:
        yield f"{sum(value(other) for _, other in pairs) - sum(value(one) for one, _ in pairs):+d}"
    spent = sum(one.cpu_s for one, _ in pairs), sum(other.cpu_s for _, other in pairs)
    yield f"{100 * (spent[1] / max(spent[0], 1e-9) - 1):+.0f}"


def _persons(runs: Sequence[Run], without: str) -> list[Score]:
    """Scores of the runs without some rules, in the order of the plan."""
    return [score for run in runs if run.without == without for score in run.scores]


def _spread(runs: Sequence[Run]) -> float:
    """The largest difference between starts of the same condition, with all rules, mm."""
    means: dict[tuple[Condition, str], list[float]] = {}
    for run in runs:
        if not run.without:
            for score in run.scores:
                means.setdefault((run.condition, score.person), []).append(score.mean_mm)
    return float(np.nanmax([np.ptp(one) for one in means.values()], initial=0.0))


def rules_as_text() -> str:
    """Group, name and what it does of all rules, a line each."""
    return "\n".join(f"{rule.group}: {rule.name}: {rule.about}" for rule in RULES)
