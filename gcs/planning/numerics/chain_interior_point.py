"""Kernels of a primal-dual interior-point method for quadratic programs that hang together like chains (Mehrotra 1992).

    minimise 1/2 x' H x + c' x   subject to   low <= rows_j x_j <= high  at every joint j

A joint has four unknowns and seven rows of its own; H couples it with its two neighbours only. So the rows add to the
diagonal blocks alone, and a Newton step is one block-tridiagonal elimination: time is linear in the number of joints.
The start is strictly inside all rows, and every step keeps it so: whatever comes out keeps the rows. The predictor's
step says how much of the barrier the corrector drops.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled_ieee

if TYPE_CHECKING:
    from numpy.typing import NDArray

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Four = tuple[float, float, float, float]
Ten = tuple[float, float, float, float, float, float, float, float, float, float]

TO_THE_BORDER = 0.99
"""Share of the way to the nearest bound that a step goes."""

FIRST_BARRIER = 1e-3
"""Barrier at the start, as a share of what the cost could fall by in its linear part."""

RESIDUAL_SHARE = 10.0
"""The residual's bound on the cost may be this many times the gap's: it is far from sharp, and rounding is in it."""

OTHER_AXES = 0.01
"""Share of the cost of the axes solved before that counts as nothing on the axes after."""

SETTLED = 1e-4
"""A gap this small a share of what is asked for is not made smaller: what is left of the residual is rounding."""


class ChainQp(NamedTuple):
    """Chains side by side; J joints with four unknowns and seven rows each, A axes (a named tuple for the kernels).

    Attributes:
        first: chain i has the joints `first[i]` to `first[i + 1] - 1`, shape (C + 1,).
        diagonal: blocks of H, shape (J, 4, 4).
        link: block of H between joint j (rows) and j + 1 (columns), shape (J, 4, 4); not read across chains.
        rows: shape (J, 7, 4).
        gradient: c, shape (A, J, 4).
        low: shape (A, J, 7).
        high: shape (A, J, 7).
        spread: no two feasible points differ by more, shape (A, J, 4).
        outset: cost at x = 0 of each chain, shape (A, C).
        floor: cost below which differences do not count, positive, shape (C,).
        start: strictly inside the rows, shape (A, J, 4).
    """

    first: NDArray[np.int64]
    diagonal: NDArray[np.float64]
    link: NDArray[np.float64]
    rows: NDArray[np.float64]
    gradient: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    spread: NDArray[np.float64]
    outset: NDArray[np.float64]
    floor: NDArray[np.float64]
    start: NDArray[np.float64]


class Blocks(NamedTuple):
    """What the axes of one chain share: `diagonal`, `link` and `rows` of its joints, see `ChainQp`."""

    diagonal: NDArray[np.float64]
    link: NDArray[np.float64]
    rows: NDArray[np.float64]


class _Axis(NamedTuple):
    """What one axis of one chain has of its own: `gradient`, `low`, `high` and `spread`, see `ChainQp`."""

    gradient: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    spread: NDArray[np.float64]


class _Barrier(NamedTuple):
    """Multipliers of the rows' two bounds and the inverse distances to them, shape (J, 7) each."""

    push_low: NDArray[np.float64]
    push_high: NDArray[np.float64]
    near_low: NDArray[np.float64]
    near_high: NDArray[np.float64]


class _Factors(NamedTuple):
    """What an elimination gives: factors of the diagonal blocks, (J, 10), and gains to the next joint, (J, 4, 4)."""

    own: NDArray[np.float64]
    gains: NDArray[np.float64]


@compiled_ieee
def _factor(block: Ten) -> Ten:
    """`L D L'` of a symmetric 4 x 4 block.

    Args:
        block: its lower half by rows.

    Returns:
        The same places with the multipliers, and 1 / D on the diagonal.
    """
    m00, m10, m11, m20, m21, m22, m30, m31, m32, m33 = block
    d0 = 1.0 / m00
    l10, l20, l30 = m10 * d0, m20 * d0, m30 * d0
    d1 = 1.0 / (m11 - l10 * m10)
    m21 -= l10 * m20
    m31 -= l10 * m30
    l21, l31 = m21 * d1, m31 * d1
    d2 = 1.0 / (m22 - l20 * m20 - l21 * m21)
    m32 -= l20 * m30 + l21 * m31
    l32 = m32 * d2
    d3 = 1.0 / (m33 - l30 * m30 - l31 * m31 - l32 * m32)
    return d0, l10, d1, l20, l21, d2, l30, l31, l32, d3


