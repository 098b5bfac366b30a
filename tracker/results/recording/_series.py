"""Numbers collected over a run."""

from __future__ import annotations

import io
import itertools
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.evidence.measures.account import hidden_limbs
from tracker.foundation.arrays import Array
from tracker.results.recording._drawing import STATUS_COLOURS
from tracker.tracking.doubt import Because, Doubt, in_words
from tracker.tracking.doubts import Judged, reasons_in, worst_first
from tracker.tracking.estimate import Status
from tracker.tracking.trajectory import Step

AMBIGUOUS = "limb ambiguous"
"""State of a frame in which a limb is ambiguous and nothing worse is the case."""

_GRAVE = Status.DOUBTFUL, Status.LOST


@dataclass(frozen=True)
class Bad:
    """A frame to check."""

    frame: int
    time_s: float
    person: str
    status: str
    why: str
    """The reasons; empty without a doubt."""

    explained: float
    distance_px: float


@dataclass(frozen=True)
class Stretch:
    """Consecutive frames with the same state of a person."""

    share: float
    """Times of the run."""

    state: str
    """A status, or `AMBIGUOUS` if only a limb is ambiguous."""

    first: int
    last: int
    """Numbers of the first and the last frame."""

    why: str
    """The reasons of all its frames; empty without a doubt."""


@dataclass
class Series:
    """Per-frame numbers of all persons; the state of a recorder that plots."""

    scene: Scene
    frames: list[int] = field(default_factory=list)
    times_s: list[float] = field(default_factory=list)
    poses: list[list[Array]] = field(default_factory=list)
    sigmas: list[list[Array]] = field(default_factory=list)
    distances: list[list[float]] = field(default_factory=list)
    explained: list[list[float]] = field(default_factory=list)
    statuses: list[list[str]] = field(default_factory=list)
    ambiguous: list[list[tuple[str, ...]]] = field(default_factory=list)
    reasons: list[list[tuple[Doubt, ...]]] = field(default_factory=list)
    why: Counter[tuple[str, Because]] = field(default_factory=Counter)
    """Doubtful limb or person, and reason -> frames."""

    n_in_doubt: int = 0
    """Frames with any doubt."""

    hidden: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    """View -> limb -> frames in which something hid it there."""

    overlaps: list[Array] = field(default_factory=list)
    seconds: list[dict[str, float]] = field(default_factory=list)
    missing: Counter[str] = field(default_factory=Counter)
    untrusted: Counter[str] = field(default_factory=Counter)
    starts: dict[str, dict[str, float]] = field(default_factory=dict)
    """Person -> frame and confidence of the first start."""

    strangers: int = 0
    """Frames in which another person was beside the tracked ones."""

    def add(self, step: Step) -> None:
        """Takes the numbers of one frame."""
        self.frames.append(step.frame.index)
        self.times_s.append(step.frame.time_s)
        self.poses.append([estimate.q for estimate in step.estimates])
        self.sigmas.append([np.sqrt(np.maximum(np.diag(e.covariance), 0)) for e in step.estimates])
        self.distances.append([estimate.distance_px for estimate in step.estimates])
        self.explained.append([estimate.account.explained for estimate in step.estimates])
        self.statuses.append([str(estimate.verdict) for estimate in step.estimates])
        self.ambiguous.append([estimate.ambiguous for estimate in step.estimates])
        self.reasons.append([estimate.reasons for estimate in step.estimates])
        self.why.update(reasons_in(step))
        self.n_in_doubt += any(estimate.doubts for estimate in step.estimates)
        for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
            for v, limb in hidden_limbs(person.body, estimate.account):
                self.hidden[self.scene.rig.names[v]][limb] += 1
        missing = np.full(len(self.scene.rig), np.nan)
        self.overlaps.append(missing if step.overlap is None else step.overlap)
        self.seconds.append(step.seconds)
        self.missing.update(self.scene.rig.names[v] for v in step.frame.missing)
        self.untrusted.update(self.scene.rig.names[v] for v in step.untrusted)
        self.strangers += step.strangers
        if not self.starts:
            told = zip(step.scene.persons, step.start_confidence, strict=False)
            self.starts = {who.name: {"frame": step.frame.index, "confidence": round(sure, 3)} for who, sure in told}

    def spans(self) -> Array:
        """(T, 2) begin and end of the time that each frame stands for, seconds: half-way to its neighbours."""
        times = np.array(self.times_s)
        if len(times) < 2:
            return np.stack([times - 0.5, times + 0.5], axis=1)
        between = (times[1:] + times[:-1]) / 2
        edges = np.concatenate([[2 * times[0] - between[0]], between, [2 * times[-1] - between[-1]]])
        return np.stack([edges[:-1], edges[1:]], axis=1)

    def shown(self, person: int) -> Array:
        """(T, dof) pose parameters in degrees and metres; NaN in lost frames."""
        body = self.scene.persons[person].body
        values = np.array([poses[person] for poses in self.poses])
        lost = np.array([statuses[person] == "lost" for statuses in self.statuses])
        shown: Array = np.where(lost[:, None], np.nan, np.where(body.rotates, np.degrees(values), values))
        return shown

    def mean_overlap(self) -> dict[str, float]:
        """Mean silhouette IoU of each view that has one."""
        overlaps = np.array(self.overlaps)
        return {
            name: float(np.nanmean(overlaps[:, v]))
            for v, name in enumerate(self.scene.rig.names)
            if len(overlaps) and np.isfinite(overlaps[:, v]).any()
        }

    def strips(self) -> list[tuple[str, list[Stretch]]]:
        """Name of each person, and the states of the run, one after the other."""
        return [(person.name, list(self._stretches(k))) for k, person in enumerate(self.scene.persons)]

    def _stretches(self, k: int) -> Iterator[Stretch]:
        lasting = np.diff(self.spans())[:, 0]
        shares = lasting / lasting.sum()
        rows = zip(self.statuses, self.ambiguous, strict=True)
        states = [AMBIGUOUS if limbs[k] and told[k] not in _GRAVE else told[k] for told, limbs in rows]
        for state, run in itertools.groupby(range(len(states)), key=states.__getitem__):
            own = list(run)
            why = in_words(dict.fromkeys(Doubt(one.limb, one.because) for t in own for one in self.reasons[t][k]))
            yield Stretch(float(shares[own].sum()), state, self.frames[own[0]], self.frames[own[-1]], why)

    def worst(self, n_most: int = 12) -> list[Bad]:
        """Frames to check, the worst first: lost, doubtful, with ambiguous limbs, then least explained."""
        judged = [
            [Judged(status, len(limbs), share) for status, limbs, share in zip(*row, strict=True)]
            for row in zip(self.statuses, self.ambiguous, self.explained, strict=True)
        ]
        return [self._bad(t, k) for t, k in worst_first(self.times_s, judged, n_most)]

    def _bad(self, t: int, k: int) -> Bad:
        told = self.frames[t], self.times_s[t], self.scene.persons[k].name, self.statuses[t][k]
        return Bad(*told, in_words(self.reasons[t][k]), self.explained[t][k], self.distances[t][k])

    def summary(self) -> dict[str, Any]:
        """Headline numbers of the run so far; means are over the poses found, None without one."""
        if not self.frames:
            return {"frames": 0}
        stages = Counter[str]()
        for seconds in self.seconds:
            stages.update(seconds)
        total = sum(stages.values())
        counts = Counter(status for statuses in self.statuses for status in statuses)
        found = np.array(self.statuses) != Status.LOST
        return {
            "frames": len(self.frames),
            "persons": len(self.scene.persons),
            "by_status": dict(counts),
            "ambiguous_limbs": dict(Counter(limb for frame in self.ambiguous for limbs in frame for limb in limbs)),
            "frames_with_ambiguous_limbs": sum(any(frame) for frame in self.ambiguous),
            "doubts_by_reason": dict(Counter(str(one.because) for row in self.reasons for own in row for one in own)),
            "limbs_hidden_from_views": {view: dict(limbs) for view, limbs in self.hidden.items()},
            "mean_distance_px": _mean(np.array(self.distances)[found]),
            "mean_explained": _mean(np.array(self.explained)[found]),
            "frames_per_second": len(self.frames) / total if total else 0.0,
            "seconds_per_frame_by_stage": {k: v / len(self.frames) for k, v in stages.items()},
            "silhouette_iou": self.mean_overlap(),
            "frames_without_image": dict(self.missing),
            "frames_without_trusted_foreground": dict(self.untrusted),
            "frames_with_strangers": self.strangers,
            "starts": self.starts,
        }


