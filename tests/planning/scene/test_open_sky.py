import numpy as np
import pytest

from gcs.planning.scene.open_sky import OpenSky, covered_length

FLOOR = np.random.default_rng(0).uniform(0, 10, (12, 9))
FLOOR[5:7, 3:6] = np.inf
SKY = OpenSky(np.array([-3.0, 2.0, 0.0]), 0.7, FLOOR)


def sampled(a, b, count=200_000):
    s = (np.arange(count) + 0.5) / count
    p = a + s[:, None] * (b - a)
    cell = np.floor((p[:, :2] - SKY.low[:2]) / SKY.pitch).astype(int)
    inside = ((cell >= 0) & (cell < FLOOR.shape)).all(axis=1)
    floor = np.full(count, np.inf)
    floor[inside] = FLOOR[tuple(cell[inside].T)]
    return (p[:, 2] < floor).mean() * np.linalg.norm(b - a)


@pytest.mark.parametrize("seed", range(20))
def test_it_agrees_with_fine_sampling(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform((-4, 1, 0), (6.4, 9.3, 10), (2, 3))
    assert covered_length(a, b, SKY) == pytest.approx(sampled(a, b), abs=2e-3)


def test_straight_up_and_no_way_at_all():
    a = np.array([-2.9, 2.1, 0.0])
    assert covered_length(a, a + np.array([0, 0, 10.0]), SKY) == pytest.approx(FLOOR[0, 0])
    assert covered_length(a, a, SKY) == 0.0


def test_along_the_border_of_two_columns():
    sky = OpenSky(np.zeros(3), 1.0, np.zeros((4, 4)))
    assert covered_length(np.array([0.5, 2.0, 1.0]), np.array([3.5, 2.0, 1.0]), sky) == 0.0
    assert covered_length(np.array([1.0, 1.0, 1.0]), np.array([3.0, 3.0, 1.0]), sky) == 0.0
