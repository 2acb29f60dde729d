"""Chains tied together by planes: a general solver as oracle, chains of other chains' company, and wrong answers."""

import numpy as np
import pytest
from scipy import sparse

from gcs.planning.numerics.plane_interior_point import PlaneQp
from gcs.planning.numerics.plane_qp import judged, solve_planes
from gcs.planning.numerics.qp_solver import ClarabelSolver, QpProblem


def random_planes(seed, lengths, room=0.3):
    """Positive definite H, planes on every side of the control points, and a start that is within."""
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
    counts = rng.integers(20, 50, joints)
    first_plane = np.concatenate([[0], np.cumsum(counts)])
    joint, point = np.repeat(np.arange(joints), counts), rng.integers(0, 7, counts.sum())
    normal = rng.normal(size=(counts.sum(), 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    start = rng.normal(size=(joints, 4, 3))
    value = np.einsum("rk,rkd,rd->r", rows[joint, point], start[joint], normal)
    return PlaneQp(
        first=first,
        diagonal=diagonal,
        link=link,
        rows=rows,
        first_plane=first_plane,
        point=point,
        normal=normal,
        high=value + rng.uniform(0.2, 1, len(value)) * room,
        gradient=rng.normal(size=(joints, 4, 3)) * 5,
        spread=np.full((joints, 4, 3), 20.0),
        outset=np.full(len(lengths), 1e3),
        floor=np.full(len(lengths), 1e-3),
        start=start,
    )


def as_general(problem):
    joints = len(problem.diagonal)
    hessian = np.zeros((4 * joints, 4 * joints))
    for j in range(joints):
        here = slice(4 * j, 4 * j + 4)
        hessian[here, here] = problem.diagonal[j]
        if j + 1 < joints:
            after = slice(4 * j + 4, 4 * j + 8)
            hessian[here, after], hessian[after, here] = problem.link[j], problem.link[j].T
    planes = np.zeros((len(problem.high), joints, 12))
    joint = np.repeat(np.arange(joints), np.diff(problem.first_plane))
    for r, (j, k) in enumerate(zip(joint, problem.point, strict=True)):
        planes[r, j] = np.outer(problem.rows[j, k], problem.normal[r]).ravel()
    return QpProblem(
        hessian=sparse.csc_matrix(np.kron(hessian, np.eye(3))),
        gradient=problem.gradient.ravel(),
        constraints=sparse.csc_matrix(planes.reshape(len(problem.high), -1)),
        low=np.full(len(problem.high), -np.inf),
        high=problem.high,
        spread=problem.spread.ravel(),
    )


@pytest.mark.parametrize("seed", range(6))
def test_it_finds_the_optimum_of_a_general_solver(seed):
    problem = random_planes(seed, [1, 5, 0, 12, 2])
    answer = solve_planes(problem, 1e-9)
    assert answer.good.all()
    assert (answer.iterations[[0, 1, 3, 4]] > 0).all()
    general = as_general(problem)
    theirs = ClarabelSolver().solve(general)

    def cost(x):
        return 0.5 * x @ (general.hessian @ x) + general.gradient @ x

    ours = answer.x.ravel()
    assert cost(ours) == pytest.approx(cost(theirs.x), abs=1e-4)
    assert (general.constraints @ ours <= general.high).all()
    assert (np.abs(general.constraints @ ours - general.high) < 1e-6).any()


def test_the_gap_bounds_what_an_answer_costs_too_much():
    problem = random_planes(1, [9])
    best = solve_planes(problem, 1e-9).x
    coarse = solve_planes(problem, 1e-2)
    _, above, change = judged(problem, coarse.x, np.zeros(len(problem.high)))
    _, _, least = judged(problem, best, np.zeros(len(problem.high)))
    assert change[0] - least[0] <= above[0]
    assert change[0] - least[0] <= coarse.gap[0] * (problem.outset[0] + change[0] + problem.floor[0])


def test_answers_outside_or_not_finite_have_their_violation():
    problem = random_planes(2, [3, 4])
    x = solve_planes(problem, 1e-6).x
    x[1, 0, 2] = np.nan
    violation, _, _ = judged(problem, x, np.zeros(len(problem.high)))
    assert violation[0] == np.inf
    assert violation[1] <= 0
    far = problem.start + 100.0
    violation, _, _ = judged(problem, far, np.zeros(len(problem.high)))
    value = as_general(problem).constraints @ far.ravel() - problem.high
    assert violation.max() == pytest.approx(value.max())


def test_a_start_outside_and_a_cost_that_is_not_convex_are_not_good_and_leave_the_others_alone():
    problem = random_planes(3, [3, 4, 5])
    start = problem.start.copy()
    start[0] += 100.0
    diagonal = problem.diagonal.copy()
    diagonal[8] -= 1e4 * np.eye(4)
    answer = solve_planes(problem._replace(start=start, diagonal=diagonal), 1e-6)
    np.testing.assert_array_equal(answer.good, [False, True, False])
    assert answer.iterations[0] == -2
    assert answer.iterations[2] < 0
    np.testing.assert_array_equal(answer.x[3:7], solve_planes(problem, 1e-6).x[3:7])
