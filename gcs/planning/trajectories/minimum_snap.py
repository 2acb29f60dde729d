"""Minimum-snap curves of degree 7 inside corridors, from rest to rest (Mellinger and Kumar 2011; Richter et al. 2016).

The unknowns are the states at the joints (position, velocity, acceleration, jerk), so the curve is C^3 by
construction. In each state the Bernstein control points of the pieces on both sides are linear: four of the left piece
depend on it, and four of the right piece. Keeping them in the boxes proves the corridor for the whole curve. The axes
do not touch each other, and legs between stops neither: every leg is a chain of joints of its own.

At rest in a place that two neighbouring boxes share, a joint keeps both; so a corridor has a curve if and only if its
neighbouring boxes meet, and what is infeasible is said with the segment's number before anything is solved.

Every leg is solved in its own mean segment time, about the curve that interpolates its joints, with the cost divided by
that curve's cost and the unknowns scaled to a unit diagonal. Without this the cost is a small difference of numbers
that grow with the seventh power of the segment count.
"""

from __future__ import annotations

from math import comb
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.linalg import solveh_banded

from gcs.core.errors import InfeasibleError, InputError
from gcs.planning.numerics.bernstein import CONTROL_FROM_END, CONTROL_FROM_START
from gcs.planning.numerics.chain_qp import ChainQp, ChainSolver
from gcs.planning.numerics.qp_solver import QpProblem, SolverError, solve_checked

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.planning.numerics.qp_solver import QpSolver
    from gcs.planning.trajectories.safe_corridor import LegCorridor

BOX_INSET_M = 1e-6
"""The solver gets boxes this much smaller, so that its rounding never leaves the true ones."""

NARROWEST_M = 1e-5
"""Boxes, and what neighbouring boxes share, must be wider than this on every axis."""

STOP_TOLERANCE_M = 1e-9
"""How far a stop may be outside its box: by rounding, no more."""

START_ROOM = 0.5
"""Share of the room to every bound, as at rest in the middle of it, that the solver's first curve keeps."""

COST_FLOOR_M = 1e-2
"""Axes on which a leg hardly moves have their cost divided by that of a move of this length."""


def _unit_cost() -> NDArray[np.float64]:
    """Integral of squared snap of a piece of unit duration, as a quadratic form of its end states, shape (8, 8)."""
    control = np.zeros((8, 8))
    control[:4, :4], control[4:, 4:] = CONTROL_FROM_START, CONTROL_FROM_END
    snap = 7 * 6 * 5 * 4 * np.diff(np.eye(8), 4, axis=0) @ control
    gram = np.array([[comb(3, i) * comb(3, j) / comb(6, i + j) / 7 for j in range(4)] for i in range(4)])
    return np.asarray(snap.T @ gram @ snap)


UNIT_COST = _unit_cost()


