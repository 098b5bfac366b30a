"""A self-contained HTML report of a run."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pydantic
import tomli_w
from matplotlib.figure import Figure

from tracker.foundation.arrays import Image
from tracker.foundation.configuration.components import component
from tracker.foundation.files import write_whole
from tracker.foundation.pages import filled
from tracker.results.recording import RunContext
from tracker.results.recording._anatomical import IsbSeries
from tracker.results.recording._drawing import LIMB_COLOUR, STATUS_COLOURS, draw_axes, draw_step, encoded, tile
from tracker.results.recording._player import Player
from tracker.results.recording._series import AMBIGUOUS, Series, distance_figure, parameter_figure, png_of
from tracker.tracking.loss import LossRule
from tracker.tracking.start import RATHER_RIGHT, Hypothesis, Start
from tracker.tracking.trajectory import Step

GOOD, LOOK, BAD = "good", "look", "bad"


class HeadNumber(NamedTuple):
    """A number, and its meaning."""

    value: str
    name: str
    told: str
    """When it is good or bad."""

    verdict: str = ""
    """`good`, `look` or `bad`; empty if the number alone is neither."""


def head_numbers(summary: dict[str, Any], run: RunContext) -> list[HeadNumber]:
    """The numbers of a run's summary.

    Args:
        summary: see `Series.summary`; of at least one frame.
        run: the run.
    """
    missing, counts = run.n_frames - summary["frames"], summary["by_status"]
    lost, doubtful, limbs = counts.get("lost", 0), counts.get("doubtful", 0), summary["frames_with_ambiguous_limbs"]
    whole = f"the run was stopped: {missing} frames are missing" if missing > 0 else "all of them are tracked"
    return [
        HeadNumber(str(summary["frames"]), f"frames of {run.n_frames}", whole, BAD if missing > 0 else GOOD),
        _counted(lost, "lost", "every person is found in every frame", "values of these frames are empty", BAD),
        _counted(doubtful, "doubtful", "the images support every pose", "look at these before you use them", LOOK),
        _counted(limbs, "with an ambiguous limb", "nothing contradicts a limb", "see the reasons below", LOOK),
        *_fit(summary, run),
        _pace(summary, run),
    ]


def _counted(n: int, name: str, fine: str, otherwise: str, verdict: str) -> HeadNumber:
    return HeadNumber(str(n), name, otherwise if n else fine, verdict if n else GOOD)


def _fit(summary: dict[str, Any], run: RunContext) -> list[HeadNumber]:
    """How well the poses fit, by the run's own limits."""
    distance_px, explained = summary["mean_distance_px"], summary["mean_explained"]
    rule = run.details.get("config", {}).get("loss", {})
    lost_below, left_over = (rule.get(key, getattr(LossRule(), key)) for key in ("lost_below", "doubtful_above"))
    good = 1 - left_over
    limits = f"good from {good:.0%}; a frame is lost below {lost_below:.0%}"
    verdict = "" if explained is None else GOOD if explained >= good else LOOK if explained >= lost_below else BAD
    return [
        HeadNumber(
            "-" if distance_px is None else f"{distance_px:.2f} px",
            "mean distance",
            "less is better; compare it only between runs of one recording",
        ),
        HeadNumber("-" if explained is None else f"{explained:.0%}", "of the contour explained", limits, verdict),
    ]


def _pace(summary: dict[str, Any], run: RunContext) -> HeadNumber:
    pace = summary["frames_per_second"]
    times = 1 / (run.interval_s * pace) if pace else 0.0
    told = f"{times:.1f} times as long as the recording" if times >= 1 else "faster than the recording"
    return HeadNumber(f"{pace:.1f}", "frames/s tracked", told if pace else "times were not kept")


_DPI = 95
"""Resolution of the figures, dots per inch."""

_MOST_REASONS = 6
"""Number of reasons of doubts that are visible without unfolding the rest."""

_TABLES = {
    "poses.csv": "pose parameters",
    "sigmas.csv": "their standard deviations",
    "joints.csv": "joint centres",
    "doubts.csv": "why frames and limbs are in doubt",
    "limbs.csv": "how probable it is that limbs are right",
    "velocities.csv": "velocities of the parameters",
    "accelerations.csv": "accelerations of the parameters",
    "joint_motion.csv": "velocities and accelerations of joint centres",
    "run.json": "all settings and numbers",
}
"""Files beside the report, and their content."""


@component
class Report:
    """`report.html`: numbers, overlay pictures and plots in one file."""

    pictures: int = pydantic.Field(default=4, ge=1)
    """Number of overlay pictures, evenly over the run; the worst frame and as many lost frames come on top."""

    width_px: int = pydantic.Field(default=1000, ge=200)
    """Width of the pictures, px."""

    player: bool = True
    """The bodies, the cameras and a small video of all views, to play and to scrub; 1 to 2 MB for 1000 frames."""

    player_frames: int = pydantic.Field(default=1500, ge=2)
    """Largest number of frames in the player; of longer runs it shows every second, third, ..."""

    def begin(self, run: RunContext) -> ReportRecorder:
        """Collects numbers and pictures; the page is written at the end."""
        return ReportRecorder(run, self)


