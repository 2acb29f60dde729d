"""A slowed plan is the warped motion, and the known map never calls free what is too near to the structure."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from gcs.core.structure import Structure
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.trajectories.retiming import TimeWarp, identity_warp
from gcs.planning.trajectories.warped_curve import slowed_curve
from gcs.services.companion.flyable_plan import known_map


@pytest.fixture
def plan(make_flyable):
    return make_flyable().plan


def test_a_slowed_curve_is_the_warped_motion_and_smooth(plan):
    curve = plan.trajectory
    times = np.linspace(0.0, curve.duration_s, 200)
    warp = TimeWarp(times, 1.0 - 0.5 * np.exp(-(((times - 11.0) / 2.0) ** 2)))
    slowed = slowed_curve(curve, warp)
    assert slowed.duration_s == pytest.approx(warp.duration_s, abs=1e-6)
    t = np.linspace(0.0, warp.duration_s, 3001)
    wanted = warp.setpoint(curve, t)
    for order, tolerance in enumerate((1e-4, 1e-3, 2e-2)):
        assert np.abs(slowed.value(t, order) - wanted[order]).max() < tolerance
    for order in range(3):
        ends = slowed.starts_s[1:-1]
        jumps = slowed.value(ends - 1e-9, order) - slowed.value(ends + 1e-9, order)
        assert np.abs(jumps).max() < 1e-3


def test_what_need_not_be_slowed_stays_as_it_is(plan):
    curve = plan.trajectory
    same = slowed_curve(curve, identity_warp(curve.duration_s))
    assert np.array_equal(same.coefficients, curve.coefficients)


def test_no_point_of_a_free_cell_is_too_near(plan, box):
    known = known_map(plan, box)
    rng = np.random.default_rng(4)
    free = np.argwhere(~known.blocked)
    cells = free[rng.choice(len(free), 20_000)] + rng.random((20_000, 3))
    away = SceneDistance(box, plan.scenario.ground_m).distance(known.points_m(cells))
    assert away.min() >= plan.scenario.centre_clearance_m - 1e-9
    blocked = known.points_m(np.argwhere(known.blocked) + 0.5)
    far = SceneDistance(box, plan.scenario.ground_m).distance(blocked)
    assert far.max() < plan.scenario.centre_clearance_m + 2 * known.cell_m, "and little more is blocked"


@pytest.fixture
def box():
    """A block of 2 m beside the way."""
    corners = np.array(list(itertools.product((5.0, 7.0), (3.0, 5.0), (0.0, 12.0))))
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    return Structure(vertices_m=corners, faces=np.array(faces), cables=())


def test_a_curve_of_one_piece(plan):
    leg = PiecewisePolynomial(plan.trajectory.coefficients[1:2], plan.trajectory.durations_s[1:2])
    times = np.linspace(0.0, leg.duration_s, 50)
    slowed = slowed_curve(leg, TimeWarp(times, np.full(50, 0.5)))
    assert slowed.duration_s == pytest.approx(2 * leg.duration_s, rel=1e-6)
    assert slowed.value(slowed.duration_s) == pytest.approx(leg.value(leg.duration_s), abs=1e-9)
