"""What several test files share."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from motions import Movement, made_up
from numbered_pictures import record
from observations import bent, four_views, ideal

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Person, Scene
from tracker.cameras.calibration import _board_looks, _floor_marks
from tracker.foundation.arrays import Array, Image, Integers
from tracker.foundation.resources import model_path
from tracker.images.sight import Observation


@pytest.fixture(scope="session")
def data() -> Callable[[str], Path]:
    """Path of a recording in the folder BODYTRACK_DATA; skips the test, saying what is missing."""

    def path(relative: str) -> Path:
        root = os.environ.get("BODYTRACK_DATA")
        found = Path(root, relative) if root else None
        if found is None or not found.exists():
            pytest.skip(f"needs BODYTRACK_DATA/{relative}")
        return found

    return path


@pytest.fixture(scope="session")
def body() -> BodyModel:
    """The 22-parameter body."""
    return load_body(model_path("gavrila22"))


@pytest.fixture(scope="session")
def truth(body: BodyModel) -> Scene:
    """One bent person before four cameras."""
    return Scene((Person("one", body, bent(body)),), four_views())


@pytest.fixture(scope="session")
def observation(truth: Scene) -> Observation:
    """The contours of `truth` as edges."""
    return ideal(truth)


@pytest.fixture(scope="module")
def limbs_stay() -> Iterator[None]:
    """Limbs are not looked for elsewhere when persons are found: before true starts that takes most of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tracker.tracking.cycle_turn.in_likeliest_places", lambda objective, estimate, *_: estimate)
        yield


@pytest.fixture(scope="module")
def markers_once() -> Iterator[None]:
    """Markers of a kind are looked for once in a picture: in those that tests have in common, for a second each."""
    looked, found = _board_looks.markers_in, {}

    def once(shown: Image, dictionary: str) -> tuple[Sequence[Array], Integers]:
        key = hashlib.sha256(np.ascontiguousarray(shown)).digest(), shown.shape, dictionary
        if key not in found:
            found[key] = looked(shown, dictionary)
        return found[key]

    with pytest.MonkeyPatch.context() as patch:
        for module in (_board_looks, _floor_marks):
            patch.setattr(module, "markers_in", once)
        yield


@pytest.fixture(scope="module", params=["gavrila22", "human", "quadruped"])
def movement(request: pytest.FixtureRequest) -> Movement:
    """Two persons with a made-up movement, the first one of each model and lost for a while."""
    return made_up(request.param, "gavrila22")


@pytest.fixture(scope="session")
def numbered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small recording whose pictures tell their view and number."""
    return record(tmp_path_factory.mktemp("numbered"))


@pytest.fixture
def copied(numbered: Path, tmp_path: Path) -> Path:
    """A copy of it that a test may spoil."""
    return Path(shutil.copytree(numbered, tmp_path / "copy"))
