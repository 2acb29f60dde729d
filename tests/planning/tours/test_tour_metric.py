import math

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.core.scenario import PlannerOptions
from gcs.planning.tours.tour_metric import EnergyMetric, LengthMetric, TimeMetric, tour_metric

PATH = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 4.0, 2.0]])


def leg_time(length_m):
    return 2 * np.sqrt(length_m)


def test_each_metric_on_a_path_by_hand():
    assert LengthMetric().of_path(PATH) == pytest.approx(7.0)
    assert TimeMetric(leg_time).of_path(PATH) == pytest.approx(2 * math.sqrt(7.0))
    assert EnergyMetric(k=2.0, mu=3.0).of_path(PATH) == pytest.approx(2 * (5 + 2 * math.sqrt(3)))
    assert EnergyMetric(k=1.0, mu=0.0).of_path(PATH) == pytest.approx(5.0)
    assert EnergyMetric(k=1.0, mu=1.0).of_path(PATH) == pytest.approx(7.0)


@pytest.mark.parametrize(
    "metric", [LengthMetric(), TimeMetric(leg_time), EnergyMetric(1.5, 3.0), EnergyMetric(1.0, 0.2)]
)
def test_no_path_undercuts_the_straight_line(metric):
    rng = np.random.default_rng(0)
    for _ in range(50):
        path = rng.uniform(-10, 10, (4, 3))
        straight = float(metric.of_steps(path[-1] - path[0]))
        assert straight == pytest.approx(metric.of_path(path[[0, -1]]))
        assert straight <= metric.of_path(path) + 1e-12
        assert metric.of_path(path) == pytest.approx(metric.of_path(path[::-1]))


@pytest.mark.parametrize("metric", [LengthMetric(), TimeMetric(leg_time), EnergyMetric(1.5, 3.0)])
def test_steps_in_a_row_are_one_path(metric):
    steps = np.diff(PATH, axis=0)
    assert float(metric.of_steps(*steps)) == pytest.approx(metric.of_path(PATH))
    many = metric.of_steps(np.zeros((5, 4, 3)), np.ones((5, 4, 3)))
    assert many.shape == (5, 4)


def test_the_paper_makes_a_vertical_metre_cost_root_three():
    metric = EnergyMetric()
    assert metric.of_path([[0, 0, 0], [0, 0, 1]]) == pytest.approx(math.sqrt(3))
    points = np.random.default_rng(1).uniform(0, 9, (6, 3))
    assert LengthMetric().of_path(metric.stretched(points)) == pytest.approx(metric.of_path(points))


def test_the_scenario_chooses():
    for name in ("length", "time", "energy"):
        assert tour_metric(PlannerOptions(metric=name), leg_time).name == name
    chosen = tour_metric(PlannerOptions(metric="energy", k=2.0, mu=1.5), leg_time)
    assert chosen == EnergyMetric(2.0, 1.5)


@pytest.mark.parametrize(
    ("numbers", "field"), [({"k": 0.0}, "planner.k"), ({"k": -1.0}, "planner.k"), ({"mu": -0.1}, "planner.mu")]
)
def test_impossible_weights_are_refused(numbers, field):
    with pytest.raises(InputError) as refused:
        EnergyMetric(**numbers)
    assert refused.value.field == field
