"""Kernels of the spline of least squared derivative: one block-tridiagonal elimination, linear in the segments.

Written for any order m of the minimised derivative (2 acceleration, 3 jerk, 4 snap). The unknowns at a joint are its
derivatives 1 .. m - 1, so each block is (m - 1) x (m - 1). Cholesky's rounding errors do not depend on how unknowns are
scaled, so the derivatives need no scaling of their own, however uneven the segment times are.

The marks of fixed end derivatives come as tuples of length m - 1: their length is known when a kernel is compiled,
which lets the loops over a block be unrolled.
"""

from __future__ import annotations

import numpy as np

from gcs.planning.numerics.compiled import compiled

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@compiled
def factorise(block: Floats, marks: tuple[bool, ...]) -> None:
    """Cholesky factorisation `L D L^T` of a block in place: multipliers under the diagonal, 1 / D on it.

    Args:
        block: symmetric and positive definite, shape (m - 1, m - 1); only its lower half is read.
        marks: their count is m - 1.
    """
    for a in range(len(marks)):
        for b in range(a):
            for c in range(b):
                block[a, b] -= block[a, c] * block[b, c]
        for b in range(a):
            product = block[a, b]
            block[a, b] = product * block[b, b]
            block[a, a] -= product * block[a, b]
        block[a, a] = 1.0 / block[a, a]


@compiled
def solve_factored(block: Floats, right: Floats, marks: tuple[bool, ...]) -> None:
    """Solve with a block from `factorise`, in place.

    Args:
        block: shape (m - 1, m - 1).
        right: right-hand sides, shape (m - 1, anything); becomes the solution.
        marks: their count is m - 1.
    """
    size = len(marks)
    for d in range(right.shape[1]):
        for a in range(1, size):
            for c in range(a):
                right[a, d] -= block[a, c] * right[c, d]
        for a in range(size):
            right[a, d] *= block[a, a]
        for a in range(size - 2, -1, -1):
            for c in range(a + 1, size):
                right[a, d] -= block[c, a] * right[c, d]


@compiled
def _fix(block: Floats, coupling: Floats, right: Floats, marks: tuple[bool, ...], values: Floats) -> None:
    """Take the given derivatives of an end out of its equations."""
    for a in range(len(marks)):
        if marks[a]:
            for b in range(len(marks)):
                for d in range(right.shape[1]):
                    right[b, d] -= block[b, a] * values[a, d]
    for a in range(len(marks)):
        if marks[a]:
            for b in range(len(marks)):
                block[a, b] = 0.0
                block[b, a] = 0.0
                coupling[a, b] = 0.0
            block[a, a] = 1.0
            right[a] = values[a]


@compiled
def least_derivative_coefficients(
    unit_cost: Floats,
    upper_coefficients: Floats,
    points: Floats,
    times: Floats,
    start_marks: tuple[bool, ...],
    start: Floats,
    end_marks: tuple[bool, ...],
    end: Floats,
) -> Floats:
    """Coefficients of the curve through all points whose m-th derivative has the least squared integral.

    Args:
        unit_cost: the integral over a segment of unit time as a quadratic form of its states at the start and the end
            (position, first derivative, ...), shape (2 m, 2 m).
        upper_coefficients: coefficients m .. 2 m - 1 of such a segment from the same states, shape (m, 2 m).
        points: shape (S + 1, D).
        times: of the segments, shape (S,).
        start_marks: which derivatives 1 .. m - 1 are given at the start; the others are free.
        start: the given values, shape (m - 1, D).
        end_marks: the same at the end.
        end: shape (m - 1, D).

    Returns:
        Coefficients on the normalised time of each segment, lowest power first, shape (S, 2 m, D).
    """
    size = len(start_marks)
    order = size + 1
    segments, axes = len(times), points.shape[1]
    coefficients = np.empty((segments, 2 * order, axes))
    states = np.empty((segments + 1, size, axes))
    gains = np.empty((segments, size, size))
    block, right = np.empty((size, size)), np.empty((size, axes))
    coupling, gain = np.empty((size, size)), np.empty((size, size))
    # What the segments before a joint add to its equations, once all joints before it are eliminated.
    carried, carried_right = np.zeros((size, size)), np.zeros((size, axes))
    power = np.empty(2 * order)

    for joint in range(segments + 1):
        block[:] = carried
        right[:] = carried_right
        if joint < segments:
            time = times[joint]
            power[0] = time
            for _ in range(2 * order - 2):
                power[0] *= time
            power[0] = 1.0 / power[0]
            for k in range(1, 2 * order):
                power[k] = power[k - 1] * time
            for a in range(size):
                for b in range(size):
                    weight = power[a + b + 2]
                    block[a, b] += unit_cost[a + 1, b + 1] * weight
                    coupling[a, b] = unit_cost[a + 1, order + b + 1] * weight
                    gain[a, b] = coupling[a, b]
                    carried[a, b] = unit_cost[order + a + 1, order + b + 1] * weight
                # Only the difference of the positions matters: a segment may be anywhere.
                for d in range(axes):
                    move = (points[joint + 1, d] - points[joint, d]) * power[a + 1]
                    right[a, d] -= unit_cost[a + 1, order] * move
                    carried_right[a, d] = -unit_cost[order + a + 1, order] * move
        if joint == 0:
            _fix(block, gain, right, start_marks, start)
        elif joint == segments:
            _fix(block, gain, right, end_marks, end)
        factorise(block, start_marks)
        solve_factored(block, right, start_marks)
        states[joint] = right
        if joint < segments:
            solve_factored(block, gain, start_marks)
            gains[joint] = gain
            for a in range(size):
                for b in range(size):
                    for c in range(size):
                        carried[a, b] -= coupling[c, a] * gain[c, b]
                for d in range(axes):
                    for c in range(size):
                        carried_right[a, d] -= coupling[c, a] * right[c, d]

    for joint in range(segments - 1, -1, -1):
        time = times[joint]
        for d in range(axes):
            move = points[joint + 1, d] - points[joint, d]
            for a in range(size):
                for c in range(size):
                    states[joint, a, d] -= gains[joint, a, c] * states[joint + 1, c, d]
            for j in range(order):
                coefficients[joint, order + j, d] = upper_coefficients[j, order] * move
            coefficients[joint, 0, d] = points[joint, d]
            scale, factorial = 1.0, 1.0
            for a in range(size):
                scale *= time
                factorial *= a + 1
                begin, finish = states[joint, a, d] * scale, states[joint + 1, a, d] * scale
                coefficients[joint, a + 1, d] = begin / factorial
                for j in range(order):
                    coefficients[joint, order + j, d] += (
                        upper_coefficients[j, a + 1] * begin + upper_coefficients[j, order + a + 1] * finish
                    )
    return coefficients