def rest_to_rest_cost(length_m: float | NDArray[np.float64], duration_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Least integral of squared snap (m^2/s^7) of a straight move from rest to rest: `100800 L^2 / T^7`."""
    return np.asarray(100800.0 * length_m**2 / duration_s**7)


def snap_cost(control: NDArray[np.float64], durations_s: NDArray[np.float64]) -> float:
    """Integral of squared snap (m^2/s^7) of pieces given by control points (S, 8, 3)."""
    snap = 840 * np.diff(control, 4, axis=1)
    gram = np.array([[comb(3, i) * comb(3, j) / comb(6, i + j) / 7 for j in range(4)] for i in range(4)])
    return float(np.einsum("sid,ij,sjd,s->", snap, gram, snap, durations_s**-7.0))


def check_corridor(leg: LegCorridor) -> None:
    """Refuse a corridor that no curve can be in.

    Raises:
        InputError: a number is not finite, or a segment has no length; it names the segment.
        InfeasibleError: a box is empty, or two neighbouring boxes or a stop and its box do not meet with more room than
            the solver's tolerance; it names the segment.
    """
    joints, boxes = leg.joints_m, leg.boxes_m
    finite = np.isfinite(joints[:-1]).all(1) & np.isfinite(joints[1:]).all(1) & np.isfinite(boxes).all((1, 2))
    if not finite.all():
        raise InputError(
            f"segment {int(finite.argmin())} of the corridor has a number that is not finite", field="corridor"
        )
    length = leg.lengths_m
    if not (length > 0).all():
        bad = int((length > 0).argmin())
        raise InputError(f"segment {bad} of the corridor has no length: its ends are one place", field="corridor")
    outside = np.maximum(boxes[[0, -1], 0] - joints[[0, -1]], joints[[0, -1]] - boxes[[0, -1], 1]).max(axis=1)
    for end, segment in enumerate((0, len(boxes) - 1)):
        if outside[end] > STOP_TOLERANCE_M:
            raise InfeasibleError(
                f"segment {segment} of the corridor does not hold its stop: it is {outside[end]:.3g} m outside the box"
            )
    room = (boxes[:, 1] - boxes[:, 0]).min(axis=1)
    if not (room > NARROWEST_M).all():
        bad = int((room > NARROWEST_M).argmin())
        raise InfeasibleError(
            f"segment {bad} of the corridor is {room[bad]:.3g} m wide, and {NARROWEST_M:g} m are needed: widen it"
        )
    shared = (np.minimum(boxes[1:, 1], boxes[:-1, 1]) - np.maximum(boxes[1:, 0], boxes[:-1, 0])).min(axis=1)
    if not (shared > NARROWEST_M).all():
        bad = int((shared > NARROWEST_M).argmin())
        what = "do not meet" if shared[bad] < 0 else f"share only {shared[bad]:.3g} m"
        raise InfeasibleError(
            f"segments {bad} and {bad + 1} of the corridor are not connected: their boxes {what}, and "
            f"{NARROWEST_M:g} m are needed"
        )


def check_corridors(legs: Sequence[LegCorridor]) -> None:
    """`check_corridor` of all legs; the errors name the leg too."""
    for index, leg in enumerate(legs):
        try:
            check_corridor(leg)
        except (InputError, InfeasibleError) as error:
            raise type(error)(f"leg {index}: {error.message}", field=error.field) from None


def _check_times(leg: int, durations_s: NDArray[np.float64], segments: int) -> None:
    if durations_s.shape != (segments,):
        message = f"leg {leg}: {segments} segments need as many times, not shape {durations_s.shape}"
        raise InputError(message, field="durations_s")
    good = (durations_s > 0) & np.isfinite(durations_s)
    if not good.all():
        bad = int(good.argmin())
        message = f"leg {leg}: segment {bad} lasts {durations_s[bad]:g} s; it needs a positive time"
        raise InputError(message, field="durations_s")


def minimum_snap(
    legs: Sequence[LegCorridor],
    durations_s: Sequence[NDArray[np.float64]],
    solvers: Sequence[QpSolver | ChainSolver],
) -> list[NDArray[np.float64]]:
    """Curves of least snap through corridors, from rest to rest.

    Args:
        legs: corridors from stop to stop.
        durations_s: segment times of each leg, shape (n,) each.
        solvers: a chain's solver gets all legs at once; of the others the first is tried on what is left, all together
            and then in ever smaller groups, and the rest on single legs.

    Returns:
        Control points of each leg's pieces, scene ENU m, shape (n, 8, 3) each.

    Raises:
        InputError: a corridor or a time that is not a good number; it names leg and segment.
        InfeasibleError: a corridor that no curve can be in; it names leg and segment.
        SolverError: no solver gives an answer with small residuals; it names the leg.
    """
    check_corridors(legs)
    for index, (leg, durations) in enumerate(zip(legs, durations_s, strict=True)):
        _check_times(index, durations, len(leg.boxes_m))
    curves = []
    for curve in solve_legs(legs, durations_s, solvers):
        if isinstance(curve, SolverError):
            raise curve
        curves.append(curve)
    return curves


def solve_legs(
    legs: Sequence[LegCorridor],
    durations_s: Sequence[NDArray[np.float64]],
    solvers: Sequence[QpSolver | ChainSolver],
) -> list[NDArray[np.float64] | SolverError]:
    """`minimum_snap` of corridors that were checked, with the error of a leg without answer in its curve's place."""
    curves: list[NDArray[np.float64] | SolverError] = [SolverError("no solver was given") for _ in legs]
    left = list(range(len(legs)))
    for solver in solvers:
        if isinstance(solver, ChainSolver) and left:
            stack = _Stack([legs[k] for k in left], [durations_s[k] for k in left])
            found, good = stack.solve_chains(solver)
            for k, curve, is_good in zip(left, found, good, strict=True):
                curves[k] = curve if is_good else SolverError(f"leg {k}: {solver.name} did not settle")
            left = [k for k, is_good in zip(left, good, strict=True) if not is_good]
    general = [solver for solver in solvers if not isinstance(solver, ChainSolver)]
    if left and general:
        rest = _solve_group([(k, legs[k], durations_s[k]) for k in left], general)
        for k, answer in zip(left, rest, strict=True):
            curves[k] = answer
    return curves


def _solve_group(
    group: list[tuple[int, LegCorridor, NDArray[np.float64]]], solvers: Sequence[QpSolver]
) -> list[NDArray[np.float64] | SolverError]:
    alone = len(group) == 1
    try:
        stack = _Stack([leg for _, leg, _ in group], [durations for _, _, durations in group])
        return [*stack.solve(solvers if alone else solvers[:1])]
    except SolverError as error:
        if alone:
            return [SolverError(f"leg {group[0][0]}: {error.message}")]
    half = len(group) // 2
    return _solve_group(group[:half], solvers) + _solve_group(group[half:], solvers)


class _Stack:
    """Legs side by side in one problem, each in units of its own mean segment time.

    Joints are numbered over all legs; joint j holds the state `states[j]`, shape (4, 3). Segment s goes from joint
    `start[s]` to joint `start[s] + 1`.
    """

    def __init__(self, legs: Sequence[LegCorridor], durations_s: Sequence[NDArray[np.float64]]) -> None:
        counts = np.array([len(durations) for durations in durations_s])
        self._leg = np.repeat(np.arange(len(legs)), counts)
        self._start = np.arange(counts.sum()) + self._leg
        self._first_segment = np.concatenate([[0], np.cumsum(counts)[:-1]])
        ratio = np.concatenate([durations / durations.mean() for durations in durations_s])
        self._powers = ratio[:, None] ** np.arange(4)
        both = np.tile(self._powers, 2)
        self._blocks = UNIT_COST * both[:, :, None] * both[:, None, :] / ratio[:, None, None] ** 7
        joints = np.concatenate([leg.joints_m for leg in legs])
        self._states = np.zeros((len(joints), 4, 3))
        self._states[:, 0] = joints
        # The inner joints are those that end one segment and start another of the same leg.
        self._left = np.flatnonzero(self._leg[:-1] == self._leg[1:])
        self._inner = self._start[self._left] + 1
        if not len(self._inner):
            return
        self._interpolate()
        product = self._products()
        cost = np.add.reduceat(np.einsum("skd,skd->sd", self._ends(), product), self._first_segment)
        self._cost = cost
        self._scale = np.maximum(cost, rest_to_rest_cost(COST_FLOOR_M, counts.astype(np.float64))[:, None])
        apart = np.array([np.linalg.norm(leg.joints_m[-1] - leg.joints_m[0]) for leg in legs])
        self._floor = 0.005 * rest_to_rest_cost(np.maximum(apart, COST_FLOOR_M), counts.astype(np.float64))
        self._gradient = product[self._left, 4:] + product[self._left + 1, :4]
        self._constrain(np.concatenate([leg.boxes_m for leg in legs]))

    def _ends(self) -> NDArray[np.float64]:
        """States at the start and the end of every segment, shape (S, 8, 3)."""
        return np.concatenate([self._states[self._start], self._states[self._start + 1]], axis=1)

    def _products(self) -> NDArray[np.float64]:
        """The cost's gradient with respect to every segment's ends, shape (S, 8, 3)."""
        return np.asarray(self._blocks @ self._ends())

    def _interpolate(self) -> None:
        """Fill in the velocities, accelerations and jerks of the least-snap curve through all joints."""
        product = self._products()
        right = -(product[self._left, 5:] + product[self._left + 1, 1:4])
        diagonal = self._blocks[self._left, 5:, 5:] + self._blocks[self._left + 1, 1:4, 1:4]
        linked = np.flatnonzero(np.diff(self._left) == 1)
        link = self._blocks[self._left[linked] + 1, 1:4, 5:]
        band = np.zeros((6, 3 * len(self._inner)))
        for row in range(3):
            for column in range(3):
                if column >= row:
                    band[5 + row - column, column::3] = diagonal[:, row, column]
                band[2 + row - column, 3 * (linked + 1) + column] = link[:, row, column]
        solution = solveh_banded(band, right.reshape(-1, 3))
        self._states[self._inner, 1:] = solution.reshape(-1, 3, 3)

    def _constrain(self, boxes: NDArray[np.float64]) -> None:
        """Seven control points hang on each inner joint: three of the left piece, three of the right, and itself."""
        count = len(self._inner)
        block = np.zeros((count, 7, 4))
        block[:, :3] = CONTROL_FROM_END[:3] * self._powers[self._left, None, :]
        block[:, 3:6] = CONTROL_FROM_START[1:] * self._powers[self._left + 1, None, :]
        block[:, 6, 0] = 1.0
        self._rows = block
        left, right = boxes[self._left], boxes[self._left + 1]
        shared = np.stack([np.maximum(left[:, 0], right[:, 0]), np.minimum(left[:, 1], right[:, 1])], axis=1)
        limits = np.concatenate([left[:, None].repeat(3, 1), right[:, None].repeat(3, 1), shared[:, None]], axis=1)
        value = block @ self._states[self._inner]
        self._low = limits[:, :, 0] + BOX_INSET_M - value
        self._high = limits[:, :, 1] - BOX_INSET_M - value
        # A derivative at the end of a piece is a multiple of a difference of its control points, all in one box.
        powers = self._powers[self._left]
        self._spread = (left[:, 1] - left[:, 0])[:, None, :] * (np.array([1, 14, 168, 1680]) / powers)[:, :, None]

    def _hessian_blocks(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Blocks of the inner joints' states, and those between a joint and the next, zero across legs: (J, 4, 4)."""
        diagonal = self._blocks[self._left, 4:, 4:] + self._blocks[self._left + 1, :4, :4]
        link = np.zeros_like(diagonal)
        linked = np.flatnonzero(np.diff(self._left) == 1)
        link[linked] = self._blocks[self._left[linked] + 1, :4, 4:]
        return diagonal, link

    def _strict_start(self) -> NDArray[np.float64]:
        """Changes of the states to what is strictly inside, from rest towards the interpolating curve, (J, 4, 3)."""
        rest = -self._states[self._inner]
        rest[:, 0] = (self._low[:, 6] + self._high[:, 6]) / 2
        value = self._rows @ rest
        room = np.where(value > 0, value - self._low, self._high - value)
        way = (1 - START_ROOM) * room / np.maximum(np.abs(value), 1e-30)
        return np.asarray(rest * (1 - np.minimum(way.min(axis=1), 1.0))[:, None, :])

    def solve_chains(self, solver: ChainSolver) -> tuple[list[NDArray[np.float64]], NDArray[np.bool_]]:
        """Control points of each leg's pieces, shape (n, 8, 3) each, and whether they are good, shape (L,)."""
        legs = len(self._first_segment)
        if not len(self._inner):
            return self._control(), np.ones(legs, dtype=np.bool_)
        diagonal, link = self._hessian_blocks()
        axes_first = [
            np.ascontiguousarray(np.moveaxis(values, -1, 0))
            for values in (self._gradient, self._low, self._high, self._spread, self._strict_start())
        ]
        gradient, low, high, spread, start = axes_first
        answer = solver.solve(
            ChainQp(
                first=np.searchsorted(self._leg[self._left], np.arange(legs + 1)),
                diagonal=diagonal,
                link=link,
                rows=self._rows,
                gradient=gradient,
                low=low,
                high=high,
                spread=spread,
                outset=np.ascontiguousarray(self._cost.T) / 2,
                floor=self._floor,
                start=start,
            )
        )
        self._states[self._inner] += np.moveaxis(answer.x, 0, -1)
        return self._control(), answer.good

    def solve(self, solvers: Sequence[QpSolver]) -> list[NDArray[np.float64]]:
        """Control points of each leg's pieces, shape (n, 8, 3) each."""
        if len(self._inner):
            changes = np.stack([self._solve_axis(axis, solvers) for axis in range(3)], axis=-1)
            self._states[self._inner] += changes.reshape(-1, 4, 3)
        return self._control()

    def _control(self) -> list[NDArray[np.float64]]:
        """Control points of each leg's pieces, shape (n, 8, 3) each."""
        start = CONTROL_FROM_START @ (self._states[self._start] * self._powers[:, :, None])
        end = CONTROL_FROM_END @ (self._states[self._start + 1] * self._powers[:, :, None])
        return np.split(np.concatenate([start, end], axis=1), self._first_segment[1:])

    def _solve_axis(self, axis: int, solvers: Sequence[QpSolver]) -> NDArray[np.float64]:
        weight = 1 / self._scale[self._leg[self._left], axis]
        diagonal, link = (blocks * weight[:, None, None] for blocks in self._hessian_blocks())
        count = len(self._inner)
        joint, row, column = np.arange(count)[:, None, None], np.arange(4)[:, None], np.arange(4)
        entries = [
            (diagonal, 4 * joint + row, 4 * joint + column),
            (link[:-1], 4 * joint[:-1] + row, 4 * joint[1:] + column),
            (link[:-1].transpose(0, 2, 1), 4 * joint[1:] + row, 4 * joint[:-1] + column),
        ]
        hessian = _sparse(entries, (4 * count, 4 * count))
        constraints = _sparse(
            [(self._rows, 7 * joint + np.arange(7)[:, None], 4 * joint + column)], (7 * count, 4 * count)
        )
        unit = 1 / np.sqrt(hessian.diagonal())
        scaling = sparse.diags(unit, format="csc")
        problem = QpProblem(
            hessian=(scaling @ hessian @ scaling).tocsc(),
            gradient=unit * (self._gradient[:, :, axis] * weight[:, None]).ravel(),
            constraints=(constraints @ scaling).tocsc(),
            low=self._low[:, :, axis].ravel(),
            high=self._high[:, :, axis].ravel(),
            spread=self._spread[:, :, axis].ravel() / unit,
        )
        return unit * solve_checked(problem, solvers).x


def _sparse(
    entries: Sequence[tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]], shape: tuple[int, int]
) -> sparse.csc_matrix[np.float64]:
    """A matrix of blocks with the rows and columns of their entries."""
    data = np.concatenate([values.ravel() for values, _, _ in entries])
    rows = np.concatenate([np.broadcast_to(row, values.shape).ravel() for values, row, _ in entries])
    columns = np.concatenate([np.broadcast_to(column, values.shape).ravel() for values, _, column in entries])
    return sparse.coo_matrix((data, (rows, columns)), shape=shape).tocsc()
