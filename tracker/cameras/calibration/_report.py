"""The report of a calibration: how good it is, parameter by parameter and view by view, and what to do better."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tracker.cameras.calibration._adjustment import Adjustment, Calibrated, Held, parameter_table
from tracker.foundation.arrays import Integers
from tracker.foundation.pages import filled

_ROWS, _COLUMNS = ("upper", "middle", "lower"), ("left", "central", "right")
# Above 0.98, the variance of one parameter is more than 25 times what it would be with the other one known.
_CORRELATED = 0.98
# With twice the standard error, four times as many corners tell as much.
_BELONGING = 2.0


def coverage(adjustment: Adjustment, view: int) -> Integers:
    """(3, 3) number of images of targets in each ninth of a view."""
    width, height = adjustment.sizes[view]
    pixels = adjustment.observations.pixels[adjustment.used & (adjustment.observations.views == view)]
    columns = np.clip((3 * (pixels[:, 0] + 0.5) / width).astype(int), 0, 2)
    rows = np.clip((3 * (pixels[:, 1] + 0.5) / height).astype(int), 0, 2)
    counts = np.bincount(3 * rows + columns, minlength=9)
    return counts.reshape(3, 3).astype(np.int64)


def advice(adjustment: Adjustment, what: str, n_objects: int) -> tuple[str, ...]:
    """Sentences about what a better recording would do.

    Args:
        adjustment: the calibration.
        what: the thing moved, for instance `bar`.
        n_objects: how many positions of it were used.
    """
    return (*_about_views(adjustment, what), *_about_all(adjustment, what, n_objects))


def _about_views(adjustment: Adjustment, what: str) -> Iterator[str]:
    noises = [adjustment.rms_px(v) for v in range(len(adjustment.names))]
    for v, name in enumerate(adjustment.names):
        mine = adjustment.observations.views == v
        empty = [region(row, column) for row, column in zip(*np.nonzero(coverage(adjustment, v) == 0), strict=True)]
        if empty:
            yield f"camera {name} saw no {what} in its {listed(empty)} third: move it there; distortion is a guess"
        rejected = float(1 - adjustment.used[mine].mean())
        if rejected > 0.15:
            yield f"camera {name}: {100 * rejected:.0f} % of its images were gross errors: look at its picture"
        if len(noises) > 2 and noises[v] > 2 * float(np.median(noises)):
            yield (
                f"camera {name} fits with {noises[v]:.2f} px, the others with {np.median(noises):.2f} px: is it in "
                "focus, fixed, and not moved during the recording?"
            )


def _why(held: Held) -> str:
    if held.turns_back_px is not None:
        return f"with it the lens turns back {held.turns_back_px:.0f} px from the centre, inside the image"
    return f"{held.correlation:+.2f} with {held.partner}"


def _about_all(adjustment: Adjustment, what: str, n_objects: int) -> Iterator[str]:
    if n_objects < 50:
        yield f"{n_objects} positions of the {what} are few: 100 to 200 that fill the volume are better"
    for name in adjustment.names:
        held = [entry for entry in adjustment.held if entry.camera == name]
        if held:
            words = [f"{entry.parameter} ({_why(entry)})" for entry in held]
            yield (
                f"camera {name}: {listed(words)} cannot be determined from this recording, so the usual value was "
                f"kept: record the {what} at more depths, directions and corners"
            )
    interesting = [entry for entry in adjustment.correlations(_CORRELATED) if not _expected(entry[1], entry[2])]
    for value, first, second in interesting[:5]:
        yield f"{first} and {second} are correlated by {value:+.3f}: tilted and nearer positions would part them"
    if adjustment.bent_m > 0:
        yield (
            f"corners of the board seem to be up to {1000 * adjustment.bent_m:.2g} mm from where they should be: glue "
            "it to something flat and measure its squares; the standard errors count that"
        )
    if adjustment.inflation > _BELONGING:
        yield (
            f"residuals of a picture belong together: standard errors are {adjustment.inflation:.1f} times those of "
            "independent ones; hold the board still against blur, and record more positions"
        )
    if adjustment.s0 > 2:
        yield (
            f"the images are {adjustment.s0:.1f} times as noisy as assumed ({adjustment.sigma_px:g} px): state "
            "sigma_px as it is, or look for blur, motion and cameras out of step"
        )


def _expected(first: str, second: str) -> bool:
    """Radial terms are always correlated with one another, and so are shifts of a principal point and turns."""
    placing = ("rotation", "centre", "principal point", "camera constant", "decentring")
    placed = all(any(word in name for word in placing) for name in (first, second))
    return placed or ("radial" in first and "radial" in second)


def region(row: int, column: int) -> str:
    """A ninth of an image in words."""
    return "centre" if row == column == 1 else f"{_ROWS[row]} {_COLUMNS[column]}"


def listed(words: list[str]) -> str:
    """`a, b and c`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


