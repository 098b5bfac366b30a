"""Joint angles of the ISB over a run, left beside right: a figure, a table and a file for the report."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tracker.bodies.scene import Person
from tracker.foundation.arrays import Array
from tracker.foundation.files import csv_lines
from tracker.results.recording._anatomical import AnatomicalJoint, angles_of, joints_of, leaning_limb
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Step

_WIDE, _HIGH, _BELOW = 6.5, 1.1, 0.6
"""Inches: a figure's width, a panel's height, and what is below and beside the panels for numbers."""

_COLOURS = {"left": "#2a6f85", "right": "#b5533c", "": "#4a4f57"}
"""Of the sides' curves."""


class Sides(NamedTuple):
    """A row of the table: what an angle does on the left and on the right, or in the middle alone."""

    angle: str
    left: str
    right: str


@dataclass
class IsbSeries:
    """Angles of one person so far; empty of a body that the standard has no angles for."""

    person: Person
    joints: list[AnatomicalJoint]
    times_s: list[float] = field(default_factory=list)
    heads: list[list[object]] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)
    """(2, A) angles and standard deviations, degrees."""

    @staticmethod
    def of(person: Person) -> IsbSeries:
        """Nothing yet; without joints where limbs do not hang down in the reference pose."""
        return IsbSeries(person, [] if leaning_limb(person.body) else joints_of(person.body))

    @property
    def names(self) -> list[str]:
        """(A,) of the angles, for instance `left_hip_flexion`."""
        return [f"{joint.name}_{angle}" for joint in self.joints for angle in joint.angles]

    def add(self, step: Step, estimate: Estimate) -> None:
        """Takes the angles of one frame."""
        if self.joints:
            values = np.stack(angles_of(self.joints, self.person.body, estimate.q, estimate.covariance))
            self.times_s.append(step.frame.time_s)
            told = str(estimate.verdict), " ".join(estimate.ambiguous)
            self.heads.append([step.frame.index, f"{step.frame.time_s:.6f}", *told])
            self.values.append(np.full_like(values, np.nan) if estimate.lost else values)

    def table(self) -> str:
        """A CSV table as a link holds it: a row a frame, angles, then their standard deviations."""
        columns = [f"{name}_{what}" for what in ("deg", "sigma_deg") for name in self.names]
        lines = [["frame", "time_s", "status", "ambiguous", *columns]]
        rows = [[*head, *map(_text, both.ravel())] for head, both in zip(self.heads, self.values, strict=True)]
        return "data:text/csv;base64," + base64.b64encode(csv_lines([*lines, *rows]).encode()).decode()

    def rows(self) -> list[Sides]:
        """What each angle does, left beside right."""
        told = dict(zip(self.names, (self._told(k) for k in range(len(self.names))), strict=True))
        found = []
        for angle, sides in self._paired():
            own = [told[name] for name in sides.values()]
            found.append(Sides(angle, own[0], own[1] if len(own) > 1 else ""))
        return found

    def _told(self, k: int) -> str:
        angles, sigmas = np.array(self.values)[:, :, k].T
        known = angles[np.isfinite(angles)]
        if not len(known):
            return "-"
        sure = sigmas[np.isfinite(sigmas)]
        low, high = (round(float(end)) for end in (known.min(), known.max()))
        return f"{low} to {high}" + (f" ± {np.median(sure):.1f}" if len(sure) else "")

    def _paired(self) -> list[tuple[str, dict[str, str]]]:
        """Angle in words -> side -> name; the side of what there is one of is empty."""
        found: dict[str, dict[str, str]] = {}
        for name in self.names:
            side = next((one for one in ("left", "right") if name.startswith(f"{one}_")), "")
            found.setdefault(name.removeprefix(f"{side}_").replace("_", " "), {})[side] = name
        return list(found.items())

    def figure(self) -> Figure:
        """A row an angle, left beside right on one scale, with a band of a standard deviation to each side."""
        paired = self._paired()
        high = _HIGH * len(paired) + _BELOW
        figure = Figure(figsize=(_WIDE, high))
        margins = {"left": _BELOW / _WIDE, "right": 0.98, "bottom": _BELOW / high, "top": 1 - 0.4 / high}
        grid = figure.add_gridspec(len(paired), 2, **margins, hspace=0.62, wspace=0.15)
        for row, (angle, sides) in enumerate(paired):
            first: Axes | None = None
            for column, (side, name) in enumerate(sides.items()):
                place = grid[row, column] if len(sides) > 1 else grid[row, :]
                axis = figure.add_subplot(place, sharey=first)
                self._draw(axis, self.names.index(name), side)
                axis.set_title(f"{side} {angle}".strip(), fontsize=8)
                axis.tick_params(labelbottom=row == len(paired) - 1 or len(sides) != len(paired[row + 1][1]))
                first = first or axis
        figure.supxlabel("time, s", fontsize=8)
        figure.supylabel("degrees", fontsize=8)
        return figure

    def _draw(self, axis: Axes, k: int, side: str) -> None:
        angles, sigmas = np.array(self.values)[:, :, k].T
        shown = np.degrees(np.unwrap(np.radians(angles))) if np.isfinite(angles).all() else angles
        axis.fill_between(self.times_s, shown - sigmas, shown + sigmas, color=_COLOURS[side], alpha=0.25, lw=0)
        axis.plot(self.times_s, shown, color=_COLOURS[side], lw=1)
        axis.tick_params(labelsize=7)
        axis.locator_params(axis="x", nbins=5)
        axis.locator_params(axis="y", nbins=4)
        axis.grid(alpha=0.3)


def _text(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else ""
