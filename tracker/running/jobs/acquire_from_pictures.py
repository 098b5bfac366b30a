"""Acquisition from pictures: a person's model from a front and a side silhouette."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import pydantic

from tracker.acquisition.pictures import Pair, read_silhouette
from tracker.acquisition.result import Panel
from tracker.acquisition.silhouette_task import SilhouetteSettings
from tracker.acquisition.two_silhouettes import acquire
from tracker.bodies.body.description import BodyDescription, read_buildable
from tracker.bodies.subject import Stature
from tracker.foundation.configuration.components import ModelFile, component
from tracker.foundation.progress import Progress
from tracker.foundation.resources import model_path
from tracker.running.jobs import ResultFolder, described
from tracker.running.jobs._acquisition import Acquired, AcquireOutcome


@component
class PictureJob:
    """Makes a person's model from front and side silhouettes: `model.toml`, a picture and the figures of the fit."""

    resumable: ClassVar[bool] = False

    name: str = "model"
    """Name of the model."""

    model: ModelFile = pydantic.Field(default_factory=lambda: model_path("gavrila22").resolve())
    """The initial body: the name of a bundled model, or a path that ends in .toml."""

    stature_m: Stature | None = None
    """Height of the person, metres."""

    pairs: tuple[Pair, ...] = pydantic.Field(
        min_length=1, examples=['[{ front = { mask = "front.png" }, side = { mask = "side.png" } }]']
    )
    """Pictures from the front and from the side, in one or more poses."""

    acquisition: SilhouetteSettings = SilhouetteSettings()
    """Settings of the fit."""

    def open(self, earlier: Path | None = None) -> BodyDescription:
        """Reads the model and the pictures, and refuses bad pictures; see `jobs.Job.open`."""
        for pair in self.pairs:
            read_silhouette(pair.front, "front", self.stature_m)
            read_silhouette(pair.side, "side", self.stature_m)
        return read_buildable(self.model)

    @property
    def model_name(self) -> str:
        """Name of the model."""
        return self.name

    def execute(self, opened: BodyDescription, folder: ResultFolder, progress: Progress) -> AcquireOutcome:
        """Fits the model; see `jobs.Job.execute`."""
        found = acquire(opened, self.pairs, self.stature_m, self.acquisition, progress)
        several = len(self.pairs) > 1
        names = [f"{one.name} {k // 2 + 1}" if several else one.name for k, one in enumerate(found.silhouettes)]
        panels = [
            Panel(f"{name}: IoU {share:.3f}", one.image, one.mask, one.camera, found.fit.pose(k))
            for k, (name, share, one) in enumerate(zip(names, found.overlaps, found.silhouettes, strict=True))
        ]
        acquired = Acquired(
            self.name,
            f"acquired from front and side silhouettes, from {opened.name}",
            found.fit,
            panels,
            dict(zip(names, found.overlaps, strict=True)),
            dict(zip(names, found.start_overlaps, strict=True)),
            found.turns_deg,
        )
        return acquired.written(folder.path, described(self))