@compiled_ieee
def _solve(factors: Floats, b0: float, b1: float, b2: float, b3: float) -> Four:
    """Solve with what `_factor` gave."""
    l10, l20, l21 = factors[1], factors[3], factors[4]
    l30, l31, l32 = factors[6], factors[7], factors[8]
    b1 -= l10 * b0
    b2 -= l20 * b0 + l21 * b1
    b3 -= l30 * b0 + l31 * b1 + l32 * b2
    b3 *= factors[9]
    b2 = b2 * factors[5] - l32 * b3
    b1 = b1 * factors[2] - l21 * b2 - l31 * b3
    b0 = b0 * factors[0] - l10 * b1 - l20 * b2 - l30 * b3
    return b0, b1, b2, b3


@compiled_ieee
def _times(matrix: Floats, x: Floats, c: int) -> float:
    """Row c of a matrix times a vector of four."""
    return float(matrix[c, 0] * x[0] + matrix[c, 1] * x[1] + matrix[c, 2] * x[2] + matrix[c, 3] * x[3])


@compiled_ieee
def _transposed_times(matrix: Floats, x: Floats, c: int) -> float:
    """Column c of a matrix times a vector of four."""
    return float(matrix[0, c] * x[0] + matrix[1, c] * x[1] + matrix[2, c] * x[2] + matrix[3, c] * x[3])


@compiled_ieee
def _cost_slope(blocks: Blocks, gradient: Floats, x: Floats, slope: Floats) -> float:
    """Write `H x + c` into `slope`; the cost above that of x = 0 is returned."""
    diagonal, link = blocks.diagonal, blocks.link
    joints = len(x)
    cost = 0.0
    for j in range(joints):
        for c in range(4):
            value = _times(diagonal[j], x[j], c)
            if j > 0:
                value += _transposed_times(link[j - 1], x[j - 1], c)
            if j < joints - 1:
                value += _times(link[j], x[j + 1], c)
            slope[j, c] = value + gradient[j, c]
            cost += x[j, c] * (0.5 * value + gradient[j, c])
    return cost


@compiled_ieee
def _eliminate(blocks: Blocks, barrier: _Barrier, result: _Factors) -> bool:
    """Factorise `H + rows' D rows`; False where it is not positive definite in this precision."""
    diagonal, link, rows = blocks
    push_low, push_high, near_low, near_high = barrier
    factors, gains = result
    joints = len(diagonal)
    k00 = k10 = k11 = k20 = k21 = k22 = k30 = k31 = k32 = k33 = 0.0
    for j in range(joints):
        own = diagonal[j]
        m00, m10, m11 = own[0, 0] - k00, own[1, 0] - k10, own[1, 1] - k11
        m20, m21, m22 = own[2, 0] - k20, own[2, 1] - k21, own[2, 2] - k22
        m30, m31, m32, m33 = own[3, 0] - k30, own[3, 1] - k31, own[3, 2] - k32, own[3, 3] - k33
        for k in range(7):
            weight = push_low[j, k] * near_low[j, k] + push_high[j, k] * near_high[j, k]
            g0, g1, g2, g3 = rows[j, k, 0], rows[j, k, 1], rows[j, k, 2], rows[j, k, 3]
            w0, w1, w2, w3 = weight * g0, weight * g1, weight * g2, weight * g3
            m00 += w0 * g0
            m10 += w1 * g0
            m11 += w1 * g1
            m20 += w2 * g0
            m21 += w2 * g1
            m22 += w2 * g2
            m30 += w3 * g0
            m31 += w3 * g1
            m32 += w3 * g2
            m33 += w3 * g3
        found = _factor((m00, m10, m11, m20, m21, m22, m30, m31, m32, m33))
        for c in range(10):
            factors[j, c] = found[c]
        if not min(found[0], found[2], found[5], found[9]) > 0:
            return False
        if j == joints - 1:
            break
        across, gain = link[j], gains[j]
        for c in range(4):
            gain[0, c], gain[1, c], gain[2, c], gain[3, c] = _solve(
                factors[j], across[0, c], across[1, c], across[2, c], across[3, c]
            )
        k00 = _carried(across, gain, 0, 0)
        k10, k11 = _carried(across, gain, 1, 0), _carried(across, gain, 1, 1)
        k20, k21, k22 = _carried(across, gain, 2, 0), _carried(across, gain, 2, 1), _carried(across, gain, 2, 2)
        k30, k31 = _carried(across, gain, 3, 0), _carried(across, gain, 3, 1)
        k32, k33 = _carried(across, gain, 3, 2), _carried(across, gain, 3, 3)
    return True


