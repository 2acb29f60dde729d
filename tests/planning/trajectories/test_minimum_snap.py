"""Minimum snap against closed forms, and against solvers and formulations of other kinds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from gcs.planning.numerics.bernstein import monomial_from_control
from gcs.planning.numerics.chain_qp import ChainSolver
from gcs.planning.numerics.qp_solver import ClarabelSolver, OsqpSolver, PiqpSolver, SolverError, default_solvers
from gcs.planning.trajectories.minimum_snap import minimum_snap
from gcs.planning.trajectories.safe_corridor import LegCorridor, build_corridor
from gcs.planning.trajectories.snap_chain import rest_to_rest_cost, snap_cost

REST_TO_REST = np.array([0, 0, 0, 0, 35, -84, 70, -20.0])


def wide(joints):
    joints = np.array(joints, dtype=float)
    low = np.minimum(joints[:-1], joints[1:]) - 1e3
    high = np.maximum(joints[:-1], joints[1:]) + 1e3
    return LegCorridor(joints, np.stack([low, high], axis=1))


def state_jumps(control, durations):
    pieces = monomial_from_control(control)
    jumps = []
    for k in range(len(durations) - 1):
        for order in range(4):
            left = [np.polynomial.Polynomial(pieces[k, :, d]).deriv(order)(1.0) for d in range(3)]
            right = [np.polynomial.Polynomial(pieces[k + 1, :, d]).deriv(order)(0.0) for d in range(3)]
            jumps.append(np.abs(np.array(left) / durations[k] ** order - np.array(right) / durations[k + 1] ** order))
    return np.array(jumps)


def test_a_single_segment_is_the_seventh_order_rest_to_rest_polynomial():
    target = np.array([4.0, -2, 7])
    (control,) = minimum_snap([wide([[0, 0, 0], target])], [np.array([3.0])], default_solvers())
    np.testing.assert_allclose(monomial_from_control(control)[0], REST_TO_REST[:, None] * target, atol=1e-9)
    cost = rest_to_rest_cost(float(np.linalg.norm(target)), np.array(3.0))
    assert snap_cost(control, np.array([3.0])) == pytest.approx(float(cost), rel=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_the_chains_own_solver_is_inside_and_no_costlier_than_a_general_one(seed):
    rng = np.random.default_rng(seed)
    leg = np.cumsum(rng.normal(size=(rng.integers(2, 12), 3)) * rng.choice([0.3, 3, 30]), axis=0)
    corridor = build_corridor(leg, 0.5, rng.choice([1.0, 4.0, 40.0]))
    durations = (0.2 + corridor.lengths_m) * rng.uniform(0.3, 3, len(corridor.boxes_m))
    (ours,) = minimum_snap([corridor], [durations], [ChainSolver()])
    (theirs,) = minimum_snap([corridor], [durations], [PiqpSolver(), ClarabelSolver()])
    assert (ours >= corridor.boxes_m[:, :1]).all()
    assert (ours <= corridor.boxes_m[:, 1:]).all()
    assert snap_cost(ours, durations) <= snap_cost(theirs, durations) * (1 + 1e-5)


def test_a_chain_that_does_not_settle_goes_to_the_general_solvers(bent):
    class Unsettled(ChainSolver):
        name = "unsettled"

        def solve(self, problem):
            answer = super().solve(problem)
            return replace(answer, good=answer.good & (np.arange(len(answer.good)) != 1))

    corridor, durations = bent
    asked = FailsOn(100)
    curves = minimum_snap([corridor] * 3, [durations] * 3, [Unsettled(), asked])
    assert asked.asked == [4 * (len(durations) - 1)] * 3
    np.testing.assert_allclose(curves[1], curves[0], atol=2e-3)
    with pytest.raises(SolverError, match="leg 1: unsettled did not settle"):
        minimum_snap([corridor] * 3, [durations] * 3, [Unsettled()])


def test_joints_that_are_free_in_wide_boxes_give_the_same_single_polynomial():
    joints = np.linspace(0, 1, 6)[:, None] * np.array([10.0, 4, -3])
    durations = np.array([0.7, 1.1, 0.4, 2.0, 0.9])
    (control,) = minimum_snap([wide(joints)], [durations], default_solvers())
    times = np.concatenate([[0], np.cumsum(durations)]) / durations.sum()
    expected = np.polynomial.Polynomial(REST_TO_REST)(times)[1:-1, None] * np.array([10.0, 4, -3])
    np.testing.assert_allclose(control[1:, 0], expected, atol=1e-3)
    assert snap_cost(control, durations) == pytest.approx(
        float(rest_to_rest_cost(float(np.linalg.norm([10, 4, 3])), durations.sum())), rel=1e-5
    )


@pytest.fixture
def bent():
    leg = np.array([[0, 0, 0], [6.0, 0, 1], [6, 5, 1], [1, 6, 4]])
    corridor = build_corridor(leg, 0.5, 2.5)
    return corridor, 0.4 + corridor.lengths_m / 2


def test_the_hull_stays_in_the_boxes_the_states_are_continuous_and_the_ends_at_rest(bent):
    corridor, durations = bent
    (control,) = minimum_snap([corridor], [durations], default_solvers())
    assert (control >= corridor.boxes_m[:, :1]).all()
    assert (control <= corridor.boxes_m[:, 1:]).all()
    assert state_jumps(control, durations).max() < 1e-7
    np.testing.assert_array_equal(control[0, :4], np.zeros((4, 3)))
    np.testing.assert_array_equal(control[-1, 4:], np.broadcast_to(corridor.joints_m[-1], (4, 3)))


@pytest.mark.parametrize("solver", [ClarabelSolver(), OsqpSolver()], ids=lambda s: s.name)
def test_solvers_of_other_kinds_find_the_same_optimum(bent, solver):
    corridor, durations = bent
    (ours,) = minimum_snap([corridor], [durations], [PiqpSolver()])
    # The check of residuals is for the planner; here the cost itself is compared.
    (theirs,) = minimum_snap([corridor], [durations], [Trusting(solver)])
    assert snap_cost(ours, durations) == pytest.approx(snap_cost(theirs, durations), rel=2e-2)
    assert np.abs(ours - theirs).max() < 0.02


class Trusting:
    def __init__(self, solver):
        self.solver, self.name = solver, solver.name

    def solve(self, problem):
        return replace(self.solver.solve(problem), solved=True, gap=0.0, violation=0.0)


def test_no_feasible_change_of_the_states_lowers_the_cost():
    """An optimum of a convex problem: checked with a general optimiser on the control points themselves."""
    corridor = build_corridor(np.array([[0, 0, 0], [3.0, 0, 0], [3, 3, 0]]), 0.5, 3.0)
    durations = np.array([1.3, 1.6])
    (control,) = minimum_snap([corridor], [durations], default_solvers())
    cost = snap_cost(control, durations)

    def curve(states):
        from gcs.planning.numerics.bernstein import CONTROL_FROM_END, CONTROL_FROM_START

        middle = states.reshape(4, 3)
        changed = control.copy()
        changed[0, 4:] = CONTROL_FROM_END @ (middle * durations[0] ** np.arange(4)[:, None])
        changed[1, :4] = CONTROL_FROM_START @ (middle * durations[1] ** np.arange(4)[:, None])
        return changed

    def room(states):
        changed = curve(states)
        return np.concatenate(
            [(changed - corridor.boxes_m[:, :1]).ravel(), (corridor.boxes_m[:, 1:] - changed).ravel()]
        )

    start = np.concatenate([[3.0, 0, 0], np.zeros(9)])
    found = minimize(
        lambda s: snap_cost(curve(s), durations) / cost,
        start,
        constraints={"type": "ineq", "fun": room},
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-12},
    )
    assert found.fun == pytest.approx(1.0, abs=1e-3)


def test_legs_side_by_side_are_the_legs_alone(bent):
    corridor, durations = bent
    other = build_corridor(np.array([[100.0, 50, 20], [103, 58, 20]]), 0.5, 2.5)
    times = 0.3 + other.lengths_m
    short = wide([[0, 0, 0], [0, 0, 2]])
    together = minimum_snap(
        [corridor, short, other, corridor], [durations, np.array([2.0]), times, durations], default_solvers()
    )
    (alone,) = minimum_snap([other], [times], default_solvers())
    np.testing.assert_allclose(together[2], alone, atol=2e-3)
    np.testing.assert_allclose(together[0], together[3], atol=2e-3)
    assert together[1].shape == (1, 8, 3)


def test_uneven_times_and_many_segments_stay_inside():
    rng = np.random.default_rng(2)
    leg = np.cumsum(rng.normal(size=(30, 3)) * 5, axis=0)
    corridor = build_corridor(leg, 0.5, 2.5)
    durations = rng.uniform(0.05, 5.0, len(corridor.boxes_m))
    (control,) = minimum_snap([corridor], [durations], default_solvers())
    assert (control >= corridor.boxes_m[:, :1]).all()
    assert (control <= corridor.boxes_m[:, 1:]).all()


class FailsOn:
    """Fails whenever a problem has the unknowns of more than so many joints."""

    name = "picky"

    def __init__(self, joints):
        self.joints, self.asked = joints, []

    def solve(self, problem):
        self.asked.append(len(problem.gradient))
        answer = PiqpSolver().solve(problem)
        return answer if len(problem.gradient) <= 4 * self.joints else replace(answer, solved=False, status="no")


def test_a_group_that_fails_is_solved_in_smaller_groups(bent):
    corridor, durations = bent
    solver = FailsOn(2 * (len(durations) - 1))
    curves = minimum_snap([corridor] * 4, [durations] * 4, [solver])
    assert len(curves) == 4
    assert solver.asked[0] > solver.asked[-1]


def test_a_leg_without_a_solution_is_named(bent):
    corridor, durations = bent
    with pytest.raises(SolverError, match=r"leg 1: no solver found a curve .*PIQP no"):
        minimum_snap([wide([[0, 0, 0], [1, 0, 0]]), corridor], [np.ones(1), durations], [FailsOn(0)])