_ARROW_PX = 20.0
"""Length of the median residual as drawn."""


def report_text(name: str, calibrated: Calibrated) -> str:
    """The report as plain text."""
    adjustment = calibrated.adjustment
    lines = [f"calibration {name}: {calibrated.kind}, {calibrated.n_objects} positions used", ""]
    lines += [f"{label:<28} {value}" for label, value in _summary(calibrated)]
    lines += ["", "view                images  gross errors  RMS px"]
    for v, view in enumerate(adjustment.names):
        n, rejected = _counts(adjustment, v)
        lines.append(f"{view:<18} {n:>7} {rejected:>13} {adjustment.rms_px(v):>7.3f}")
    for v, view in enumerate(adjustment.names):
        lines += ["", f"{view}: parameter, value, standard error"]
        lines += ["  " + "  ".join(row) for row in _parameter_rows(adjustment, v)]
    lines += ["", "what to do better:"]
    lines += [f"- {sentence}" for sentence in calibrated.advice] or ["- nothing: this recording was good"]
    return "\n".join(lines) + "\n"


def report_html(name: str, calibrated: Calibrated) -> str:
    """The report as one self-contained page."""
    adjustment = calibrated.adjustment
    views = [
        {
            "name": view,
            "picture": _uri(partial(_draw_residuals, calibrated=calibrated, view=v), (8.0, 6.2)),
            "parameters": _parameter_rows(adjustment, v),
            "counts": _counts(adjustment, v),
            "rms": f"{adjustment.rms_px(v):.3f}",
        }
        for v, view in enumerate(adjustment.names)
    ]
    content: dict[str, Any] = {
        "name": name,
        "calibrated": calibrated,
        "summary": _summary(calibrated),
        "views": views,
        "volume": _uri(lambda figure: _draw_volume(figure, calibrated), (9.0, 5.2)),
        "histogram": _uri(lambda figure: _draw_histogram(figure, adjustment), (9.0, 2.6)),
        "correlations": [(f"{value:+.3f}", a, b) for value, a, b in adjustment.correlations(0.95)[:20]],
    }
    return filled("tracker.cameras.calibration", "_report.html", content)


