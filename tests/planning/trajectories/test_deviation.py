"""Distance from a polyline against a brute-force search."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.planning.trajectories.deviation import PolylineDistance


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 70))
def test_it_is_the_least_distance_to_any_leg(seed, corners):
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.normal(size=(corners, 3)) * 4, axis=0)
    path[corners // 2] = path[corners // 2 - 1]
    points = path[rng.integers(0, corners, 40)] + rng.normal(size=(40, 3)) * 3
    share = np.linspace(0, 1, 401)[:, None, None]
    dense = ((1 - share) * path[:-1] + share * path[1:]).reshape(-1, 3)
    brute = np.linalg.norm(points[:, None] - dense[None], axis=2).min(axis=1)
    found = PolylineDistance(path).distance(points)
    assert (found <= brute + 1e-12).all()
    spacing = np.linalg.norm(np.diff(path, axis=0), axis=1).max() / 400
    assert (found >= brute - spacing).all()
    np.testing.assert_allclose(PolylineDistance(path).distance(path), 0.0, atol=1e-12)
