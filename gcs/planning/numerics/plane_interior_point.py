"""Kernels of `chain_interior_point`'s method for chains whose three axes are tied together by planes.

    minimise 1/2 x' H x + c' x   subject to   normal_r . (row_r x_j) <= high_r   for the planes r of every joint j

A joint's unknowns are four states of three axes; `row_r` is one of its seven control points, `normal_r` a plane's. H is
the same for all axes and does not tie them together, and a joint's planes add to its own block of 12 x 12 alone: a
Newton step is one block-tridiagonal Cholesky elimination.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.numerics.chain_interior_point import FIRST_BARRIER, RESIDUAL_SHARE, SETTLED, TO_THE_BORDER
from gcs.planning.numerics.compiled import compiled_ieee

if TYPE_CHECKING:
    from numpy.typing import NDArray

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


class PlaneQp(NamedTuple):
    """Chains side by side with J joints and R planes (a named tuple, so that kernels can take it).

    Attributes:
        first: chain i has the joints `first[i]` to `first[i + 1] - 1`, shape (C + 1,).
        diagonal: blocks of each axis' H, shape (J, 4, 4).
        link: block of H between joint j (rows) and j + 1 (columns), shape (J, 4, 4); not read across chains.
        rows: control points of each joint, shape (J, 7, 4).
        first_plane: joint j has the planes `first_plane[j]` to `first_plane[j + 1] - 1`, shape (J + 1,).
        point: which of the joint's control points a plane bounds, shape (R,).
        normal: of the planes, shape (R, 3).
        high: shape (R,).
        gradient: c, shape (J, 4, 3).
        spread: no two feasible points differ by more, shape (J, 4, 3).
        outset: cost at x = 0 of each chain, shape (C,).
        floor: cost below which differences do not count, positive, shape (C,).
        start: strictly within the planes, shape (J, 4, 3).
    """

    first: NDArray[np.int64]
    diagonal: NDArray[np.float64]
    link: NDArray[np.float64]
    rows: NDArray[np.float64]
    first_plane: NDArray[np.int64]
    point: NDArray[np.int64]
    normal: NDArray[np.float64]
    high: NDArray[np.float64]
    gradient: NDArray[np.float64]
    spread: NDArray[np.float64]
    outset: NDArray[np.float64]
    floor: NDArray[np.float64]
    start: NDArray[np.float64]


class _Work(NamedTuple):
    """Space for the iterations of all chains.

    Attributes:
        slope: of the cost, shape (J, 4, 3).
        step: shape (J, 4, 3).
        near: inverse distances to the planes, shape (R,).
        moved: a step's way to the planes as a share of the distance, shape (R,).
        turn: a step of the multipliers, shape (R,).
        weight: of the planes in the Newton step, shape (R,).
        factors: Cholesky factors of the joints' blocks with inverse diagonals, shape (J, 12, 12).
        gains: transposed inverse factors times the links, shape (J, 12, 12).
    """

    slope: NDArray[np.float64]
    step: NDArray[np.float64]
    near: NDArray[np.float64]
    moved: NDArray[np.float64]
    turn: NDArray[np.float64]
    weight: NDArray[np.float64]
    factors: NDArray[np.float64]
    gains: NDArray[np.float64]


@compiled_ieee
def plane_values(problem: PlaneQp, begin: int, end: int, x: Floats, values: Floats) -> None:
    """Write `normal . (row x)` of a chain's planes into `values`, (R,), for unknowns (J, 4, 3)."""
    control = np.empty((7, 3))
    for j in range(begin, end):
        for k in range(7):
            for d in range(3):
                value = 0.0
                for o in range(4):
                    value += problem.rows[j, k, o] * x[j, o, d]
                control[k, d] = value
        for r in range(problem.first_plane[j], problem.first_plane[j + 1]):
            k = problem.point[r]
            value = 0.0
            for d in range(3):
                value += problem.normal[r, d] * control[k, d]
            values[r] = value


@compiled_ieee
def add_planes(problem: PlaneQp, begin: int, end: int, weight: Floats, total: Floats) -> None:
    """Add the coefficients of a chain's planes, times their weights (R,), to sums of the joints' states (J, 4, 3)."""
    for j in range(begin, end):
        pull = np.zeros((7, 3))
        for r in range(problem.first_plane[j], problem.first_plane[j + 1]):
            k = problem.point[r]
            for d in range(3):
                pull[k, d] += weight[r] * problem.normal[r, d]
        for o in range(4):
            for d in range(3):
                value = 0.0
                for k in range(7):
                    value += problem.rows[j, k, o] * pull[k, d]
                total[j, o, d] += value