def _summary(calibrated: Calibrated) -> list[tuple[str, str]]:
    adjustment = calibrated.adjustment
    rms = float(np.sqrt(np.mean(adjustment.errors[adjustment.used] ** 2)))
    rejected = int((~adjustment.used).sum())
    rows = [
        ("reprojection RMS", f"{rms:.3f} px"),
        ("s0", f"{adjustment.s0:.2f} (noise found / {adjustment.sigma_px:g} px assumed)"),
        ("noise of an image coordinate", f"{adjustment.s0 * adjustment.sigma_px:.3f} px"),
        ("gross errors left out", f"{rejected} of {len(adjustment.used)}"),
        ("redundancy", str(adjustment.redundancy)),
    ]
    if calibrated.kind == "chessboard":
        told = f"{adjustment.inflation:.1f} times those of independent residuals"
        rows.append(("standard errors", f"{told}: from the scatter between the board's positions"))
    if adjustment.exchanged.any():
        rows.append(("swapped ends put right", str(int(adjustment.exchanged.sum()) // 2)))
    rows += [(m.name, f"{m.value:.3f} {m.unit} ({m.meaning})") for m in calibrated.measures]
    if calibrated.found_out:
        rows.append(("found out by itself", calibrated.found_out))
    if calibrated.world:
        rows.append(("world frame", calibrated.world))
    return rows


def _counts(adjustment: Adjustment, view: int) -> tuple[int, int]:
    mine = adjustment.observations.views == view
    return int(mine.sum()), int((mine & ~adjustment.used).sum())


def _parameter_rows(adjustment: Adjustment, view: int) -> list[tuple[str, str, str]]:
    """Name, value and standard error in units that can be read."""
    rows = []
    for name, value, sigma, unit, free in parameter_table(adjustment, view):
        if name == "time offset" and not free:
            continue
        if unit == "rad":
            rows.append((name, "", f"{1000 * sigma:.3f} mrad"))
        elif unit == "m":
            rows.append((name, f"{value:.4f} m", f"{1000 * sigma:.2f} mm"))
        else:
            digits = 2 if unit == "px" else 6
            error = f"{sigma:.2g} {unit}".strip() if free else "held"
            rows.append((name, f"{value:.{digits}f} {unit}".strip(), error))
    return rows


def _draw_residuals(figure: Figure, calibrated: Calibrated, view: int) -> None:
    """Residual vectors over the view's picture, with the number of images in each ninth."""
    adjustment = calibrated.adjustment
    width, height = adjustment.sizes[view]
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    picture = calibrated.pictures.get(adjustment.names[view])
    if picture is not None:
        shown = picture[..., ::-1] if picture.ndim == 3 else picture
        axes.imshow(shown, cmap="gray", alpha=0.45)
    mine = (adjustment.observations.views == view) & np.isfinite(adjustment.errors).all(axis=1)
    good, bad = mine & adjustment.used, mine & ~adjustment.used
    pixels, errors = adjustment.observations.pixels, adjustment.errors
    size = float(np.median(np.linalg.norm(errors[good], axis=1))) if good.any() else 1.0
    scale = _ARROW_PX * width / 720 / max(size, 1e-9)
    arrows = scale * errors[good]
    axes.quiver(*pixels[good].T, *arrows.T, angles="xy", scale_units="xy", scale=1.0, color="#2a6f85", width=0.0018)
    axes.plot(*pixels[bad].T, "x", color="#c4452f", markersize=5)
    for row in range(3):
        for column in range(3):
            count = int(coverage(adjustment, view)[row, column])
            place = width * (column + 0.5) / 3, height * (row + 0.5) / 3
            axes.text(*place, str(count), color="#c4452f" if count == 0 else "#5c6b7a", fontsize=15, alpha=0.8)
    for k in (1, 2):
        axes.axvline(width * k / 3, color="#aab4bd", linewidth=0.6)
        axes.axhline(height * k / 3, color="#aab4bd", linewidth=0.6)
    axes.text(
        0.01, 0.02, f"arrows {scale:.0f} times enlarged; median residual {size:.3f} px; x gross error",
        transform=axes.transAxes, fontsize=9, bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0},
    )  # fmt: skip
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_axis_off()


def _draw_volume(figure: Figure, calibrated: Calibrated) -> None:
    """Cameras and points of the objects from above and from the side."""
    for k, (title, i, j) in enumerate((("from above", 0, 1), ("from the side", 0, 2))):
        axes = figure.add_subplot(1, 2, k + 1)
        if calibrated.points is not None:
            points = calibrated.points[np.isfinite(calibrated.points).all(axis=1)]
            if calibrated.kind == "reference_bar":
                whole = calibrated.points.reshape(-1, 2, 3)
                whole = whole[np.isfinite(whole).all(axis=(1, 2))]
                axes.plot(whole[..., i].T, whole[..., j].T, color="#9db8c2", linewidth=0.6)
            axes.plot(points[:, i], points[:, j], ".", color="#2a6f85", markersize=2)
        for camera in calibrated.rig.cameras:
            centre, axis = camera.centre, camera.camera_from_world[2, :3]
            axes.plot(centre[i], centre[j], "s", color="#c4452f", markersize=5)
            axes.annotate(camera.name, (centre[i], centre[j]), fontsize=8, xytext=(4, 4), textcoords="offset points")
            axes.plot([centre[i], centre[i] + 0.5 * axis[i]], [centre[j], centre[j] + 0.5 * axis[j]], color="#c4452f")
        axes.set_aspect("equal")
        axes.set_title(title, fontsize=10)
        axes.set_xlabel(f"{'xyz'[i]} m")
        axes.set_ylabel(f"{'xyz'[j]} m")
    figure.tight_layout()


def _draw_histogram(figure: Figure, adjustment: Adjustment) -> None:
    """Residuals of every view beside the noise assumed."""
    axes = figure.add_subplot()
    limit = 4 * adjustment.sigma_px * max(adjustment.s0, 1.0)
    for v, name in enumerate(adjustment.names):
        mine = adjustment.used & (adjustment.observations.views == v)
        axes.hist(adjustment.errors[mine].ravel(), bins=60, range=(-limit, limit), histtype="step", label=name)
    axes.set_xlabel("residual px")
    axes.legend(fontsize=8)
    figure.tight_layout()


def _uri(draw: Callable[[Figure], None], size: tuple[float, float]) -> str:
    figure = Figure(figsize=size)
    draw(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"
