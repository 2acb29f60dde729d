"""Figures of a flown path, beside brute force."""

import numpy as np
import pytest

from gcs.core.structure import Structure
from gcs.planning.dynamics.flown_path import clearance_of_flight, deviation_from_curve
from gcs.planning.dynamics.predicted_flight import SAMPLE_S, PredictedFlight
from gcs.planning.scene.point_distance import SceneDistance


def flight(positions):
    positions = np.asarray(positions, float)
    return PredictedFlight(SAMPLE_S * np.arange(len(positions)), positions)


def bent(count):
    u = np.linspace(0, 1, count)
    return np.stack([40 * u, 8 * np.sin(3 * u), 20 + 5 * u**2], axis=1)


def test_deviation_and_time_of_a_shifted_flight():
    curve = bent(2000)
    flown = np.add(bent(400), (0.0, 0.0, 0.7))
    seen = deviation_from_curve(flight(flown), curve)
    apart = np.linalg.norm(flown[:, None] - curve[None], axis=2).min(axis=1)
    assert seen.complete
    assert seen.max_m == pytest.approx(apart.max(), abs=0.02)
    assert seen.mean_m == pytest.approx(apart.mean(), abs=0.02)
    # equal steps of u, of which 0.3 m and 0.5 m at the ends do not count
    assert seen.time_s == pytest.approx(SAMPLE_S * 399 * (1 - 0.8 / 47.0), abs=0.2)


def test_a_flight_that_ends_early_is_not_complete():
    seen = deviation_from_curve(flight(bent(400)[:200]), bent(2000))
    assert not seen.complete
    assert seen.max_m < 0.03


def test_a_curve_that_comes_back_does_not_hide_that_the_vehicle_is_late():
    there = np.linspace([0, 0, 0], [60, 0, 0], 600)
    back = np.linspace([60, 0.0, 0], [0, 0.0, 0], 600)
    curve = np.concatenate([there, back])
    # it turns round half-way: near the curve's way back, but far from what it should be flying
    late = np.concatenate([there[:150], there[:150][::-1]])
    assert deviation_from_curve(flight(late), curve).max_m > 10.0


def test_a_way_back_over_the_same_line_is_not_jumped_to():
    there = np.linspace([0, 0, 0], [8, 0, 0], 800)
    curve = np.concatenate([there, there[::-1]])
    flown = np.concatenate([np.linspace([0, 0, 0.2], [8.06, 0, 0.2], 100), np.linspace([8, 0, 0.2], [0, 0, 0.2], 100)])
    seen = deviation_from_curve(flight(flown), curve)
    assert seen.complete
    assert seen.max_m == pytest.approx(0.21, abs=0.02)


def test_clearance_is_that_of_the_nearest_sample_and_spares_the_column_over_home():
    wall = Structure(
        np.array([[10, -50, 0], [10, 50, 0], [10, 0, 80]], float), np.array([[0, 1, 2]], dtype=np.int64), cables=()
    )
    scene = SceneDistance(wall, 0.0)
    path = [[0, 0, z] for z in np.linspace(0, 20, 50)] + [[x, 0, 20] for x in np.linspace(0, 7, 50)]
    near = clearance_of_flight(flight(path), scene, 0.5, (0, 0, 0), 0.5)
    assert near.hull_m == pytest.approx(3.0 - 0.5)
    assert near.place_m == pytest.approx((7.0, 0.0, 20.0))
    assert near.at_s == pytest.approx(SAMPLE_S * 99)
    low = clearance_of_flight(flight([[0, 0, 1.0], [3.0, 0, 1.0]]), scene, 0.5, (0, 0, 0), 0.5)
    assert low.hull_m == pytest.approx(0.5)
