"""Samples are even by area, lie on the surface, and come with both sides."""

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.core.inspection import Region
from gcs.core.structure import Structure
from gcs.planning.views.surface_samples import LIFT_M, sample_surface, surface_area

# a square of 10 x 10 at z = 0 (normal up) and one of 5 x 5 at x = 20 (normal +x)
VERTICES = np.array(
    [[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0], [20, 0, 0], [20, 5, 0], [20, 5, 5], [20, 0, 5]], dtype=float
)
SQUARES = Structure(VERTICES, np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]))


def test_samples_are_spread_by_area_with_both_sides():
    samples = sample_surface(SQUARES, 20000, np.random.default_rng(0))
    assert len(samples) == 40000
    flat = samples.points_m[:, 0] < 15
    assert flat.mean() == pytest.approx(0.8, abs=0.01)
    np.testing.assert_allclose(samples.points_m[flat, 2], 0)
    np.testing.assert_allclose(samples.points_m[~flat, 0], 20)
    np.testing.assert_allclose(np.abs(samples.normals[flat]), [[0, 0, 1]] * flat.sum())
    assert samples.normals[:, 2].sum() == pytest.approx(0)
    counts, _, _ = np.histogram2d(*samples.points_m[flat, :2].T, bins=4, range=[[0, 10], [0, 10]])
    np.testing.assert_allclose(counts, 40000 * 0.8 / 16, rtol=0.1)
    np.testing.assert_allclose(np.linalg.norm(samples.lifted_m - samples.points_m, axis=1), LIFT_M)


def test_regions_select_surface():
    region = Region(min_m=(-1, -1, -1), max_m=(4, 2, 1))
    samples = sample_surface(SQUARES, 500, np.random.default_rng(0), (region,))
    assert len(samples) == 1000
    assert (samples.points_m <= [4, 2, 1]).all()
    assert surface_area(SQUARES, (region,)) == pytest.approx(8, rel=0.1)
    assert surface_area(SQUARES, ()) == pytest.approx(125)


def test_two_regions_are_a_union():
    regions = (Region(min_m=(0, 0, -1), max_m=(1, 1, 1)), Region(min_m=(19, 0, 0), max_m=(21, 1, 1)))
    x = sample_surface(SQUARES, 400, np.random.default_rng(0), regions).points_m[:, 0]
    assert (x < 1).mean() == pytest.approx(0.5, abs=0.1)


def test_regions_without_surface_are_refused():
    for low in ((50, 50, 50), (3, 3, 1)):
        region = Region(min_m=low, max_m=tuple(c + 1 for c in low))
        with pytest.raises(InputError, match=r"inspection\.surface\.regions: no surface"):
            sample_surface(SQUARES, 100, np.random.default_rng(0), (region,))


def test_the_seed_decides():
    a, b, c = (sample_surface(SQUARES, 50, np.random.default_rng(s)).points_m for s in (1, 1, 2))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)
