"""Least snap in convex sets against other solvers, closed forms, the boxes' own solver, and sampled curves."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.planning.numerics.bernstein import monomial_from_control
from gcs.planning.numerics.chain_qp import ChainSolver
from gcs.planning.numerics.qp_solver import ClarabelSolver, OsqpSolver, PiqpSolver, SolverError, default_solvers
from gcs.planning.trajectories.convex_set import outside_m
from gcs.planning.trajectories.leg_tube import tube_reach
from gcs.planning.trajectories.minimum_snap import minimum_snap
from gcs.planning.trajectories.passing import PASSED_WITHIN_M, Passing
from gcs.planning.trajectories.safe_corridor import build_corridor, corridor_reach
from gcs.planning.trajectories.snap_chain import rest_to_rest_cost, snap_cost

BENT = np.array([[0, 0, 0], [6.0, 1, 1], [6, 5, 1], [1, 6, 4]])


def tube_leg(leg=BENT, half_width=0.5, longest=2.5):
    corridor = build_corridor(np.asarray(leg, dtype=float), half_width, longest, kind="tubes")
    return corridor, 0.4 + corridor.lengths_m / 2


def sampled(control, count=60):
    powers = np.linspace(0, 1, count)[:, None] ** np.arange(8)
    return powers @ monomial_from_control(control)


def test_every_sample_of_the_curve_deviates_from_its_segment_by_no_more_than_delta():
    corridor, durations = tube_leg()
    (control,) = minimum_snap([corridor], [durations], default_solvers())
    largest = 0.0
    for points, a, b in zip(sampled(control), corridor.joints_m[:-1], corridor.joints_m[1:], strict=True):
        unit = (b - a) / np.linalg.norm(b - a)
        aside = points - a - ((points - a) @ unit)[:, None] * unit
        largest = max(largest, np.abs(aside).max())
        assert np.abs(aside).max() <= corridor_reach(0.5) / tube_reach(b - a)
    assert largest > 0.2  # the corners are cut
    assert outside_m(control, corridor.planes) == 0.0


@pytest.mark.parametrize("solver", [PiqpSolver(), ClarabelSolver(), OsqpSolver()], ids=lambda s: s.name)
@pytest.mark.parametrize("seed", range(3))
def test_solvers_of_other_kinds_find_the_same_cost(solver, seed):
    rng = np.random.default_rng(seed)
    corridor, durations = tube_leg(np.cumsum(rng.normal(size=(6, 3)) * [4, 4, 2], axis=0))
    (ours,) = minimum_snap([corridor], [durations], [ChainSolver()])
    assert outside_m(ours, corridor.planes) == 0.0
    try:
        (theirs,) = minimum_snap([corridor], [durations], [solver])
    except SolverError:
        assert solver.name == "OSQP"  # it does not always reach the residuals that are asked
        return
    assert snap_cost(ours, durations) == pytest.approx(snap_cost(theirs, durations), rel=1e-3)


def test_boxes_given_as_planes_have_the_boxes_cost():
    rng = np.random.default_rng(4)
    boxes = build_corridor(np.cumsum(rng.normal(size=(8, 3)) * 3, axis=0), 0.5, 2.5)
    durations = (0.3 + boxes.lengths_m) * rng.uniform(0.5, 2, len(boxes.boxes_m))
    (axis_by_axis,) = minimum_snap([boxes], [durations], default_solvers())
    (together,) = minimum_snap([replace(boxes, planes=boxes.sets())], [durations], default_solvers())
    assert snap_cost(together, durations) == pytest.approx(snap_cost(axis_by_axis, durations), rel=1e-4)


def test_along_axes_tubes_and_boxes_have_the_same_cost():
    leg = np.array([[0.0, 0, 0], [6, 0, 0], [6, 4, 0], [6, 4, 7]])
    tubes, durations = tube_leg(leg)
    boxes = build_corridor(leg, 0.5, 2.5)
    np.testing.assert_allclose(tubes.boxes_m, boxes.boxes_m, atol=1e-9)
    (ours,) = minimum_snap([tubes], [durations], default_solvers())
    (theirs,) = minimum_snap([boxes], [durations], default_solvers())
    assert snap_cost(ours, durations) == pytest.approx(snap_cost(theirs, durations), rel=1e-4)


def test_where_no_plane_is_reached_the_curve_is_the_one_polynomial_from_rest_to_rest():
    way = np.array([10.0, 4, -3])
    corridor = build_corridor(np.stack([np.zeros(3), way]), 3.0, 2.0, kind="tubes")
    durations = np.full(len(corridor.planes), 0.8)
    durations[[0, -1]] = 3.0
    (control,) = minimum_snap([corridor], [durations], default_solvers())
    expected = float(rest_to_rest_cost(float(np.linalg.norm(way)), durations.sum()))
    assert len(durations) > 4
    assert snap_cost(control, durations) == pytest.approx(expected, rel=1e-5)


def test_legs_side_by_side_are_the_legs_alone_and_a_leg_of_one_segment_is_among_them():
    corridor, durations = tube_leg()
    other, times = tube_leg(BENT[::-1] + 50.0)
    one, time = tube_leg([[0.0, 0, 0], [1, 1, 0]])
    together = minimum_snap([corridor, one, other], [durations, time, times], default_solvers())
    for leg, times_s, curve in zip((corridor, one, other), (durations, time, times), together, strict=True):
        (alone,) = minimum_snap([leg], [times_s], default_solvers())
        np.testing.assert_allclose(curve, alone, atol=2e-3)
    assert together[1].shape == (1, 8, 3)


def test_a_place_that_is_passed_is_passed_exactly_and_not_too_fast():
    corridor, durations = tube_leg()
    free = minimum_snap([corridor], [durations], default_solvers())[0]
    joint = int(np.linalg.norm(free[1:, 0] - corridor.joints_m[1:-1], axis=1).argmax()) + 1
    assert np.linalg.norm(free[joint, 0] - corridor.joints_m[joint]) > 0.05
    passing = Passing(np.array([joint]), np.array([0.5]), np.zeros(2))
    (control,) = minimum_snap([replace(corridor, passing=passing)], [durations], default_solvers())
    assert np.abs(control[joint, 0] - corridor.joints_m[joint]).max() <= PASSED_WITHIN_M
    assert 7 * np.linalg.norm(control[joint, 1] - control[joint, 0]) / durations[joint] <= 0.5
    assert outside_m(control, corridor.planes) == 0.0
