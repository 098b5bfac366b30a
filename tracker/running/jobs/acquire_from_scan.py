"""Acquisition from a laser scan with its joints: a person's model with a skin."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import pydantic

from tracker.acquisition.scan import Scan, ScanFiles, read_scan
from tracker.acquisition.scan_rigging import rigged
from tracker.bodies.body.description import BodyDescription, read_buildable
from tracker.bodies.segments import Mirror
from tracker.foundation.configuration.components import ModelFile, component
from tracker.foundation.files import write_json
from tracker.foundation.progress import Progress
from tracker.foundation.resources import model_path
from tracker.running.jobs import ResultFolder, described
from tracker.running.jobs._acquisition import MODEL, AcquireOutcome
from tracker.running.jobs._persons import save_with_skin, skinned_outcome


@component
class ScanJob:
    """Makes a person's model from a laser scan and its joints: `model.toml`, its skin, a picture and figures."""

    resumable: ClassVar[bool] = False

    scan: ScanFiles
    """The scan: surface, weights and joints."""

    name: str = "model"
    """Name of the model."""

    model: ModelFile = pydantic.Field(default_factory=lambda: model_path("human").resolve())
    """The body that gives parameters, groups and conventions: the name of a bundled model, or a path that ends in
    .toml."""

    smooth: bool = True
    """Blend the motions of several parts near joints; false: every vertex moves with one part."""

    def open(self, earlier: Path | None = None) -> tuple[BodyDescription, Scan]:
        """Reads the model and the scan; see `tracker.running.jobs.Job.open`."""
        general = read_buildable(self.model)
        return general, read_scan(self.scan, Mirror(general.sides, general.across))

    @property
    def model_name(self) -> str:
        """Name of the model."""
        return self.name

    def execute(self, opened: tuple[BodyDescription, Scan], folder: ResultFolder, progress: Progress) -> AcquireOutcome:
        """Puts the skeleton into the scan and fits the parts; see `tracker.running.jobs.Job.execute`."""
        general, scan = opened
        progress("fitting the parts")
        found = rigged(general, scan, self.name)
        path = folder.path / MODEL
        assert found.description.skin is not None
        skin = found.description.skin.model_copy(update={"smooth": self.smooth})
        description = save_with_skin(
            found.description.model_copy(update={"skin": skin}), scan.surface, scan.rigging, path
        )
        outcome = skinned_outcome(found.fits, description, general, path)
        write_json(path.with_suffix(".json"), {**outcome.as_dict(), "config": described(self)})
        return outcome
