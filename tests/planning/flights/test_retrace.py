"""The way back along the flown path: how many points it takes, and how accurate it must be."""

from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.trajectory import PiecewisePolynomial
from gcs.core.way_home import RetraceMemory
from gcs.planning.flights.retrace import (
    MOST_POINTS,
    SPARE_POINTS,
    largest_accuracy_m,
    memory_settings,
    points_needed,
    retrace_problem,
    straightened,
)


def polyline(*points, speed=2.0):
    pieces, durations = [], []
    for a, b in zip(np.array(points[:-1], float), np.array(points[1:], float), strict=True):
        coefficients = np.zeros((8, 3))
        coefficients[0], coefficients[1] = a, b - a
        pieces.append(coefficients)
        durations.append(np.linalg.norm(b - a) / speed)
    return PiecewisePolynomial(np.array(pieces), np.array(durations))


def plan(clearance_m, trajectory=None, **safety):
    errors = {"position_m": 0.3, "model_m": 0.1, "tracking_m": 0.5, **safety}
    return SimpleNamespace(
        scenario=SimpleNamespace(safety=SimpleNamespace(**errors)),
        certificates=SimpleNamespace(min_clearance_m=clearance_m),
        trajectory=trajectory or polyline([0, 0, 0], [0, 0, 10], [20, 0, 10]),
    )


@pytest.mark.parametrize(
    ("clearance", "errors", "accuracy"),
    [
        (2.9, {}, 1.0),  # 2.9 less 0.4 of errors and twice 0.5 of tracking are 1.5
        (2.89, {}, 0.9),
        (1.4, {}, 0.0),
        (1.9, {"tracking_m": 0.1}, 0.8),
    ],
)
def test_what_is_left_of_the_clearance_is_for_the_accuracy(clearance, errors, accuracy):
    assert largest_accuracy_m(plan(clearance, **errors)) == pytest.approx(accuracy)


def test_no_point_of_a_straightened_path_is_further_from_it_than_allowed():
    t = np.linspace(0, 4 * np.pi, 400)
    path = np.column_stack([5 * np.cos(t), 5 * np.sin(t), t])
    kept = path[straightened(path, 0.3)]
    along = np.diff(kept, axis=0)
    share = np.clip(((path[:, None] - kept[:-1]) * along).sum(-1) / (along**2).sum(-1), 0, 1)
    off = np.linalg.norm(path[:, None] - kept[:-1] - share[..., None] * along, axis=-1).min(axis=1)
    assert off.max() <= 0.3
    assert 10 < len(kept) < 60


def test_a_straight_way_takes_its_ends_only_and_each_corner_one_more():
    assert points_needed(polyline([0, 0, 0], [100, 0, 0]), 0.5) == 2 + SPARE_POINTS
    corners = [[0, 0, 0], [0, 0, 20], [30, 0, 20], [30, 30, 20], [30, 30, 5]]
    needed = points_needed(polyline(*corners), 0.5) - SPARE_POINTS
    assert 5 <= needed <= 8  # a corner is caught by a point on either side of it


def test_a_memory_must_be_accurate_and_large_enough():
    flown = plan(2.9)
    assert retrace_problem(flown, RetraceMemory(1.0, 300)) == ""
    assert "1.5 m accurate, the plan allows 1.0 m" in retrace_problem(flown, RetraceMemory(1.5, 300))
    assert "does not tell" in retrace_problem(flown, None)
    assert "too close" in retrace_problem(plan(1.3), RetraceMemory(0.1, 300))
    assert "the vehicle has 20" in retrace_problem(flown, RetraceMemory(1.0, 20))
    assert retrace_problem(flown, RetraceMemory(0.0, 300)), "0 switches it off"
    assert retrace_problem(flown, RetraceMemory(float(np.float32(1.0) + np.float32(1e-7)), 300)) == ""


def test_what_to_set_is_only_what_has_to_change():
    flown, names = plan(2.9), ("ACCURACY", "POINTS")
    assert memory_settings(flown, RetraceMemory(2.0, 300, *names)) == "ACCURACY 1"
    needed = points_needed(flown.trajectory, 1.0)
    assert memory_settings(flown, RetraceMemory(2.0, 20, *names)) == f"ACCURACY 1, POINTS {needed}"
    assert memory_settings(flown, RetraceMemory(0.5, 300, *names)) == ""
    assert memory_settings(flown, None) is None
    t = np.linspace(0, 200 * np.pi, 4001)
    long = polyline(*np.column_stack([5 * np.cos(t), 5 * np.sin(t), t / 10]))
    assert points_needed(long, 1.0) > MOST_POINTS
    assert memory_settings(plan(2.9, long), RetraceMemory(2.0, 300, *names)) is None
