"""Greedy cover: covers what is wanted, as the plain greedy method would, near the optimum, with nothing needless."""

import itertools

import numpy as np
import pytest

from gcs.planning.views.set_cover import greedy_cover, set_weights, without_needless


def random_sets(rng, sets, elements, most):
    return [np.sort(rng.choice(elements, size=rng.integers(1, most), replace=False)) for _ in range(sets)]


def lists(sets):
    starts = np.concatenate([[0], np.cumsum([len(s) for s in sets])]).astype(np.int64)
    return starts, np.concatenate(sets).astype(np.int32)


def greedy(sets, elements, wanted=None, weights=None, **options):
    weights = np.ones(elements, np.int64) if weights is None else np.asarray(weights, np.int64)
    wanted = int(weights.sum()) if wanted is None else wanted
    return greedy_cover(*lists(sets), weights, wanted, **options).tolist()


def needed(sets, elements, chosen, wanted, weights=None):
    weights = np.ones(elements, np.int64) if weights is None else np.asarray(weights, np.int64)
    return without_needless(*lists(sets), weights, np.array(chosen, np.int64), wanted).tolist()


def plain_greedy_gains(sets, weights):
    covered, gains = np.zeros(len(weights), bool), []
    while True:
        gain = [int(weights[s][~covered[s]].sum()) for s in sets]
        if max(gain) == 0:
            return gains
        gains.append(max(gain))
        covered[sets[int(np.argmax(gain))]] = True


@pytest.mark.parametrize("seed", range(5))
def test_takes_the_largest_gain_each_time_and_covers_everything(seed):
    rng = np.random.default_rng(seed)
    sets = random_sets(rng, 80, 300, 40)
    weights = rng.integers(1, 5, 300)
    chosen = greedy(sets, 300, weights=weights)
    assert set(np.concatenate([sets[k] for k in chosen])) == set(np.concatenate(sets))
    covered, gains = np.zeros(300, bool), []
    for k in chosen:
        gains.append(int(weights[sets[k]][~covered[sets[k]]].sum()))
        best = max(int(weights[s][~covered[s]].sum()) for s in sets)
        assert gains[-1] == best
        covered[sets[k]] = True
    assert gains[0] == plain_greedy_gains(sets, weights)[0]


@pytest.mark.parametrize("seed", range(5))
def test_within_the_harmonic_bound_of_the_optimum(seed):
    sets = random_sets(np.random.default_rng(seed), 12, 20, 9)
    everything = set(np.concatenate(sets))
    optimum = next(
        n
        for n in range(1, 13)
        if any(set(np.concatenate([sets[k] for k in c])) == everything for c in itertools.combinations(range(12), n))
    )
    harmonic = sum(1 / i for i in range(1, max(map(len, sets)) + 1))
    assert len(greedy(sets, 20)) <= harmonic * optimum


def test_stops_when_enough_is_covered():
    sets = [np.arange(0, 60), np.arange(60, 90), np.arange(90, 100)]
    assert greedy(sets, 100, 60) == [0]
    assert greedy(sets, 100, 61) == [0, 1]
    assert greedy(sets, 100) == [0, 1, 2]


def test_what_is_chosen_first_stays_and_counts():
    sets = [np.arange(0, 60), np.arange(50, 90), np.arange(0, 55)]
    assert greedy(sets, 90, first=np.array([2])) == [2, 1]
    assert greedy(sets, 90, 50, first=np.array([2])) == [2]


def test_weights_decide():
    sets = [np.arange(0, 10), np.arange(10, 13)]
    assert greedy(sets, 13, 1, weights=[1] * 10 + [5] * 3) == [1]
    np.testing.assert_array_equal(set_weights(*lists(sets), np.array([1] * 10 + [5] * 3)), [10, 15])


def test_preference_decides_between_equals_but_not_over_much_more():
    sets = [np.arange(10), np.arange(10), np.arange(10, 40), np.arange(9, 40)]
    assert greedy(sets, 40, preference=np.array([0.9, 1, 1, 0.9])) == [2, 1]


def test_a_choice_that_others_make_needless_is_dropped():
    # greedy takes the middle first; the two sides then cover all of it
    sets = [np.array([1, 2, 3, 4]), np.array([0, 1, 2]), np.array([3, 4, 5])]
    assert needed(sets, 6, greedy(sets, 6), 6) == [1, 2]


def test_what_may_be_missed_goes_to_the_smallest_contributions():
    sets = [np.arange(0, 50), np.arange(50, 53), np.arange(53, 60)]
    assert needed(sets, 60, [0, 1, 2], 57) == [0, 2]
    assert needed(sets, 60, [0, 1, 2], 58) == [0, 1, 2]
    assert needed(sets, 60, [0, 1, 2], 57, weights=[1] * 50 + [9] * 3 + [1] * 7) == [0, 1]
    assert needed(sets, 60, [0], 60) == [0]


def test_it_can_be_stopped():
    def stop():
        raise KeyboardInterrupt

    sets = random_sets(np.random.default_rng(0), 9000, 9000, 40)
    with pytest.raises(KeyboardInterrupt):
        greedy(sets, 9000, poll=stop)
