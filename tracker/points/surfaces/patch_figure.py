"""A patch and its search: template, start and end in every other view, and the way between (paper, figure 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tracker.foundation.arrays import Array
from tracker.foundation.errors import MatchingError
from tracker.kernels.patches import N_FOUND, NOT_CONVERGED, match_patches
from tracker.points.surfaces import FAILURES, LeastSquaresMatching, Matches
from tracker.points.surfaces.growth import MatchField
from tracker.points.surfaces.surface import PreparedView, Surface

# Shown around a patch, in patches; width of a view, inches.
_AROUND, _WIDTH_INCH = 1.6, 4.2


@dataclass(frozen=True)
class PatchSearch:
    """How a patch of the template was looked for in another view."""

    view: PreparedView
    way: Array
    """(K, 2) centres at the start and after each iteration, px."""

    start: Array
    """(2, 2) affine transformation at the start: that of the neighbour."""

    match: Matches
    """Of one patch: how it ended."""

    @property
    def told(self) -> str:
        """How it went, in words."""
        ended, steps = int(self.match.ended[0]), len(self.way) - 1
        if ended:
            return f"{FAILURES.get(ended, 'failed')} after {steps} iterations"
        x, y = self.match.sigmas[0]
        return f"{steps} iterations, sigmas {x:.3f} and {y:.3f} px, correlation {self.match.correlation[0]:.2f}"


def patch_searches(surface: Surface, matching: LeastSquaresMatching, at: tuple[float, float]) -> list[PatchSearch]:
    """Looks for a patch once more, from its nearest matched neighbour, as growth does.

    Args:
        surface: measured.
        matching: how patches are found.
        at: its centre in the template, px.

    Returns:
        One search a view, except the template.

    Raises:
        MatchingError: the patch reaches out of the template, or no neighbour is matched in any view.
    """
    view = surface.views[surface.template]
    gap = min(*at, *(np.array(view.grey.shape[::-1]) - 1 - at))
    if gap < matching.patch_px // 2 + 2:
        raise MatchingError(f"patches: [{at[0]:g}, {at[1]:g}] is too near the border for {matching.patch_px} px")
    pairs = zip(surface.views, surface.fields, strict=True)
    return [_search(view, other, matching, field, np.array(at)) for other, field in pairs if field is not None]


def _search(
    view: PreparedView, other: PreparedView, matching: LeastSquaresMatching, field: MatchField, at: Array
) -> PatchSearch:
    gaps = np.where(field.matched, np.linalg.norm(field.at - at, axis=1), np.inf)
    # the cell itself would start where it ends
    gaps[gaps < field.step_px] = np.inf
    cell = int(gaps.argmin())
    if not np.isfinite(gaps[cell]):
        raise MatchingError(f'patches: nothing of view "{other.camera.name}" is matched')
    affine = field.matches.affine[cell]
    start = np.zeros((1, N_FOUND))
    start[0, :6] = *(field.found[cell, :2] + affine @ (at - field.at[cell])), *affine.ravel()
    images = [matching.prepared(one.grey).packed for one in (view, other)]
    way, rule = [start[0, :2]], matching.rule
    for most in range(1, matching.max_iterations + 1):
        found, ended = start.copy(), np.zeros(1, dtype=np.int64)
        match_patches(images[0], images[1], at[None], found, ended, (rule[0], most, *rule[2:]), matching.noise)
        way.append(found[0, :2])
        if ended[0] != NOT_CONVERGED:
            break
    return PatchSearch(other, np.array(way), affine, Matches(at[None], found, ended))


def patch_figure(template: PreparedView, searches: list[PatchSearch], patch_px: int) -> Figure:
    """The template with its patch in white; each search with its start in black, its end in white, its way."""
    columns = len(searches) + 1
    figure = Figure((_WIDTH_INCH * columns, _WIDTH_INCH + 0.6), layout="constrained")
    axes = figure.subplots(1, columns, squeeze=False)[0]
    at = searches[0].match.at[0]
    _show(axes[0], template, at, patch_px)
    _outline(axes[0], at, np.eye(2), patch_px, "white")
    axes[0].set_title(f"{template.camera.name}: template, {patch_px} x {patch_px} px", fontsize=9)
    for axis, search in zip(axes[1:], searches, strict=True):
        _show(axis, search.view, search.way[-1], patch_px)
        _outline(axis, search.way[0], search.start, patch_px, "black")
        _outline(axis, search.match.pixels[0], search.match.affine[0], patch_px, "white")
        axis.plot(*search.way.T, "-o", color="darkorange", markersize=4, linewidth=1)
        _enlarge(axis, search.way)
        axis.set_title(f"{search.view.camera.name}: {search.told}", fontsize=9)
    return figure


def _enlarge(axis: Axes, way: Array) -> None:
    """The way once more, from its end, in px: it is mostly a fraction of one."""
    inset = axis.inset_axes((0.68, 0.04, 0.28, 0.28))
    left = way - way[-1]
    inset.plot(*left.T, "-o", color="darkorange", markersize=3, linewidth=1)
    reach = 1.2 * max(float(np.abs(left).max()), 0.01)
    inset.set(xlim=(-reach, reach), ylim=(reach, -reach), aspect="equal", xticks=[], yticks=[])
    inset.text(0.5, 0.03, f"way, {2 * reach:.2f} px across", fontsize=7, ha="center", transform=inset.transAxes)


def _show(axis: Axes, view: PreparedView, at: Array, patch_px: int) -> None:
    reach = _AROUND * patch_px
    left, top = np.maximum(np.floor(at - reach), 0).astype(int)
    right, bottom = np.ceil(at + reach).astype(int) + 1
    part = view.grey[top:bottom, left:right]
    # brought up to black and white: skin has a few grey levels
    low, high = np.percentile(part, (1, 99))
    edges = (left - 0.5, left + part.shape[1] - 0.5, top + part.shape[0] - 0.5, top - 0.5)
    axis.imshow(part, cmap="gray", vmin=low, vmax=max(high, low + 1), extent=edges)
    axis.set_xlim(at[0] - reach, at[0] + reach)
    axis.set_ylim(at[1] + reach, at[1] - reach)
    axis.set_axis_off()


def _outline(axis: Axes, at: Array, affine: Array, patch_px: int, colour: str) -> None:
    corners = patch_px / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    axis.plot(*(at + corners @ affine.T).T, color=colour, linewidth=1.5)
