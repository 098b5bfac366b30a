"""A racket, a rucksack: parts of a person's body that no model file has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rounding import assert_alike

from tracker.acquisition.shape_space import ShapePrior, space_of
from tracker.bodies.body.description import read_description
from tracker.bodies.subject import Subject, with_carried
from tracker.foundation.configuration.tables import build_class, described_fields
from tracker.foundation.errors import ConfigError
from tracker.foundation.resources import model_path

RACKET = {
    "name": "racket",
    "by": "right_wrist",
    "start": [0.0, 0.0, -0.4],
    "end": [0.0, 0.0, -0.7],
    "radii": [0.13, 0.01],
}


def subject(*carries: dict[str, Any], **told: Any) -> Subject:
    """A person as a configuration describes it."""
    table = {"name": "anna", "model": str(model_path("human")), "carries": list(carries), **told}
    found: Subject = build_class(Subject, table, "persons[0]", Path())
    return found


@pytest.mark.parametrize("stature_m", [None, 1.5])
def test_a_thing_hangs_on_the_segment_of_its_landmark_and_keeps_its_size(stature_m: float | None) -> None:
    told = {} if stature_m is None else {"stature_m": stature_m}
    alone, laden = subject(**told).body(), subject(RACKET, **told).body()
    part = [part.name for part in laden.parts].index("racket")
    assert len(laden.parts) == len(alone.parts) + 1
    np.testing.assert_allclose(laden.parts[part].shape.size, (0.13, 0.01, 0.15))
    q = laden.rest()
    wrist = laden.landmark_names.index("right_wrist")
    np.testing.assert_allclose(laden.landmarks_in_world(q), alone.landmarks_in_world(q))
    middle, at = laden.world_from_part(q)[part, :3, 3], laden.landmarks_in_world(q)[wrist]
    np.testing.assert_allclose(middle, at + np.array([0, 0, -0.55]), atol=1e-6)
    # it turns with the hand, and with nothing beyond it
    q[laden.index("right_wrist_flexion")] += 0.5
    turned = laden.world_from_part(q)[part, :3, 3] - at
    assert np.linalg.norm(turned) == pytest.approx(0.55)
    assert np.arccos(-turned[2] / 0.55) == pytest.approx(0.5, abs=1e-6)
    q[laden.index("left_wrist_flexion")] += 0.5
    assert_alike(laden.world_from_part(q)[part, :3, 3] - at, turned)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("grown", ["left_upper_arm.length", "left_shoulder.joint_y", "chest.width", "stature"])
def test_a_thing_stays_in_its_hand_while_the_arm_grows(side: str, grown: str) -> None:
    """The other hand has none: it is neither moved twice nor left behind."""
    laden = subject({**RACKET, "by": f"{side}_wrist"}).description()
    space = space_of(laden, ShapePrior())
    shape = np.zeros(len(space.names))
    shape[space.names.index(grown)] = 0.02
    found = space.described(shape)
    ways = [np.subtract(one.parts[-1].start, one.landmarks[f"{side}_wrist"].at) for one in (laden, found)]
    moved = np.subtract(found.landmarks[f"{side}_wrist"].at, laden.landmarks[f"{side}_wrist"].at)
    assert np.linalg.norm(moved) > 4e-4
    np.testing.assert_allclose(ways[1], ways[0] * (1.02 if grown == "stature" else 1.0), atol=1e-12)


@pytest.mark.parametrize("by", ["right_wrist", "neck"])
def test_a_thing_beside_the_body_can_be_fitted_to_every_side(by: str) -> None:
    start, end = ([0.0, -0.3, -0.1], [0.0, -0.5, -0.4]) if by == "neck" else ([0.0, 0.0, -0.1], [0.0, -0.2, -0.4])
    space = space_of(
        subject({**RACKET, "by": by, "start": start, "end": end, "radii": [0.1, 0.1]}).description(), ShapePrior()
    )
    assert {"racket.start_side", "racket.end_side"} <= set(space.names)
    shape = np.zeros(len(space.names))
    shape[space.names.index("racket.end_along")] = 0.1
    before, after = (
        np.subtract(one.parts[-1].end, one.parts[-1].start) for one in (space.description, space.described(shape))
    )
    np.testing.assert_allclose(after / np.linalg.norm(after), before / np.linalg.norm(before), atol=1e-12)


def test_without_a_thing_the_body_is_what_it_was() -> None:
    description = read_description(model_path("human"))
    assert with_carried(description, ()) is description


def test_a_configuration_keeps_what_is_carried() -> None:
    told = subject(RACKET, stature_m=1.7)
    again = build_class(Subject, described_fields(told), "persons[0]", Path())
    assert again == told
    assert again.description() == told.description()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"by": "right_wirst"}, "right_wrist"),
        ({"name": "right_hand"}, "has a part of that name"),
        ({"radii": [0.1, 0.0]}, "radii"),
        ({"strat": [0, 0, 0]}, "start"),
    ],
)
def test_what_is_wrong_is_named(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        subject({**RACKET, **changed}).description()


def test_two_things_have_two_names() -> None:
    with pytest.raises(ConfigError, match="has a part of that name"):
        subject(RACKET, RACKET).description()


def test_who_is_drawn_by_a_skin_carries_nothing() -> None:
    description = read_description(model_path("human"))
    dressed = description.model_copy(update={"skin": object()})
    with pytest.raises(ConfigError, match="has a skin"):
        with_carried(dressed, subject(RACKET).carries)