class ReportRecorder:
    """Numbers and pictures so far."""

    def __init__(self, run: RunContext, settings: Report) -> None:
        self._run, self._settings, self._series = run, settings, Series(run.scene)
        self._every = max(1, run.n_frames // settings.pictures)
        self._pictures: dict[int, tuple[str, bytes]] = {}
        self._worst: tuple[float, int, bytes] | None = None
        self._axes: list[Image] = []
        self._start: Start | None = None
        self._confidence: tuple[float, ...] = ()
        self._isb = [IsbSeries.of(person) for person in run.scene.persons]
        self._player = Player(run, settings.player_frames) if settings.player else None

    def write(self, step: Step) -> None:
        """Adds one frame."""
        k = len(self._series.frames)
        self._series.add(step)
        for isb, estimate in zip(self._isb, step.estimates, strict=True):
            isb.add(step, estimate)
        if self._player is not None:
            self._player.add(step)
        lost = any(estimate.lost for estimate in step.estimates)
        distance = max(estimate.distance_px for estimate in step.estimates)
        worst = self._worst is None or distance > self._worst[0]
        shown = k % self._every == 0 or (lost and len(self._pictures) < 2 * self._settings.pictures)
        if shown or worst:
            picture = encoded(draw_step(step, self._run.scene, self._settings.width_px, close=True))
            if shown:
                caption = f"frame {step.frame.index}, {step.frame.time_s:.2f} s" + (": lost" if lost else "")
                self._pictures[step.frame.index] = caption, picture
            if worst:
                self._worst = distance, step.frame.index, picture
        if step.start is not None and self._start is None:
            self._start, self._confidence = step.start, step.start_confidence
            self._axes = [
                draw_axes(step.frame.images[v], fit)
                for fits in step.start.evidence
                for v, fit in enumerate(fits)
                if fit is not None
            ]

    def finish(self) -> tuple[Path, ...]:
        """Writes the page."""
        if not self._series.frames:
            return ()
        page = filled("tracker.results.recording", "_report/report.html", self._content())
        path = self._run.folder / "report.html"
        write_whole(path, page)
        return (path,)

    def _content(self) -> dict[str, Any]:
        pictures = [(caption, _uri(data, "jpeg")) for _, (caption, data) in sorted(self._pictures.items())]
        if self._worst is not None and self._worst[1] not in self._pictures:
            caption = f"worst frame by distance: {self._worst[1]} ({self._worst[0]:.1f} px)"
            pictures.append((caption, _uri(self._worst[2], "jpeg")))
        axes = encoded(tile(self._axes, self._settings.width_px)) if self._axes else None
        persons, summary = self._run.scene.persons, self._series.summary()
        return {
            "name": self._run.name,
            "run": self._run,
            "smoothing": self._run.details.get("smoothing", {}).get("use", ""),
            "summary": summary,
            "head": head_numbers(summary, self._run),
            "n_in_doubt": self._series.n_in_doubt,
            "why": [(n, what, because.phrase) for (what, because), n in self._series.why.most_common()],
            "most_reasons": _MOST_REASONS,
            "tables": [(name, told) for name, told in _TABLES.items() if (self._run.folder / name).is_file()],
            "isb": [(one.person.name, one, _figure_uri(one.figure())) for one in self._isb if one.joints],
            "reading": self._run.details.get("choices", {}).get("reading", ""),
            "findings": self._run.details.get("findings", []),
            "keypoints": self._run.details.get("keypoints", []),
            "rather_right": RATHER_RIGHT,
            "colours": {str(status): colour for status, colour in STATUS_COLOURS.items()} | {AMBIGUOUS: LIMB_COLOUR},
            "strips": self._series.strips(),
            "ends": (float(self._series.spans()[0, 0]), float(self._series.spans()[-1, 1])),
            "worst": self._series.worst(),
            "player": None if self._player is None else self._player.content(),
            "pictures": pictures,
            "axes": None if axes is None else _uri(axes, "jpeg"),
            "starts": self._start_rows(),
            "distances": _figure_uri(distance_figure(self._series)),
            "plots": [(p.name, _uri(self._parameters(k, p.name), "png")) for k, p in enumerate(persons)],
            "sigmas": [(p.name, self._sigma_rows(k)) for k, p in enumerate(persons)],
            "config": tomli_w.dumps(self._run.details.get("config", {})),
            "versions": self._run.details.get("versions", {}),
        }

    def _parameters(self, k: int, name: str) -> bytes:
        """Figure of a person's parameters, PNG: that of `plots`, if it is drawn."""
        return self._run.figures.get(name) or png_of(parameter_figure(self._series, k), _DPI)

    def _start_rows(self) -> list[tuple[str, float, list[Hypothesis]]]:
        """Name, confidence and ranked hypotheses of each person that was bootstrapped."""
        if self._start is None:
            return []
        persons = zip(self._run.scene.persons, self._confidence, self._start.hypotheses, strict=False)
        return [(person.name, sure, list(tried)) for person, sure, tried in persons if tried]

    def _sigma_rows(self, person: int) -> list[tuple[str, str, str, str]]:
        """Name, unit, range of the parameter and median standard deviation."""
        body = self._run.scene.persons[person].body
        values, sigmas = self._series.shown(person), np.array([s[person] for s in self._series.sigmas])
        rows = []
        for k, parameter in enumerate(body.parameters):
            sigma = np.degrees(sigmas[:, k]) if parameter.rotates else 1000 * sigmas[:, k]
            found = sigma[np.isfinite(sigma)]
            column = values[np.isfinite(values[:, k]), k]
            digits = 2 if parameter.rotates else 3
            ends = (round(float(end), digits) + 0.0 for end in (column.min(), column.max())) if len(column) else ()
            extent = " to ".join(f"{end:.{digits}f}" for end in ends) + f" {parameter.unit}" if len(column) else "-"
            unit = "deg" if parameter.rotates else "mm"
            median = f"{np.median(found):.2f} {unit}" if len(found) else "-"
            rows.append((parameter.name.replace("_", " "), parameter.unit, extent, median))
        return rows


def _uri(data: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def _figure_uri(figure: Figure) -> str:
    return _uri(png_of(figure, _DPI), "png")
