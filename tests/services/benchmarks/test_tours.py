"""The quick version of the benchmark runs, and its instances are what they are said to be."""

import math

import numpy as np
import pytest

from gcs.planning.tours.tour_costs import TourCosts
from gcs.services.benchmarks import tour_references
from gcs.services.benchmarks.tours import (
    METRIC,
    generalised_targets,
    run,
    tower_face,
    tower_points,
    z_path,
)


def test_quick_rows_have_all_figures_and_hold_their_bounds():
    rows = {(row.case, row.figure): row.value for row in run(True)}
    cases = {case for case, _ in rows}
    assert {"face-4x88-open", "face-4x88-closed"} <= cases
    for case in cases:
        if case.startswith("genetic"):
            assert rows[case, "gap"] < 0.1
            assert rows[case, "saving_one_metric"] < 1
            continue
        assert {"cost", "lower_bound", "gap", "seconds"} <= {figure for c, figure in rows if c == case}
        assert rows[case, "lower_bound"] <= rows[case, "cost"] * (1 + 1e-9)
        assert rows[case, "gap"] == pytest.approx(rows[case, "cost"] / rows[case, "lower_bound"] - 1, abs=1e-9)
    assert rows["face-4x88-open", "cost"] == pytest.approx(414.688, abs=1e-3)
    assert rows["face-4x88-closed", "cost"] == pytest.approx(479.377, abs=1e-3)
    assert rows["face-4x88-open", "gap"] == rows["face-4x88-closed", "gap"] == 0.0


def test_the_z_path_flies_each_row_the_same_way():
    face = tower_face(88)
    order = z_path(4, 88)
    assert sorted(order) == list(range(352))
    assert face[order[:5]].tolist() == [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [0, 0, 1]]
    length = TourCosts.of_points(face).of_tour(order, closed=False)
    assert length == pytest.approx(88 * 3 + 87 * math.sqrt(10))
    energy = TourCosts.of_points(METRIC.stretched(face)).of_tour(order, closed=False)
    assert energy == pytest.approx(88 * 3 + 87 * math.sqrt(12))


def test_the_towers_points_are_on_its_faces():
    x, y, z = tower_points(500).T
    on_x, on_y = np.isclose(x, 0) | np.isclose(x, 4), np.isclose(y, 0) | np.isclose(y, 3)
    assert (on_x | on_y).all()
    assert (x >= 0).all()
    assert (x <= 4).all()
    assert (y >= 0).all()
    assert (y <= 3).all()
    assert 80 < np.ptp(z) <= 88
    assert (np.isclose(y, 0).mean(), np.isclose(x, 4).mean()) == (
        pytest.approx(4 / 14, abs=0.06),
        pytest.approx(3 / 14, abs=0.06),
    )


def test_home_is_the_only_candidate_of_its_target():
    candidates, targets = generalised_targets(10, 4)
    assert candidates.shape == (41, 3)
    assert np.bincount(targets).tolist() == [1] + [4] * 10


def test_a_solver_that_is_not_installed_has_no_tour(monkeypatch):
    monkeypatch.setattr(tour_references, "find_spec", lambda name: None)
    costs = np.ones((5, 5))
    for name in tour_references.REFERENCES:
        assert tour_references.reference_tour(name, costs, 0.1) is None
    assert tour_references.reference_generalised_tour(costs, np.arange(5), 0.1) is None


def test_fast_tsp_runs_beside_ours():
    pytest.importorskip("fast_tsp")
    points = np.random.default_rng(0).uniform(0, 9, (30, 3))
    costs = TourCosts.of_points(points)
    order = tour_references.reference_tour("fast-tsp", costs.matrix(), 0.1)
    assert sorted(order) == list(range(30))
    assert costs.of_tour(order) < 0.6 * costs.of_tour(np.arange(30))