def _mean(values: Array) -> float | None:
    return float(np.mean(values)) if values.size else None


# Plots of the numbers collected over a run.

_MARKERS = {"abduction": "x", "elevation": "o", "twist": "+", "extension": "*"}
_LINES = {"x": ":", "y": "-.", "z": "-"}

_LEAST_DEG, _LEAST_M = 30.0, 0.2
"""Least range of a panel of parameters."""

_WIDE, _BELOW = 9.0, 0.5
"""Inches: a figure's width, and margins below and above the panels for numbers and a title."""

_SIGN, _MOST_SIGNS = 0.075, 16
"""Inches of a letter of a name in a legend, and largest number of letters."""

_USUAL_PX = 10.0
"""Least range of the distances shown: two runs compare at a glance."""


def panels(body: BodyModel) -> list[tuple[str, list[int]]]:
    """Parameters for each panel: those of one limb, named by their common words."""
    grouped: dict[str, list[int]] = {}
    for k, name in enumerate(body.names):
        grouped.setdefault(name.rpartition("_")[0] or body.name, []).append(k)
    root = np.flatnonzero(body.moves[:, body.part_parameters].all(axis=1))
    return sorted(grouped.items(), key=lambda panel: min(panel[1]) in root)


def parameter_figure(series: Series, person: int) -> Figure:
    """Pose parameters against time, a panel a limb, with the paper's signs of figure 8."""
    who: Person = series.scene.persons[person]
    shown, chosen = series.shown(person), panels(who.body)
    figure, axes = _stacked(2.3, len(chosen))
    for axis, (title, columns) in zip(axes, chosen, strict=True):
        _shade_doubts(axis, series, person)
        metres = None
        for k in columns:
            parameter = who.body.parameters[k]
            short = parameter.name.rpartition("_")[2]
            if parameter.rotates:
                marker = _MARKERS.get(short, ".")
                axis.plot(series.times_s, shown[:, k], marker=marker, ms=4, lw=0.7, mfc="none", label=short)
            else:
                metres = metres or axis.twinx()
                metres.plot(series.times_s, shown[:, k], "k", ls=_LINES.get(short, "--"), lw=1, label=f"{short} (m)")
        axis.set_ylabel(f"{title.replace('_', ' ')}\ndegrees")
        _legend(axis, metres)
        _at_least(axis, _LEAST_DEG)
        if metres is not None:
            _at_least(metres, _LEAST_M)
    _label_time(axes, series)
    return figure


