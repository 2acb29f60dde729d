"""The curve of least squared derivative in extended precision, from other equations than the planner's.

The least curve is the spline of degree 2 m - 1 with 2 m - 2 continuous derivatives through the points; where derivative
k is free at an end, derivative 2 m - 1 - k vanishes there (the natural end conditions). The planner eliminates the
derivatives at the joints from the cost; here the conditions on the pieces' coefficients are solved in decimals of 60
digits, so the two share nothing but the answer.
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from math import perm
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

DIGITS = 60

Row = dict[int, Decimal]


def exact_spline(
    points: Sequence[Decimal | float],
    durations_s: Sequence[Decimal | float],
    order: int,
    start: Sequence[Decimal | float | None],
    end: Sequence[Decimal | float | None],
) -> tuple[list[list[Decimal]], Decimal]:
    """One axis of the curve.

    Args:
        points: one coordinate of the points, S + 1 of them.
        durations_s: of the segments, S of them.
        order: m: 2 acceleration, 3 jerk, 4 snap.
        start: derivatives 1 .. m - 1 at the start, None where free.
        end: the same at the end.

    Returns:
        Coefficients of each segment on its normalised time, lowest power first; and the integral of the squared m-th
        derivative.
    """
    with localcontext() as context:
        context.prec = DIGITS
        times = [Decimal(time) for time in durations_s]
        rows = _conditions([Decimal(point) for point in points], times, order, start, end)
        solution = _solve_banded(rows, 4 * order)
        pieces = [solution[2 * order * s : 2 * order * (s + 1)] for s in range(len(times))]
        cost = Decimal(0)
        for piece, time in zip(pieces, times, strict=True):
            upper = [perm(k, order) * piece[k] for k in range(order, 2 * order)]
            square = sum((a * b / (i + j + 1) for i, a in enumerate(upper) for j, b in enumerate(upper)), Decimal(0))
            cost += square / time ** (2 * order - 1)
        return pieces, cost


def _conditions(
    points: list[Decimal],
    times: list[Decimal],
    order: int,
    start: Sequence[Decimal | float | None],
    end: Sequence[Decimal | float | None],
) -> list[tuple[Row, Decimal]]:
    terms, last = 2 * order, len(times) - 1

    def derivative(segment: int, k: int, at_end: bool) -> Row:
        powers = range(k, terms) if at_end else (k,)
        return {terms * segment + power: perm(power, k) / times[segment] ** k for power in powers}

    def boundary(segment: int, at_end: bool, values: Sequence[Decimal | float | None]) -> list[tuple[Row, Decimal]]:
        return [
            (derivative(segment, terms - 1 - k, at_end), Decimal(0))
            if value is None
            else (derivative(segment, k, at_end), Decimal(value))
            for k, value in enumerate(values, start=1)
        ]

    rows = boundary(0, False, start)
    for segment in range(last + 1):
        rows.append((derivative(segment, 0, False), points[segment]))
        rows.append((derivative(segment, 0, True), points[segment + 1]))
        if segment < last:
            for k in range(1, terms - 1):
                jump = derivative(segment, k, True)
                jump.update({column: -value for column, value in derivative(segment + 1, k, False).items()})
                rows.append((jump, Decimal(0)))
    return rows + boundary(last, True, end)


def _share(row: Row, column: int) -> Decimal:
    """How large an entry is among its row's."""
    value = row.get(column)
    return abs(value) / max(map(abs, row.values())) if value else Decimal(0)


def _solve_banded(rows: list[tuple[Row, Decimal]], reach: int) -> list[Decimal]:
    """Elimination with scaled pivots; row i has its entries within `reach` columns of column i."""
    left, right = [row for row, _ in rows], [value for _, value in rows]
    size = len(rows)
    for column in range(size):
        below = range(column, min(size, column + reach))
        pivot = max(below, key=lambda i: _share(left[i], column))
        left[column], left[pivot] = left[pivot], left[column]
        right[column], right[pivot] = right[pivot], right[column]
        chosen = left[column]
        for i in below[1:]:
            factor = left[i].pop(column, None)
            if factor:
                factor /= chosen[column]
                for k, value in chosen.items():
                    if k > column:
                        left[i][k] = left[i].get(k, Decimal(0)) - factor * value
                right[i] -= factor * right[column]
    solution = [Decimal(0)] * size
    for column in range(size - 1, -1, -1):
        known = sum((value * solution[k] for k, value in left[column].items() if k > column), Decimal(0))
        solution[column] = (right[column] - known) / left[column][column]
    return solution
