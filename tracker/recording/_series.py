"""Numbers collected over a run, and their plots."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tracker.arrays import Array
from tracker.body import BodyModel
from tracker.estimate import Status
from tracker.recording._drawing import STATUS_COLOURS
from tracker.scene import Person, Scene
from tracker.trajectory import Step

_MARKERS = {"abduction": "x", "elevation": "o", "twist": "+", "extension": "*"}
_LINES = {"x": ":", "y": "-.", "z": "-"}


@dataclass
class Series:
    """Per-frame numbers of all persons; the state of a recorder that plots."""

    scene: Scene
    frames: list[int] = field(default_factory=list)
    poses: list[list[Array]] = field(default_factory=list)
    sigmas: list[list[Array]] = field(default_factory=list)
    distances: list[list[float]] = field(default_factory=list)
    explained: list[list[float]] = field(default_factory=list)
    statuses: list[list[str]] = field(default_factory=list)
    overlaps: list[Array] = field(default_factory=list)
    seconds: list[dict[str, float]] = field(default_factory=list)
    missing: Counter[str] = field(default_factory=Counter)

    def add(self, step: Step) -> None:
        """Takes the numbers of one frame."""
        self.frames.append(step.frame.index)
        self.poses.append([estimate.q for estimate in step.estimates])
        self.sigmas.append([np.sqrt(np.maximum(np.diag(e.covariance), 0)) for e in step.estimates])
        self.distances.append([estimate.distance_px for estimate in step.estimates])
        self.explained.append([estimate.explained for estimate in step.estimates])
        self.statuses.append([str(estimate.status) for estimate in step.estimates])
        missing = np.full(len(self.scene.rig), np.nan)
        self.overlaps.append(missing if step.overlap is None else step.overlap)
        self.seconds.append(step.seconds)
        self.missing.update(self.scene.rig.names[v] for v in step.frame.missing)

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

    def summary(self) -> dict[str, Any]:
        """Headline numbers of the run so far."""
        if not self.frames:
            return {"frames": 0}
        stages = Counter[str]()
        for seconds in self.seconds:
            stages.update(seconds)
        total = sum(stages.values())
        counts = Counter(status for statuses in self.statuses for status in statuses)
        return {
            "frames": len(self.frames),
            "persons": len(self.scene.persons),
            "by_status": dict(counts),
            "mean_distance_px": float(np.mean(self.distances)),
            "mean_explained": float(np.mean(self.explained)),
            "frames_per_second": len(self.frames) / total if total else 0.0,
            "seconds_per_frame_by_stage": {k: v / len(self.frames) for k, v in stages.items()},
            "silhouette_iou": self.mean_overlap(),
            "frames_without_image": dict(self.missing),
        }


def panels(body: BodyModel) -> list[tuple[str, list[int]]]:
    """Parameters for each panel: those of one limb, named by what their names share."""
    grouped: dict[str, list[int]] = {}
    for k, name in enumerate(body.names):
        grouped.setdefault(name.rpartition("_")[0] or body.name, []).append(k)
    return sorted(grouped.items(), key=lambda panel: min(panel[1]) < 6)


def parameter_figure(series: Series, person: int) -> Figure:
    """Pose parameters against frame number, a panel a limb, in the signs of the paper's figure 8."""
    who: Person = series.scene.persons[person]
    shown, chosen = series.shown(person), panels(who.body)
    figure = Figure(figsize=(9, 2.3 * len(chosen)), layout="constrained")
    axes = figure.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (title, columns) in zip(axes, chosen, strict=True):
        _shade_lost(axis, series, person)
        metres = None
        for k in columns:
            parameter = who.body.parameters[k]
            short = parameter.name.rpartition("_")[2]
            if parameter.rotates:
                marker = _MARKERS.get(short, ".")
                axis.plot(series.frames, shown[:, k], marker=marker, ms=4, lw=0.7, mfc="none", label=short)
            else:
                metres = metres or axis.twinx()
                metres.plot(series.frames, shown[:, k], "k", ls=_LINES.get(short, "--"), lw=1, label=f"{short} (m)")
        axis.set_ylabel(f"{title.replace('_', ' ')}\ndegrees")
        _legend(axis, metres)
    axes[-1].set_xlabel("frame")
    return figure


def _legend(axis: Axes, metres: Axes | None) -> None:
    handles, labels = axis.get_legend_handles_labels()
    if metres is not None:
        metres.set_ylabel("metres")
        more, names = metres.get_legend_handles_labels()
        handles, labels = handles + more, labels + names
    axis.legend(handles, labels, loc="upper left", bbox_to_anchor=(1.06, 1), fontsize=8, frameon=False)
    axis.grid(alpha=0.3)


def _shade_lost(axis: Axes, series: Series, person: int) -> None:
    for frame, statuses in zip(series.frames, series.statuses, strict=True):
        if statuses[person] == "lost":
            axis.axvspan(frame - 0.5, frame + 0.5, color=STATUS_COLOURS[Status.LOST], alpha=0.25, lw=0)


def distance_figure(series: Series) -> Figure:
    """Chamfer distance, explained share and silhouette overlap against frame number."""
    overlaps = np.array(series.overlaps)
    n_panels = 3 if np.isfinite(overlaps).any() else 2
    figure = Figure(figsize=(9, 2.2 * n_panels), layout="constrained")
    axes = figure.subplots(n_panels, 1, sharex=True)
    for k, person in enumerate(series.scene.persons):
        axes[0].plot(series.frames, np.array(series.distances)[:, k], lw=1, label=person.name)
        axes[1].plot(series.frames, 100 * np.array(series.explained)[:, k], lw=1, label=person.name)
        _shade_lost(axes[0], series, k)
    axes[0].set_ylabel("chamfer distance\npx")
    axes[1].set_ylabel("contour explained\n%")
    if n_panels == 3:
        for v, name in enumerate(series.scene.rig.names):
            axes[2].plot(series.frames, overlaps[:, v], lw=1, label=name)
        axes[2].set_ylabel("silhouette IoU")
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False)
    axes[-1].set_xlabel("frame")
    return figure
