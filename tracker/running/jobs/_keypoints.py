"""What a run makes of keypoints that lie beside its recording: a start, and evidence beside the rest."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

from tracker.bodies.keypoint_layouts.views import KeypointFiles
from tracker.evidence import Evidence
from tracker.evidence.auto import AutoEvidence
from tracker.evidence.keypoints import KeypointEvidence
from tracker.evidence.together import TogetherEvidence
from tracker.tracking.initialization import Initialization
from tracker.tracking.initialization.auto import AutoInitialization
from tracker.tracking.initialization.keypoints import KeypointInitialization


def count(evidence: Evidence, start: Initialization) -> bool:
    """Whether keypoints count for anything: evidence or start are left to `auto`, or name some themselves."""
    chosen = isinstance(evidence, AutoEvidence) or isinstance(start, AutoInitialization)
    return chosen or _names_keypoints(evidence) or _names_keypoints(start)


def beside(files: KeypointFiles, evidence: Evidence, start: Initialization) -> tuple[Evidence, Initialization]:
    """Evidence and start that go by keypoints as well, where they are left to `auto`."""
    told: dict[str, Any] = {field.name: getattr(files, field.name) for field in fields(KeypointFiles)}
    if isinstance(evidence, AutoEvidence):
        # See docs/lab/detections_beside.md.
        evidence = TogetherEvidence(of=(evidence, KeypointEvidence(**told)), ranking=(1.0, 1.0), refining=(1.0, 1.0))
    if isinstance(start, AutoInitialization) and start.keypoints is None:
        start = replace(start, keypoints=KeypointInitialization(**told))
    return evidence, start


def _names_keypoints(part: Any) -> bool:
    """Whether evidence or a start looks at keypoints already, as in the configuration that a result keeps."""
    kinds = KeypointEvidence | KeypointInitialization
    inner = (getattr(part, "keypoints", None), *getattr(part, "of", ()))
    return isinstance(part, kinds) or any(isinstance(one, kinds) for one in inner)