@compiled_ieee
def cost_slope(problem: PlaneQp, begin: int, end: int, x: Floats, slope: Floats) -> float:
    """Write `H x + c` of a chain's joints into `slope`, (J, 4, 3); the cost above that of x = 0 is returned."""
    diagonal, link = problem.diagonal, problem.link
    cost = 0.0
    for j in range(begin, end):
        for o in range(4):
            for d in range(3):
                value = 0.0
                for k in range(4):
                    value += diagonal[j, o, k] * x[j, k, d]
                    if j > begin:
                        value += link[j - 1, k, o] * x[j - 1, k, d]
                    if j < end - 1:
                        value += link[j, o, k] * x[j + 1, k, d]
                slope[j, o, d] = value + problem.gradient[j, o, d]
                cost += x[j, o, d] * (0.5 * value + problem.gradient[j, o, d])
    return cost


@compiled_ieee
def _joint_block(problem: PlaneQp, j: int, weight: Floats, block: Floats) -> None:
    """Write H's diagonal block of a joint plus its weighted planes into the lower half of `block`, (12, 12).

    The planes of one control point add up to 3 x 3 before its row spreads them over the states.
    """
    own = np.zeros((7, 3, 3))
    for r in range(problem.first_plane[j], problem.first_plane[j + 1]):
        k = problem.point[r]
        for d in range(3):
            share = weight[r] * problem.normal[r, d]
            for e in range(d + 1):
                own[k, d, e] += share * problem.normal[r, e]
    for o in range(4):
        for p in range(o + 1):
            for d in range(3):
                for e in range(3):
                    value = problem.diagonal[j, o, p] if d == e else 0.0
                    for k in range(7):
                        value += problem.rows[j, k, o] * problem.rows[j, k, p] * own[k, max(d, e), min(d, e)]
                    block[3 * o + d, 3 * p + e] = value