@compiled_ieee
def _carried(across: Floats, gain: Floats, c: int, d: int) -> float:
    """What eliminating a joint takes from the next one's block."""
    return float(
        across[0, c] * gain[0, d] + across[1, c] * gain[1, d] + across[2, c] * gain[2, d] + across[3, c] * gain[3, d]
    )


@compiled_ieee
def _substitute(link: Floats, result: _Factors, step: Floats) -> None:
    """Solve with what `_eliminate` gave, in place."""
    factors, gains = result
    joints = len(step)
    for j in range(joints):
        b0, b1, b2, b3 = step[j, 0], step[j, 1], step[j, 2], step[j, 3]
        if j > 0:
            across, before = link[j - 1], step[j - 1]
            b0 -= _transposed_times(across, before, 0)
            b1 -= _transposed_times(across, before, 1)
            b2 -= _transposed_times(across, before, 2)
            b3 -= _transposed_times(across, before, 3)
        step[j, 0], step[j, 1], step[j, 2], step[j, 3] = _solve(factors[j], b0, b1, b2, b3)
    for j in range(joints - 2, -1, -1):
        for c in range(4):
            step[j, c] -= _times(gains[j], step[j + 1], c)


@compiled_ieee
def inverse_energy(blocks: Blocks, residual: Floats) -> float:
    """`r' H^-1 r` of one chain for a residual r (J, 4), infinite where H is not positive definite in this precision."""
    joints = len(residual)
    none = np.zeros((joints, 7))
    factors = _Factors(np.empty((joints, 10)), np.empty((joints, 4, 4)))
    if not _eliminate(blocks, _Barrier(none, none, none, none), factors):
        return np.inf
    step = residual.copy()
    _substitute(blocks.link, factors, step)
    return float(abs((step * residual).sum()))