def png_of(figure: Figure, dpi: float) -> bytes:
    """A figure as the content of a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def _stacked(panel_inches: float, n_panels: int, names: Iterable[str] = ()) -> tuple[Figure, list[Axes]]:
    """A figure of panels one above the other, with room for labels and, at the right, for a second axis and legends.

    Margins are fixed: finding them by drawing everything twice took a third of a figure's time.

    Args:
        panel_inches: height of each.
        n_panels: their number.
        names: in the legends; long names widen the figure.
    """
    height, longest = panel_inches * n_panels, max(map(len, names), default=0)
    width = _WIDE + _SIGN * max(0, longest - _MOST_SIGNS)
    figure = Figure(figsize=(width, height))
    axes = figure.subplots(n_panels, 1, sharex=True, squeeze=False)[:, 0]
    left, right = 0.09 * _WIDE / width, 0.8 * _WIDE / width
    figure.subplots_adjust(left, _BELOW / height, right, 1 - _BELOW / height, hspace=0.12)
    return figure, list(axes)


def _at_least(axis: Axes, extent: float) -> None:
    """Widens the range of an axis, so that jitter of a standing person does not look like movement."""
    low, high = axis.get_ylim()
    if high - low < extent:
        axis.set_ylim((low + high - extent) / 2, (low + high + extent) / 2)


def _legend(axis: Axes, metres: Axes | None) -> None:
    handles, labels = axis.get_legend_handles_labels()
    if metres is not None:
        metres.set_ylabel("metres")
        more, names = metres.get_legend_handles_labels()
        handles, labels = handles + more, labels + names
    axis.legend(handles, labels, loc="upper left", bbox_to_anchor=(1.1, 1), fontsize=8, frameon=False)
    axis.grid(alpha=0.3)


def _shade_doubts(axis: Axes, series: Series, person: int) -> None:
    for (begin, end), statuses in zip(series.spans(), series.statuses, strict=True):
        if statuses[person] in (Status.LOST, Status.DOUBTFUL):
            axis.axvspan(begin, end, color=STATUS_COLOURS[Status(statuses[person])], alpha=0.25, lw=0)


def _label_time(axes: Iterable[Axes], series: Series) -> None:
    """Seconds below, and above them the frame numbers of the tables."""
    panels_in_order = list(axes)
    panels_in_order[-1].set_xlabel("time, s")
    places = np.unique(np.linspace(0, len(series.frames) - 1, min(len(series.frames), 9)).round().astype(int))
    above = panels_in_order[0].secondary_xaxis("top")
    above.set_xticks([series.times_s[k] for k in places], [str(series.frames[k]) for k in places])
    above.set_xlabel("frame")


def distance_figure(series: Series) -> Figure:
    """The distance that ranks poses, explained share and silhouette overlap against time."""
    overlaps = np.array(series.overlaps)
    n_panels = 3 if np.isfinite(overlaps).any() else 2
    names = [*(person.name for person in series.scene.persons), *series.scene.rig.names]
    figure, axes = _stacked(2.2, n_panels, names)
    for k, person in enumerate(series.scene.persons):
        axes[0].plot(series.times_s, np.array(series.distances)[:, k], lw=1, label=person.name)
        axes[1].plot(series.times_s, 100 * np.array(series.explained)[:, k], lw=1, label=person.name)
        _shade_doubts(axes[0], series, k)
    axes[0].set_ylabel("distance\npx")
    axes[1].set_ylabel("contour explained\n%")
    if n_panels == 3:
        for v, name in enumerate(series.scene.rig.names):
            axes[2].plot(series.times_s, overlaps[:, v], lw=1, label=name)
        axes[2].set_ylabel("silhouette IoU")
        axes[2].set_ylim(0, 1)
    axes[0].set_ylim(0, max(_USUAL_PX, 1.05 * float(np.nanmax(series.distances))))
    axes[1].set_ylim(0, 100)
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False)
    _label_time(axes, series)
    return figure
