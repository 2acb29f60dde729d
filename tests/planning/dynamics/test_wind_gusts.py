"""Gusts have the strength, the memory and the seed they are given."""

import numpy as np
import pytest

from gcs.planning.dynamics.wind_gusts import WindGusts

GUSTS = WindGusts((5.0, -2.0, 0.0), 1.5, 3.0)
DT = 0.02


def test_mean_strength_and_memory():
    wind = GUSTS.sampled(400_000, DT, np.random.default_rng(1))
    assert wind.mean(axis=0) == pytest.approx([5.0, -2.0, 0.0], abs=0.15)
    assert wind.std(axis=0) == pytest.approx([1.5, 1.5, 0.75], rel=0.06)
    off = wind - wind.mean(axis=0)
    later = round(3.0 / DT)
    assert (off[later:] * off[:-later]).mean(axis=0) / off.var(axis=0) == pytest.approx(np.exp(-1.0), abs=0.06)


def test_steps_one_by_one_have_the_same_law():
    rng = np.random.default_rng(2)
    wind = [GUSTS.first(rng)]
    for _ in range(60_000):
        wind.append(GUSTS.after(wind[-1], 0.2, rng))
    wind = np.array(wind)
    assert wind.std(axis=0) == pytest.approx([1.5, 1.5, 0.75], rel=0.06)
    off = wind - wind.mean(axis=0)
    assert (off[15:] * off[:-15]).mean(axis=0) / off.var(axis=0) == pytest.approx(np.exp(-1.0), abs=0.06)


def test_the_seed_decides():
    one, again, other = (GUSTS.sampled(100, DT, np.random.default_rng(seed)) for seed in (3, 3, 4))
    assert np.array_equal(one, again)
    assert not np.allclose(one, other)
