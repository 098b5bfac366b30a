"""Plots of the numbers collected over a run."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person
from tracker.results.recording._drawing import STATUS_COLOURS
from tracker.results.recording._series import Series
from tracker.tracking.estimate import Status

_MARKERS = {"abduction": "x", "elevation": "o", "twist": "+", "extension": "*"}
_LINES = {"x": ":", "y": "-.", "z": "-"}

_LEAST_DEG, _LEAST_M = 30.0, 0.2
"""Least range that a panel of parameters shows."""

_WIDE, _BELOW = 9.0, 0.5
"""Inches: a figure's width, and what is below and above the panels for numbers and a title."""

_SIGN, _MOST_SIGNS = 0.075, 16
"""Inches that a sign of a name in a legend takes, and how many of them there is room for."""

_USUAL_PX = 10.0
"""Range of the distances that is shown even if all are smaller: those of two runs compare at a glance."""


def panels(body: BodyModel) -> list[tuple[str, list[int]]]:
    """Parameters for each panel: those of one limb, named by what their names share."""
    grouped: dict[str, list[int]] = {}
    for k, name in enumerate(body.names):
        grouped.setdefault(name.rpartition("_")[0] or body.name, []).append(k)
    root = np.flatnonzero(body.moves[:, body.part_parameters].all(axis=1))
    return sorted(grouped.items(), key=lambda panel: min(panel[1]) in root)


def parameter_figure(series: Series, person: int) -> Figure:
    """Pose parameters against time, a panel a limb, in the signs of the paper's figure 8."""
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


def _stacked(panel_inches: float, n_panels: int, names: Iterable[str] = ()) -> tuple[Figure, list[Axes]]:
    """A figure of panels one above the other, with room for labels and, at the right, for a second axis and legends.

    Margins are fixed: to find them by drawing everything twice took a third of a figure's time.

    Args:
        panel_inches: height of each.
        n_panels: their number.
        names: in the legends, for which a figure is wider where they are long.
    """
    height, longest = panel_inches * n_panels, max(map(len, names), default=0)
    width = _WIDE + _SIGN * max(0, longest - _MOST_SIGNS)
    figure = Figure(figsize=(width, height))
    axes = figure.subplots(n_panels, 1, sharex=True, squeeze=False)[:, 0]
    left, right = 0.09 * _WIDE / width, 0.8 * _WIDE / width
    figure.subplots_adjust(left, _BELOW / height, right, 1 - _BELOW / height, hspace=0.12)
    return figure, list(axes)


def _at_least(axis: Axes, extent: float) -> None:
    """Widens the range of an axis, so that jitter of somebody who stands still does not look like movement."""
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
    """Seconds below, and above them the frame numbers that the tables count in."""
    panels_in_order = list(axes)
    panels_in_order[-1].set_xlabel("time, s")
    places = np.unique(np.linspace(0, len(series.frames) - 1, min(len(series.frames), 9)).round().astype(int))
    above = panels_in_order[0].secondary_xaxis("top")
    above.set_xticks([series.times_s[k] for k in places], [str(series.frames[k]) for k in places])
    above.set_xlabel("frame")


def distance_figure(series: Series) -> Figure:
    """The distance that poses are ranked by, explained share and silhouette overlap against time."""
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
