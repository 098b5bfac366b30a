"""Results of every acquisition: a model, a picture of it over the images, and its figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tracker.acquisition.fitting import Fit
from tracker.acquisition.result import (
    BoneLength,
    Panel,
    PartResidual,
    bone_lengths,
    contour_rms_mm,
    fit_figure,
    model_of,
    part_residuals,
)
from tracker.bodies.body.description import save_description
from tracker.foundation.configuration.tables import Table
from tracker.foundation.files import replacing, write_json

MODEL = "model.toml"
"""File of the acquired model; its picture and figures have the same stem."""


@dataclass(frozen=True)
class AcquireOutcome:
    """Figures of an acquisition."""

    model: Path
    picture: Path
    shaded_by: str
    stature_m: float
    overlaps: dict[str, float]
    """Silhouette intersection over union of each view."""

    before: dict[str, float]
    """The same with the initial model, only scaled and posed; empty if unknown."""

    turns_deg: tuple[float, ...]
    """Measured turns between front and side."""

    contour_rms_mm: float
    """Root mean square of the distances to contours, or to measured points."""

    parts: tuple[PartResidual, ...]
    bones: tuple[BoneLength, ...]
    explained: tuple[float, ...] = ()
    """Share of the points of each moment that lie on the model."""

    @property
    def folder(self) -> Path:
        """Paths of the files."""
        return self.model.parent

    def as_dict(self) -> dict[str, Any]:
        """The content for a JSON file; the files lie beside it."""
        return {**asdict(self), "model": self.model.name, "picture": self.picture.name}


@dataclass(frozen=True)
class Acquired:
    """A fit, with its pictures."""

    name: str
    about: str
    fit: Fit
    panels: Sequence[Panel]
    overlaps: dict[str, float]
    before: dict[str, float]
    turns_deg: tuple[float, ...] = ()
    explained: tuple[float, ...] = ()
    carried: tuple[str, ...] = ()
    """Parts that the person carries."""

    def written(self, folder: Path, config: Table) -> AcquireOutcome:
        """Writes `model.toml`, `model.png` and `model.json`.

        Args:
            folder: where they go.
            config: the resolved configuration, for the record.
        """
        path = folder / MODEL
        description = model_of(self.fit, self.name, self.about, self.carried)
        save_description(description, path)
        residuals = part_residuals(self.fit)
        figure, renderer = fit_figure(self.fit.body, self.panels, self.name)
        outcome = AcquireOutcome(
            model=path,
            picture=path.with_suffix(".png"),
            shaded_by=renderer,
            stature_m=description.stature_m,
            overlaps=self.overlaps,
            before=self.before,
            turns_deg=self.turns_deg,
            contour_rms_mm=contour_rms_mm(residuals),
            parts=residuals,
            bones=bone_lengths(self.fit),
            explained=self.explained,
        )
        with replacing(outcome.picture) as picture:
            figure.savefig(picture, dpi=100)
        write_json(path.with_suffix(".json"), {**outcome.as_dict(), "config": config})
        return outcome