@compiled_ieee
def _solve_chain(
    blocks: Blocks,
    axis: _Axis,
    outset: float,
    floor: float,
    tolerance: float,
    most: int,
    x: Floats,
    push_low: Floats,
    push_high: Floats,
    work: Floats,
) -> tuple[int, float]:
    """One axis of one chain: iterations taken or what went wrong, and the cost; see `solve_chains`."""
    rows = blocks.rows
    gradient, low, high, spread = axis
    joints = len(x)
    slope, step = work[:joints, :4], work[:joints, 4:8]
    near_low, near_high, moved = work[:joints, 18:25], work[:joints, 25:32], work[:joints, 32:39]
    turn_low, turn_high = work[:joints, 39:46], work[:joints, 46:53]
    barrier_terms = _Barrier(push_low, push_high, near_low, near_high)
    factors = _Factors(work[:joints, 8:18], np.empty((joints, 4, 4)))
    count = 14.0 * joints
    for j in range(joints):
        for k in range(7):
            value = _times(rows[j], x[j], k)
            if not (low[j, k] < value < high[j, k]):
                return -2, outset
            near_low[j, k], near_high[j, k] = 1.0 / (value - low[j, k]), 1.0 / (high[j, k] - value)
    _cost_slope(blocks, gradient, x, slope)
    fall = 0.0
    for j in range(joints):
        for c in range(4):
            fall += abs(slope[j, c]) * spread[j, c]
    barrier = FIRST_BARRIER * (fall + floor) / count
    for j in range(joints):
        for k in range(7):
            push_low[j, k], push_high[j, k] = barrier * near_low[j, k], barrier * near_high[j, k]

    cost = outset
    for turn in range(most):
        cost = outset + _cost_slope(blocks, gradient, x, slope)
        gap = residual = 0.0
        for j in range(joints):
            for c in range(4):
                value = slope[j, c]
                for k in range(7):
                    value -= rows[j, k, c] * (push_low[j, k] - push_high[j, k])
                residual += abs(value) * spread[j, c]
                step[j, c] = -slope[j, c]
            for k in range(7):
                gap += push_low[j, k] / near_low[j, k] + push_high[j, k] / near_high[j, k]
        allowed = tolerance * (max(cost, 0.0) + floor)
        if gap <= allowed and (residual <= RESIDUAL_SHARE * allowed or gap <= SETTLED * allowed):
            return turn, cost
        if not _eliminate(blocks, barrier_terms, factors):
            return -3 if turn == 0 else -1, cost

        _substitute(blocks.link, factors, step)
        worst = 1.0
        for j in range(joints):
            for k in range(7):
                move = _times(rows[j], step[j], k)
                moved[j, k] = move
                to_low, to_high = move * near_low[j, k], move * near_high[j, k]
                worst = max(worst, -to_low, to_high, 1.0 + to_low, 1.0 - to_high)
        share = 1.0 / worst
        # In the predictor's direction the products fall to `(1 - share) gap`, and second-order terms come on top.
        left = (1.0 - share) * gap
        for j in range(joints):
            for k in range(7):
                to_low, to_high = moved[j, k] * near_low[j, k], moved[j, k] * near_high[j, k]
                turn_low[j, k] = to_low * (1.0 + to_low) * push_low[j, k]
                turn_high[j, k] = to_high * (to_high - 1.0) * push_high[j, k]
                left -= share * share * (turn_low[j, k] / near_low[j, k] + turn_high[j, k] / near_high[j, k])
        barrier = (left / gap) ** 3 * gap / count

        for j in range(joints):
            for c in range(4):
                step[j, c] = -slope[j, c]
            for k in range(7):
                turn_low[j, k] += barrier * near_low[j, k]
                turn_high[j, k] += barrier * near_high[j, k]
                push = turn_low[j, k] - turn_high[j, k]
                for c in range(4):
                    step[j, c] += rows[j, k, c] * push
        _substitute(blocks.link, factors, step)
        worst = TO_THE_BORDER
        for j in range(joints):
            for k in range(7):
                move = _times(rows[j], step[j], k)
                moved[j, k] = move
                to_low, to_high = move * near_low[j, k], move * near_high[j, k]
                turn_low[j, k] -= push_low[j, k] * (1.0 + to_low)
                turn_high[j, k] -= push_high[j, k] * (1.0 - to_high)
                worst = max(
                    worst, -to_low, to_high, -turn_low[j, k] / push_low[j, k], -turn_high[j, k] / push_high[j, k]
                )
        share = TO_THE_BORDER / worst
        if not share > 0:
            return -1, cost
        for j in range(joints):
            for c in range(4):
                x[j, c] += share * step[j, c]
            for k in range(7):
                push_low[j, k] += share * turn_low[j, k]
                push_high[j, k] += share * turn_high[j, k]
                near_low[j, k] /= 1.0 + share * moved[j, k] * near_low[j, k]
                near_high[j, k] /= 1.0 - share * moved[j, k] * near_high[j, k]
    return -1, cost


@compiled_ieee
def solve_chains(problem: ChainQp, tolerance: float, most: int) -> tuple[Floats, Floats, Ints]:
    """Solve chains one after the other, and their axes, which share H and the rows, from the costliest outset on.

    Args:
        problem: the chains.
        tolerance: of an axis' cost, relative to that cost plus the floor plus a share of the other axes' costs.
        most: iterations an axis.

    Returns:
        The minimiser (A, J, 4), the multipliers (A, J, 7), positive where the upper bound pushes, and the iterations
        that were taken (A, C), -1 where it did not settle, -2 where the start is not inside, -3 where H is not positive
        definite.
    """
    axes, joints = problem.gradient.shape[0], problem.gradient.shape[1]
    first, floor = problem.first, problem.floor
    x = problem.start.copy()
    push_low, push_high = np.zeros((axes, joints, 7)), np.zeros((axes, joints, 7))
    turns = np.zeros((axes, len(floor)), dtype=np.int64)
    longest = 0
    for i in range(len(floor)):
        longest = max(longest, first[i + 1] - first[i])
    work = np.empty((longest, 53))
    for i in range(len(floor)):
        a, b = first[i], first[i + 1]
        if a == b:
            continue
        blocks = Blocks(problem.diagonal[a:b], problem.link[a:b], problem.rows[a:b])
        nothing = floor[i]
        for k in np.argsort(-problem.outset[:, i]):
            axis = _Axis(problem.gradient[k, a:b], problem.low[k, a:b], problem.high[k, a:b], problem.spread[k, a:b])
            turns[k, i], cost = _solve_chain(
                blocks,
                axis,
                problem.outset[k, i],
                nothing,
                tolerance,
                most,
                x[k, a:b],
                push_low[k, a:b],
                push_high[k, a:b],
                work,
            )
            nothing += OTHER_AXES * max(cost, 0.0)
    return x, push_high - push_low, turns
