"""A new measure and a new kind of evidence are one file each: written into a foreign package, they track."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation

from tracker.foundation.configuration.tables import build, describe
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.estimate import Status
from tracker.tracking.sequence import track

HAUSDORFF = '''
"""The partial Hausdorff distance (Huttenlocher, Klanderman, Rucklidge 1993)."""

from __future__ import annotations

import numpy as np
import pydantic
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.configuration.components import component
from tracker.evidence.measures.correspondences import correspondences
from tracker.evidence.measures.correspondences import Equations


@component
class Hausdorff:
    """How far all but a share of the contour is from the edges, and all but a share of the edges from the contour."""

    share: float = pydantic.Field(default=0.8, gt=0, le=1)
    """Share of the points that must be as near."""

    def distances(self, asked: Comparison, poses: Array) -> Array:
        contours = asked.contours(poses, coarse=True)
        found = np.full((len(poses), len(asked.observed.views)), np.nan)
        for v, view in enumerate(asked.observed.views):
            if view is None:
                continue
            edges = view.edges[view.scene]
            for b in range(len(poses)):
                model = contours.of(v, b)
                model = model.pixels[model.weights > 0]
                gaps = cKDTree(edges).query(model)[0], cKDTree(model).query(edges)[0]
                found[b, v] = max(np.quantile(gap, self.share) for gap in gaps)
        return found

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        pairs = correspondences(asked, q, gate_px, 40.0)
        if not len(pairs.weights):
            return Equations.nothing(asked.body.dof)
        residual, jacobian = pairs.residual(asked.body, q, asked.scene.rig)
        near = np.abs(residual) <= np.quantile(np.abs(residual), self.share)
        return Equations.of(residual[near], jacobian[near], pairs.weights[near])
'''

MARKERS = '''
"""Evidence of markers: points in space that another system has measured on the body's landmarks."""

from __future__ import annotations

import numpy as np

from tracker.evidence.measures.account import Account
from tracker.foundation.arrays import Array
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.configuration.components import FilePath, component
from tracker.bodies.contours import Contours
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence import Evidence
from tracker.images.sight import Sight


@component
class Markers(Evidence):
    """Distances of landmarks to their markers."""

    points: FilePath
    """Array (T, L, 3) of all frames, metres."""

    px_per_m: float = 200.0
    """What a metre counts, px."""

    def observe(self, sight: Sight, expected: Contours | None, memory: object = None) -> Array:
        return np.load(self.points)[sight.frame.index]

    def distances(self, asked: Comparison, poses: Array) -> Array:
        gaps = asked.body.landmarks_in_world(poses) - asked.observed
        return self.px_per_m * np.linalg.norm(gaps, axis=-1).mean(axis=-1)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        body, points = asked.body, asked.body.landmarks_in_world(q)
        ends = np.array([mark.parameter for mark in body.landmarks])
        residual = self.px_per_m * (points - asked.observed).ravel()
        jacobian = self.px_per_m * body.point_jacobian(q, points, ends).reshape(-1, body.dof)
        return Equations.of(residual, jacobian, np.ones(len(residual)))

    def account(self, asked: Comparison, q: Array) -> Account:
        distance_px = float(self.distances(asked, q[None])[0])
        n_parts, n_views = len(asked.body.parts), len(asked.scene.rig)
        visible = np.full(n_parts, 100.0)
        explained = visible * max(0.0, 1 - distance_px / 40.0)
        per_part = np.full(n_parts, distance_px)
        return Account(distance_px, np.full(n_views, distance_px), per_part, visible, explained, np.zeros(n_parts))
'''


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation(n_frames=4)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package of somebody else's, with a file for each."""
    folder = tmp_path_factory.mktemp("lab") / "somebodys_lab"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "hausdorff.py").write_text(HAUSDORFF)
    (folder / "markers.py").write_text(MARKERS)
    return folder


def errors_mm(simulation: Simulation, table: dict[str, object]) -> list[float]:
    """Mean joint errors of all frames, tracked with the evidence that a configuration describes."""
    evidence = build("evidence", table, "test.toml [evidence]", Path("/nowhere"))
    assert build("evidence", describe(evidence), "again", Path("/nowhere")) == evidence
    cycle = cycle_for(simulation, TrueStart(simulation), evidence=evidence)
    steps = list(track(simulation.frames(), simulation.scene, cycle))
    assert [step.estimates[0].status for step in steps[1:]] == [Status.TRACKED] * (len(steps) - 1)
    return [joint_errors_mm(simulation, 0, step.frame.index, step.estimates[0].q).mean() for step in steps]


def test_a_measure_is_one_file(simulation: Simulation, lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(lab.parent)
    found = errors_mm(simulation, {"use": "contours", "similarity": {"use": "somebodys_lab.hausdorff:Hausdorff"}})
    # a pixel is 12.5 mm at the person
    assert max(found) < 12.5


def test_a_kind_of_evidence_is_one_file(
    simulation: Simulation, lab: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.syspath_prepend(lab.parent)
    truth = simulation.scene.persons[0].body.landmarks_in_world(simulation.poses[0])
    measured = truth + np.random.default_rng(0).normal(scale=0.002, size=truth.shape)
    np.save(tmp_path / "markers.npy", measured)
    table = {"use": "somebodys_lab.markers:Markers", "points": str(tmp_path / "markers.npy")}
    # three coordinates of 2 mm noise, less what the rigid segments between the landmarks average out
    assert max(errors_mm(simulation, table)) < 2 * np.sqrt(3)
    both = {"use": "together", "of": [{"use": "contours"}, table], "ranking": [1.0, 1.0], "refining": [1.0, 1.0]}
    assert max(errors_mm(simulation, both)) < 12.5
