"""The chains' own solver against general solvers, a known answer, and answers that must not be believed."""

import numpy as np
import pytest
from scipy import sparse

from gcs.planning.numerics.chain_qp import GAP, ChainQp, ChainSolver, evidence
from gcs.planning.numerics.qp_solver import ClarabelSolver, QpProblem

AXES = 3


def random_chains(seed, lengths, box=0.3):
    """Positive definite H, rows of full rank, and a start that is inside."""
    rng = np.random.default_rng(seed)
    joints = sum(lengths)
    first = np.concatenate([[0], np.cumsum(lengths)])
    root = rng.normal(size=(joints, 4, 8))
    diagonal, link = np.zeros((joints, 4, 4)), np.zeros((joints, 4, 4))
    for j in range(joints):
        diagonal[j] += root[j, :, :4] @ root[j, :, :4].T + 1e-3 * np.eye(4)
        if j + 1 < joints and j + 1 not in first:
            diagonal[j + 1] += root[j, :, 4:] @ root[j, :, 4:].T
            link[j] = root[j, :, :4] @ root[j, :, 4:].T
    rows = rng.normal(size=(joints, 7, 4))
    start = rng.normal(size=(AXES, joints, 4))
    value = np.einsum("jkc,ajc->ajk", rows, start)
    room = rng.uniform(0.2, 1, (2, *value.shape)) * box
    return ChainQp(
        first=first,
        diagonal=diagonal,
        link=link,
        rows=rows,
        gradient=rng.normal(size=(AXES, joints, 4)) * 5,
        low=value - room[0],
        high=value + room[1],
        spread=np.full((AXES, joints, 4), 20.0),
        outset=np.full((AXES, len(lengths)), 1e3),
        floor=np.full(len(lengths), 1e-3),
        start=start,
    )


def as_general(problem, axis):
    joints = problem.gradient.shape[1]
    hessian = np.zeros((4 * joints, 4 * joints))
    rows = np.zeros((7 * joints, 4 * joints))
    for j in range(joints):
        here = slice(4 * j, 4 * j + 4)
        hessian[here, here] = problem.diagonal[j]
        rows[7 * j : 7 * j + 7, here] = problem.rows[j]
        if j + 1 < joints:
            after = slice(4 * j + 4, 4 * j + 8)
            hessian[here, after], hessian[after, here] = problem.link[j], problem.link[j].T
    return QpProblem(
        hessian=sparse.csc_matrix(hessian),
        gradient=problem.gradient[axis].ravel(),
        constraints=sparse.csc_matrix(rows),
        low=problem.low[axis].ravel(),
        high=problem.high[axis].ravel(),
        spread=problem.spread[axis].ravel(),
    )


@pytest.mark.parametrize("seed", range(6))
def test_it_finds_the_optimum_of_a_general_solver(seed):
    problem = random_chains(seed, [1, 7, 0, 20, 2])
    answer = ChainSolver(1e-9).solve(problem)
    assert answer.good.all()
    for axis in range(AXES):
        general = as_general(problem, axis)
        theirs = ClarabelSolver().solve(general)
        ours = answer.x[axis].ravel()

        def cost(x, general=general):
            return 0.5 * x @ (general.hessian @ x) + general.gradient @ x

        assert cost(ours) == pytest.approx(cost(theirs.x), abs=1e-4)
        value = general.constraints @ ours
        assert (value >= general.low).all()
        assert (value <= general.high).all()


def test_a_chain_alone_is_the_chain_beside_others():
    problem = random_chains(9, [5, 8])
    both = ChainSolver().solve(problem)
    second = slice(5, 13)
    alone = ChainQp(
        np.array([0, 8]),
        problem.diagonal[second],
        problem.link[second],
        problem.rows[second],
        *(np.ascontiguousarray(v[:, second]) for v in (problem.gradient, problem.low, problem.high, problem.spread)),
        problem.outset[:, 1:],
        problem.floor[1:],
        np.ascontiguousarray(problem.start[:, second]),
    )
    np.testing.assert_array_equal(ChainSolver().solve(alone).x, both.x[:, second])


def test_a_start_outside_and_a_matrix_that_is_not_positive_are_not_believed():
    problem = random_chains(3, [4, 6])
    problem.start[1, 2] += 100.0
    answer = ChainSolver().solve(problem)
    assert answer.good.tolist() == [False, True]
    assert (answer.iterations[1, 0], answer.violation[0] > 0) == (-2, True)
    problem = random_chains(3, [4, 6])
    problem.diagonal[5] -= 1e6 * np.eye(4)
    assert ChainSolver().solve(problem).good.tolist() == [True, False]
    problem = random_chains(3, [4, 6])
    problem.gradient[0, 0, 0] = np.nan
    assert ChainSolver().solve(problem).good.tolist() == [False, True]


def test_evidence_shows_what_is_outside_what_is_not_optimal_and_what_is_no_number():
    problem = random_chains(4, [4, 6])
    x = ChainSolver().solve(problem).x
    none = np.zeros((AXES, 10, 7))
    violation, gap = evidence(problem, x, none)
    assert violation.max() == 0.0
    assert gap.min() > GAP
    x[0, 1] += 50.0
    assert (evidence(problem, x, none)[0] > 1).tolist() == [True, False]
    x[0, 1] = np.nan
    assert np.isinf(evidence(problem, x, none)[0]).tolist() == [True, False]


def test_the_gap_bounds_what_is_above_the_optimum():
    problem = random_chains(5, [6])
    best = ChainSolver(1e-10).solve(problem).x
    rng = np.random.default_rng(0)

    def cost(x):
        general = [as_general(problem, axis) for axis in range(AXES)]
        return sum(y.ravel() @ (g.hessian @ y.ravel() / 2 + g.gradient) for y, g in zip(x, general, strict=True))

    for _ in range(50):
        share = rng.uniform()
        x = share * best + (1 - share) * problem.start
        y = rng.normal(size=(AXES, 6, 7)) * rng.choice([0, 1.0])
        _, gap = evidence(problem, x, y)
        scale = max(problem.outset.sum() + cost(x), 0) + problem.floor[0]
        assert gap[0] * scale >= cost(x) - cost(best) - 1e-6


def test_a_coarser_solver_takes_fewer_steps():
    problem = random_chains(6, [30])
    fine, coarse = ChainSolver(1e-9), ChainSolver(1e-9).coarser(1e-3)
    assert coarse.solve(problem).iterations.sum() < fine.solve(problem).iterations.sum()
    assert coarse.coarser(1e-9).solve(problem).iterations.sum() == coarse.solve(problem).iterations.sum()