@compiled_ieee
def _eliminate(problem: PlaneQp, begin: int, end: int, work: _Work) -> bool:
    """Factorise `H + planes' weight planes` of a chain; False where that is not positive definite in this precision."""
    factors, gains = work.factors, work.gains
    for j in range(begin, end):
        block = factors[j]
        _joint_block(problem, j, work.weight, block)
        if j > begin:
            gain = gains[j - 1]
            for a in range(12):
                for b in range(a + 1):
                    value = 0.0
                    for c in range(12):
                        value += gain[a, c] * gain[b, c]
                    block[a, b] -= value
        for a in range(12):
            for b in range(a):
                value = block[a, b]
                for c in range(b):
                    value -= block[a, c] * block[b, c]
                block[a, b] = value * block[b, b]
            value = block[a, a]
            for c in range(a):
                value -= block[a, c] * block[a, c]
            if not value > 0.0:
                return False
            block[a, a] = 1.0 / math.sqrt(value)
        if j == end - 1:
            break
        gain = gains[j]
        for o in range(4):
            for d in range(3):
                row = gain[3 * o + d]
                for a in range(12):
                    value = problem.link[j, a // 3, o] if a % 3 == d else 0.0
                    for c in range(a):
                        value -= block[a, c] * row[c]
                    row[a] = value * block[a, a]
    return True


@compiled_ieee
def _substitute(begin: int, end: int, work: _Work) -> None:
    """Solve for the step with what `_eliminate` gave, in place."""
    factors, gains = work.factors, work.gains
    step = work.step.reshape(len(factors), 12)
    for j in range(begin, end):
        own, block = step[j], factors[j]
        if j > begin:
            before, gain = step[j - 1], gains[j - 1]
            for a in range(12):
                for c in range(12):
                    own[a] -= gain[a, c] * before[c]
        for a in range(12):
            for c in range(a):
                own[a] -= block[a, c] * own[c]
            own[a] *= block[a, a]
    for j in range(end - 1, begin - 1, -1):
        own, block = step[j], factors[j]
        if j < end - 1:
            after, gain = step[j + 1], gains[j]
            for a in range(12):
                for c in range(12):
                    own[c] -= gain[a, c] * after[a]
        for a in range(11, -1, -1):
            for c in range(a + 1, 12):
                own[a] -= block[c, a] * own[c]
            own[a] *= block[a, a]


@compiled_ieee
def _solve_chain(problem: PlaneQp, i: int, tolerance: float, most: int, x: Floats, push: Floats, work: _Work) -> int:
    """One chain; iterations taken or what went wrong, see `solve_plane_chains`."""
    begin, end = problem.first[i], problem.first[i + 1]
    planes = range(problem.first_plane[begin], problem.first_plane[end])
    slope, step, near, moved, turn_push, weight = work[:6]
    plane_values(problem, begin, end, x, moved)
    for r in planes:
        if not moved[r] < problem.high[r]:
            return -2
        near[r] = 1.0 / (problem.high[r] - moved[r])
    count = float(len(planes))
    cost_slope(problem, begin, end, x, slope)
    fall = 0.0
    for j in range(begin, end):
        for o in range(4):
            for d in range(3):
                fall += abs(slope[j, o, d]) * problem.spread[j, o, d]
    barrier = FIRST_BARRIER * (fall + problem.floor[i]) / count
    for r in planes:
        push[r] = barrier * near[r]

    for turn in range(most):
        cost = problem.outset[i] + cost_slope(problem, begin, end, x, slope)
        gap = residual = 0.0
        for j in range(begin, end):
            for o in range(4):
                for d in range(3):
                    step[j, o, d] = slope[j, o, d]
        add_planes(problem, begin, end, push, step)
        for r in planes:
            gap += push[r] / near[r]
            weight[r] = push[r] * near[r]
        for j in range(begin, end):
            for o in range(4):
                for d in range(3):
                    residual += abs(step[j, o, d]) * problem.spread[j, o, d]
                    step[j, o, d] = -slope[j, o, d]
        allowed = tolerance * (max(cost, 0.0) + problem.floor[i])
        if gap <= allowed and (residual <= RESIDUAL_SHARE * allowed or gap <= SETTLED * allowed):
            return turn
        if not _eliminate(problem, begin, end, work):
            return -3 if turn == 0 else -1

        _substitute(begin, end, work)
        worst = 1.0
        plane_values(problem, begin, end, step, moved)
        for r in planes:
            moved[r] *= near[r]
            worst = max(worst, moved[r], 1.0 - moved[r])
        share = 1.0 / worst
        # In the predictor's direction the products fall to `(1 - share) gap`, and second-order terms come on top.
        left = (1.0 - share) * gap
        for r in planes:
            turn_push[r] = moved[r] * (moved[r] - 1.0) * push[r]
            left -= share * share * turn_push[r] / near[r]
        barrier = (left / gap) ** 3 * gap / count

        for j in range(begin, end):
            for o in range(4):
                for d in range(3):
                    step[j, o, d] = -slope[j, o, d]
        for r in planes:
            turn_push[r] += barrier * near[r]
            weight[r] = -turn_push[r]
        add_planes(problem, begin, end, weight, step)
        _substitute(begin, end, work)
        worst = TO_THE_BORDER
        plane_values(problem, begin, end, step, moved)
        for r in planes:
            moved[r] *= near[r]
            turn_push[r] -= push[r] * (1.0 - moved[r])
            worst = max(worst, moved[r], -turn_push[r] / push[r])
        share = TO_THE_BORDER / worst
        if not share > 0:
            return -1
        for j in range(begin, end):
            for o in range(4):
                for d in range(3):
                    x[j, o, d] += share * step[j, o, d]
        for r in planes:
            push[r] += share * turn_push[r]
            near[r] /= 1.0 - share * moved[r]
    return -1


@compiled_ieee
def solve_plane_chains(problem: PlaneQp, tolerance: float, most: int) -> tuple[Floats, Floats, Ints]:
    """Solve chains one after the other.

    Args:
        problem: the chains.
        tolerance: of a chain's cost, relative to that cost plus the floor.
        most: iterations a chain.

    Returns:
        The minimiser (J, 4, 3), the multipliers (R,), and the iterations that were taken (C,), -1 where it did not
        settle, -2 where the start is not inside, -3 where H is not positive definite.
    """
    joints = len(problem.diagonal)
    x, push = problem.start.copy(), np.zeros(len(problem.high))
    count = len(problem.high)
    work = _Work(
        slope=np.empty((joints, 4, 3)),
        step=np.empty((joints, 4, 3)),
        near=np.empty(count),
        moved=np.empty(count),
        turn=np.empty(count),
        weight=np.empty(count),
        factors=np.empty((joints, 12, 12)),
        gains=np.empty((joints, 12, 12)),
    )
    turns = np.zeros(len(problem.floor), dtype=np.int64)
    for i in range(len(turns)):
        if problem.first[i] < problem.first[i + 1]:
            turns[i] = _solve_chain(problem, i, tolerance, most, x, push, work)
    return x, push, turns
