"""What a model that was acquired says of lengths: the person's own stature, and offsets of the person's size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.test_scan import POSE_DEG, scanned
from tracker.acquisition._residuals import height_row, no_rows
from tracker.acquisition.fitting import Fit
from tracker.acquisition.result import bone_lengths, model_of, stature_of
from tracker.acquisition.scan import read_scan
from tracker.acquisition.scan_rigging import rigged
from tracker.acquisition.shape_space import ShapePrior, space_of
from tracker.bodies.body.description import read_description
from tracker.bodies.body.sections import KeypointEntry, Movement, Term
from tracker.bodies.segments import Mirror
from tracker.bodies.subject import Carried, with_carried
from tracker.foundation.resources import model_path

POLE = Carried(name="pole", by="right_wrist", start=(0.1, 0, -0.8), end=(0.1, 0, 1.2), radii=(0.02, 0.02))


def test_what_a_person_carries_makes_nobody_taller() -> None:
    human = read_description(model_path("human"))
    space = space_of(with_carried(human, [POLE]), ShapePrior())
    n = len(space.names)
    found = Fit(space, (), np.zeros(n), np.zeros(0), 1e-4 * np.eye(n), (no_rows(),))
    assert stature_of(found.body) > stature_of(human.build()) + 0.1
    assert model_of(found, "anna", "", ("pole",)).stature_m == pytest.approx(stature_of(human.build()))


@pytest.mark.parametrize("model", ["gavrila22", "human", "upper21", "upper32", "quadruped"])
def test_bundled_bodies_are_as_tall_as_they_say(model: str) -> None:
    """By the measure of a fit: else a person of the very stature that is told comes out as of another one."""
    body = read_description(model_path(model)).build()
    assert stature_of(body) == pytest.approx(body.stature_m, rel=0.002)


def test_the_height_that_is_held_is_that_of_the_whole_body() -> None:
    """Of an animal whose neck reaches above its head, though its middle is lower."""
    animal = read_description(model_path("quadruped"))
    neck = next(part for part in animal.parts if part.name == "neck")
    higher = neck.model_copy(update={"end": (0.53, 0.0, 0.45)})
    parts = tuple(higher if part is neck else part for part in animal.parts)
    space = space_of(animal.model_copy(update={"parts": parts}), ShapePrior())
    shape = np.zeros(len(space.names))
    body = space.body(shape)
    row = height_row((body, space.neighbours(shape), space.steps(shape)), 0.9, 1.0)
    assert row.residuals[0] == pytest.approx(stature_of(body) - 0.9)
    assert stature_of(body) > stature_of(animal.build()) + 0.03


def test_a_body_without_links_has_no_bones_to_measure() -> None:
    space = space_of(read_description(model_path("human")).model_copy(update={"links": ()}), ShapePrior())
    n = len(space.names)
    assert bone_lengths(Fit(space, (), np.zeros(n), np.zeros(0), np.eye(n), (no_rows(),))) == ()


def test_offsets_and_ways_of_a_scanned_person_are_of_its_size(tmp_path: Path) -> None:
    scan = scanned(tmp_path, "upper21", POSE_DEG)
    general = read_description(model_path("upper21"))
    told = {
        "keypoints": {"nose": KeypointEntry(landmark="neck", offset=(0.1, 0.0, 0.2))},
        "movements": {"squat": Movement(curves={"torso_z": (Term(at=-0.3),), "leg_extension": (Term(at=90.0),)})},
    }
    found = rigged(general.model_copy(update=told), read_scan(scan.files, Mirror()), "somebody").description
    ratio = found.stature_m / general.stature_m
    assert ratio < 0.97
    assert found.keypoints["nose"].offset == pytest.approx((0.1 * ratio, 0.0, 0.2 * ratio))
    curves = found.movements["squat"].curves
    assert curves["torso_z"][0].amount == pytest.approx(-0.3 * ratio)
    assert curves["leg_extension"][0].amount == 90.0
