"""The bundled library of movements, and a body that moves so."""

from __future__ import annotations

from tracker.bodies.body.description import load_body
from tracker.foundation.resources import model_path
from tracker.results.recognition.library import load_library

BODY = load_body(model_path("gavrila22"))

LIBRARY = load_library(())


def known(movement):
    return next(iter(LIBRARY.movements[movement].performances.values()))
