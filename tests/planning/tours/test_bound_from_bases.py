"""The bound of tours from several bases against the cheapest of all ways."""

import itertools

import numpy as np
import pytest

from gcs.planning.tours.bound_from_bases import bound_from_bases


def apart(points):
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


def cost(costs, run):
    nodes = [-1, *run, -1]
    return sum(costs[a, b] for a, b in itertools.pairwise(nodes))


def cheapest(least_costs):
    """By trying every order, every cut of it and every base for each run."""
    n = len(least_costs[0]) - 1
    best = np.inf
    for order in itertools.permutations(range(n)):
        to = [0.0]
        for end in range(1, n + 1):
            to.append(min(to[a] + min(cost(c, order[a:end]) for c in least_costs) for a in range(end)))
        best = min(best, to[n])
    return best


@pytest.mark.parametrize("seed", range(10))
def test_no_way_undercuts_it_and_it_is_near(seed):
    rng = np.random.default_rng(seed)
    stops = rng.uniform(0, 10, (5, 3))
    bases = rng.uniform(-2, 12, (int(rng.integers(1, 4)), 3))
    least_costs = [apart(np.vstack([stops, base])) for base in bases]
    bound = bound_from_bases(least_costs, range(5))
    least = cheapest(least_costs)
    assert 0.8 * least <= bound <= least + 1e-9


def test_a_far_home_does_not_count_when_another_base_is_near():
    stops = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    near, far = (apart(np.vstack([stops, base])) for base in ([[0.0, 0, 0]], [[100.0, 0, 0]]))
    assert bound_from_bases([far], [0, 1, 2]) == pytest.approx(200.0)
    assert bound_from_bases([far, near], [0, 1, 2]) == pytest.approx(4.0)


def test_of_many_stops_it_stays_below_a_good_series():
    rng = np.random.default_rng(4)
    stops = np.vstack([rng.uniform(0, 10, (30, 3)), rng.uniform(90, 100, (30, 3))])
    bases = np.array([[5.0, 5.0, 0.0], [95.0, 95.0, 90.0]])
    least_costs = [apart(np.vstack([stops, base])) for base in bases]
    order = [*range(30), *range(30, 60)]
    two = sum(cost(c, run) for c, run in zip(least_costs, (range(30), range(30, 60)), strict=True))
    bound = bound_from_bases(least_costs, order)
    assert 0.3 * two < bound < two
