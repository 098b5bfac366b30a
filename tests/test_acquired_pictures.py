"""Pictures of an acquired model, and silhouettes that models are acquired from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.acquisition.result import shaded_views, stature_of
from tracker.bodies.body import BodyModel
from tracker.evidence.measures.outlines import largest_region


def test_a_body_that_does_not_tell_its_stature_is_drawn_as_high_as_its_parts(body: BodyModel) -> None:
    pictures, _ = shaded_views(replace(body, stature_m=0.0), body.rest())
    told, _ = shaded_views(replace(body, stature_m=stature_of(body)), body.rest())
    np.testing.assert_array_equal(pictures, told)
    assert all((picture != picture[0, 0]).any() for picture in pictures)


def test_specks_in_a_silhouette_are_filled_and_what_an_arm_encloses_is_not() -> None:
    mask = np.zeros((200, 200), np.bool_)
    mask[20:180, 40:160] = True
    mask[0, 0] = True  # of a speck beside
    expected = mask.copy()
    expected[0, 0] = expected[50:80, 60:70] = mask[50:80, 60:70] = False
    mask[100, 100] = mask[120:123, 90:93] = False
    np.testing.assert_array_equal(largest_region(mask), expected)
