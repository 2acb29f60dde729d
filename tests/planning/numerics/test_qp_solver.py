"""Quadratic programs with known answers, and answers that must not be believed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from gcs.core.errors import InfeasibleError
from gcs.planning.numerics.qp_solver import (
    ClarabelSolver,
    OsqpSolver,
    PiqpSolver,
    QpProblem,
    SolverError,
    evidence,
    general_solvers,
    solve_checked,
)


@pytest.fixture
def nearest():
    """The point of the unit box that is nearest to (2, 0.25, -3), with unequal weights: (1, 0.25, 0)."""
    weights = np.array([1.0, 2.0, 0.5])
    return QpProblem(
        hessian=sparse.diags(weights, format="csc"),
        gradient=-weights * np.array([2.0, 0.25, -3.0]),
        constraints=sparse.eye(3, format="csc"),
        low=np.zeros(3),
        high=np.ones(3),
        spread=np.ones(3),
    )


ANSWER = np.array([1.0, 0.25, 0.0])
MULTIPLIERS = np.array([1.0, 0.0, -1.5])


@pytest.mark.parametrize("solver", general_solvers(), ids=lambda s: s.name)
def test_every_solver_finds_point_and_multipliers(nearest, solver):
    answer = solver.solve(nearest)
    assert answer.solved
    np.testing.assert_allclose(answer.x, ANSWER, atol=1e-5)
    np.testing.assert_allclose(answer.multipliers, MULTIPLIERS, atol=1e-5)
    assert answer.violation < 1e-6
    assert answer.gap < 1e-5


@pytest.mark.parametrize("solver", general_solvers(), ids=lambda s: s.name)
def test_rows_with_one_bound_only_push_to_one_side(nearest, solver):
    one_sided = replace(nearest, low=np.array([-np.inf, -np.inf, 0.0]), high=np.array([1.0, np.inf, np.inf]))
    answer = solver.solve(one_sided)
    assert answer.solved
    np.testing.assert_allclose(answer.x, ANSWER, atol=1e-5)
    np.testing.assert_allclose(answer.multipliers, MULTIPLIERS, atol=1e-5)
    assert answer.gap < 1e-5
    # A bound that there is not cannot be what an answer leans on.
    assert evidence(one_sided, ANSWER, np.array([1.0, 0.0, 1.5]))[1] >= 1.5


def test_the_exact_answer_has_no_violation_and_no_gap(nearest):
    assert evidence(nearest, ANSWER, MULTIPLIERS) == (0.0, 0.0)


def test_the_gap_bounds_the_cost_above_the_optimum(nearest):
    def cost(x):
        return 0.5 * x @ (nearest.hessian @ x) + nearest.gradient @ x

    rng = np.random.default_rng(0)
    for _ in range(200):
        x = rng.uniform(0, 1, 3)
        _, gap = evidence(nearest, x, MULTIPLIERS + rng.normal(size=3) * 0.3)
        assert gap >= cost(x) - cost(ANSWER) - 1e-12


def test_points_outside_and_answers_that_are_not_numbers_show(nearest):
    assert evidence(nearest, ANSWER + np.array([0.5, 0, 0]), MULTIPLIERS)[0] == pytest.approx(0.5)
    assert evidence(nearest, np.array([np.nan, 0, 0]), MULTIPLIERS) == (np.inf, np.inf)


class Liar:
    """Says solved, but gives another answer."""

    name = "liar"

    def __init__(self, change, solved=True):
        self.change, self.solved = change, solved

    def solve(self, problem):
        honest = PiqpSolver().solve(problem)
        x = honest.x + self.change
        violation, gap = evidence(problem, x, honest.multipliers)
        return replace(honest, x=x, solver=self.name, violation=violation, gap=gap, solved=self.solved)


@pytest.mark.parametrize(
    "liar", [Liar(np.array([1e-3, 0, 0])), Liar(np.array([0, 0.4, 0])), Liar(np.zeros(3), solved=False)]
)
def test_an_answer_that_is_outside_or_not_optimal_or_not_solved_goes_to_the_next_solver(nearest, liar):
    assert solve_checked(nearest, [liar, ClarabelSolver()]).solver == "Clarabel"
    with pytest.raises(SolverError, match="liar") as error:
        solve_checked(nearest, [liar])
    assert isinstance(error.value, InfeasibleError)


def test_osqp_at_its_iteration_limit_is_not_believed():
    """A badly scaled problem on which operator splitting creeps."""
    rng = np.random.default_rng(1)
    basis = np.linalg.qr(rng.normal(size=(40, 40)))[0]
    hessian = basis @ np.diag(np.logspace(-9, 4, 40)) @ basis.T
    problem = QpProblem(
        hessian=sparse.csc_matrix((hessian + hessian.T) / 2),
        gradient=basis @ np.logspace(-6, 3, 40),
        constraints=sparse.csc_matrix(rng.normal(size=(80, 40))),
        low=-np.ones(80),
        high=np.ones(80),
        spread=np.full(40, 100.0),
    )
    creeping = OsqpSolver().solve(problem)
    assert not creeping.solved or creeping.gap > 1e-6
    assert solve_checked(problem, [OsqpSolver(), PiqpSolver()], gap=1e-6).solver == "PIQP"
