"""Hints of errors: a name is offered only where it is like the one that was found."""

from __future__ import annotations

import pytest

from tracker.foundation.errors import nearest


@pytest.mark.parametrize(
    ("found", "meant"),
    [
        ("chamfr", "chamfer"),
        ("initialisation", "initialization"),
        ("strat", "start"),
        ("hunam", "human"),
        ("rg", "rig"),
        ("lost", "lost_below"),
        ("csv", "csv_table"),
        ("cam1", "cam_1"),
        ("front", "FRONT"),
    ],
)
def test_a_name_that_is_alike_is_offered(found: str, meant: str) -> None:
    assert nearest(found, [meant, "something"]).startswith(f'did you mean "{meant}"? ')


@pytest.mark.parametrize(
    ("found", "other"),
    [
        ("persons", "interiors"),
        ("tracking", "reading"),
        ("cam3", "cam_1"),
        ("left_arm", "left_leg"),
        ("plates", "passes"),
        ("kalman", "human"),
        ("x", "y"),
    ],
)
def test_a_name_that_is_another_one_is_only_listed(found: str, other: str) -> None:
    assert nearest(found, [other]) == f"valid: {other}"
