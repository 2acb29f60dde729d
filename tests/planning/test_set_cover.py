"""Greedy cover: covers what is wanted, as the plain greedy method would, near the optimum, with nothing needless."""

import itertools

import numpy as np
import pytest

from gcs.planning.set_cover import greedy_cover, without_needless


def random_sets(rng, sets, elements, most):
    return [np.sort(rng.choice(elements, size=rng.integers(1, most), replace=False)) for _ in range(sets)]


def packed(sets):
    starts = np.concatenate([[0], np.cumsum([len(s) for s in sets])]).astype(np.int64)
    return starts, np.concatenate(sets).astype(np.int32)


def cover(sets, elements, *, wanted=None, weights=None, **options):
    """The greedy choice without what is needless, as the search for views makes it."""
    starts, members = packed(sets)
    weights = np.ones(elements, np.int64) if weights is None else weights
    wanted = len(set(members)) if wanted is None else wanted
    chosen = greedy_cover(starts, members, weights, wanted, **options)
    return list(without_needless(starts, members, weights, chosen, wanted))


def plain_greedy_gains(sets, elements):
    covered, gains = np.zeros(elements, bool), []
    while True:
        gain = [int((~covered[s]).sum()) for s in sets]
        if max(gain) == 0:
            return gains
        gains.append(max(gain))
        covered[sets[int(np.argmax(gain))]] = True


@pytest.mark.parametrize("seed", range(5))
def test_covers_everything_and_no_worse_than_plain_greedy(seed):
    sets = random_sets(np.random.default_rng(seed), 80, 300, 40)
    chosen = cover(sets, 300)
    assert set(np.concatenate([sets[k] for k in chosen])) == set(np.concatenate(sets))
    assert len(chosen) <= len(plain_greedy_gains(sets, 300))
    for k in chosen:
        others = np.concatenate([sets[m] for m in chosen if m != k])
        assert not np.isin(sets[k], others).all()


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
    assert len(cover(sets, 20)) <= harmonic * optimum


def test_stops_when_enough_is_covered():
    sets = [np.arange(0, 60), np.arange(60, 90), np.arange(90, 100)]
    assert cover(sets, 100, wanted=60) == [0]
    assert cover(sets, 100, wanted=61) == [0, 1]
    assert cover(sets, 100) == [0, 1, 2]
    assert cover(sets, 100, wanted=1000) == [0, 1, 2]


def test_elements_count_by_their_weight():
    sets = [np.arange(0, 60), np.arange(60, 90)]
    assert cover(sets, 90, wanted=60, weights=np.where(np.arange(90) < 60, 1, 2)) == [0]
    assert cover(sets, 90, wanted=90, weights=np.where(np.arange(90) < 60, 1, 3)) == [1]


def test_sets_that_are_taken_anyway_come_first_and_count():
    sets = [np.arange(0, 60), np.arange(50, 90)]
    starts, members = packed(sets)
    chosen = greedy_cover(starts, members, np.ones(90, np.int64), 90, first=np.array([1]))
    assert list(chosen) == [1, 0]
    assert list(greedy_cover(starts, members, np.ones(90, np.int64), 40, first=np.array([1]))) == [1]


def test_preference_decides_between_equals_but_not_over_much_more():
    sets = [np.arange(10), np.arange(10), np.arange(10, 40), np.arange(9, 40)]
    assert cover(sets, 40, preference=np.array([0.9, 1, 1, 0.9])) == [2, 1]


def test_a_choice_that_later_ones_made_needless_is_dropped():
    # greedy takes the middle first; the two sides then cover all of it
    sets = [np.array([1, 2, 3, 4]), np.array([0, 1, 2]), np.array([3, 4, 5])]
    starts, members = packed(sets)
    assert list(greedy_cover(starts, members, np.ones(6, np.int64), 6)) == [0, 1, 2]
    assert cover(sets, 6) == [1, 2]


def test_it_can_be_stopped():
    def stop():
        raise KeyboardInterrupt

    sets = random_sets(np.random.default_rng(0), 9000, 9000, 40)
    with pytest.raises(KeyboardInterrupt):
        cover(sets, 9000, poll=stop)
