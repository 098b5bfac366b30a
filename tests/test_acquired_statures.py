"""What a model that was acquired says of lengths: the person's own stature, and offsets of the person's size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.test_scan import POSE_DEG, scanned
from tracker.acquisition._residuals import no_rows
from tracker.acquisition.fitting import Fit
from tracker.acquisition.result import model_of, stature_of
from tracker.acquisition.scan import read_scan
from tracker.acquisition.scan_rigging import rigged
from tracker.acquisition.shape_space import ShapePrior, space_of
from tracker.body_files import read_description
from tracker.body_sections import KeypointEntry, Movement, Term
from tracker.carried import Carried, with_carried
from tracker.mirror import Mirror
from tracker.resources import model_path

POLE = Carried(name="pole", by="right_wrist", start=(0.1, 0, -0.8), end=(0.1, 0, 1.2), radii=(0.02, 0.02))


def test_what_a_person_carries_makes_nobody_taller() -> None:
    human = read_description(model_path("human"))
    space = space_of(with_carried(human, [POLE]), ShapePrior())
    n = len(space.names)
    found = Fit(space, (), np.zeros(n), np.zeros(0), 1e-4 * np.eye(n), (no_rows(n),))
    assert stature_of(found.body) > stature_of(human.build()) + 0.1
    assert model_of(found, "anna", "", ("pole",)).stature_m == pytest.approx(stature_of(human.build()))


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
