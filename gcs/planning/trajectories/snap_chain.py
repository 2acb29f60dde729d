"""The cost of least snap over chains of joints, and the curve that interpolates them.

The unknowns are the states at the joints (position, velocity, acceleration, jerk), so the curve is C^3 by
construction. In each state the Bernstein control points of the pieces on both sides are linear: four of the left piece
depend on it, and four of the right piece. Legs between stops do not touch each other: every leg is a chain of its own.

Every leg is written in its own mean segment time, about the curve that interpolates its joints. Without this the cost
is a small difference of numbers that grow with the seventh power of the segment count.
"""

from __future__ import annotations

from math import comb
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.linalg import solveh_banded

from gcs.planning.numerics.bernstein import CONTROL_FROM_END, CONTROL_FROM_START

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.planning.trajectories.safe_corridor import LegCorridor

COST_FLOOR_M = 1e-2
"""Legs, and axes on which a leg hardly moves, have their cost divided by that of a move of this length at least."""


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


class SnapChain:
    """Legs side by side, each in units of its own mean segment time, about the curve that interpolates its joints.

    Joints are numbered over all legs. Segment s goes from joint `start[s]` to joint `start[s] + 1`. The inner joints
    are those that end one segment and start another of the same leg; only their states are unknown.

    Attributes:
        leg: number of each segment's leg, shape (S,).
        durations_s: each segment's time, shape (S,).
        start: joint at which each segment starts, shape (S,).
        first_segment: of each leg, shape (L,).
        powers: each segment's time to the powers 0 to 3, shape (S, 4).
        states: of the joints, in their leg's unit of time, shape (J, 4, 3).
        left: the segment before each inner joint, shape (I,).
        inner: the inner joints, shape (I,).
        rows: the control points that hang on an inner joint: three of the left piece, three of the right, and itself;
            shape (I, 7, 4).
        cost: of the interpolating curve, by leg and axis, shape (L, 3).
        rest_cost: of a straight move over each leg's length, at least `COST_FLOOR_M`, in its time, shape (L,).
        least_cost: of a straight move over `COST_FLOOR_M` in each leg's time, shape (L,).
        gradient: of the cost at the interpolating curve, shape (I, 4, 3).
    """

    def __init__(self, legs: Sequence[LegCorridor], durations_s: Sequence[NDArray[np.float64]]) -> None:
        counts = np.array([len(durations) for durations in durations_s])
        self.leg = np.repeat(np.arange(len(legs)), counts)
        self.start = np.arange(counts.sum()) + self.leg
        self.first_segment = np.concatenate([[0], np.cumsum(counts)[:-1]])
        self.durations_s = np.concatenate(durations_s)
        ratio = np.concatenate([durations / durations.mean() for durations in durations_s])
        self.powers = ratio[:, None] ** np.arange(4)
        both = np.tile(self.powers, 2)
        self._blocks = UNIT_COST * both[:, :, None] * both[:, None, :] / ratio[:, None, None] ** 7
        joints = np.concatenate([leg.joints_m for leg in legs])
        self.states = np.zeros((len(joints), 4, 3))
        self.states[:, 0] = joints
        self.left = np.flatnonzero(self.leg[:-1] == self.leg[1:])
        self.inner = self.start[self.left] + 1
        if len(self.inner):
            self._interpolate()
        product = self._products()
        self.cost = np.add.reduceat(np.einsum("skd,skd->sd", self._ends(), product), self.first_segment)
        apart = np.array([np.linalg.norm(leg.joints_m[-1] - leg.joints_m[0]) for leg in legs])
        self.least_cost = rest_to_rest_cost(COST_FLOOR_M, counts.astype(np.float64))
        self.rest_cost = rest_to_rest_cost(np.maximum(apart, COST_FLOOR_M), counts.astype(np.float64))
        self.gradient = product[self.left, 4:] + product[self.left + 1, :4]
        self.rows = np.zeros((len(self.inner), 7, 4))
        self.rows[:, :3] = CONTROL_FROM_END[:3] * self.powers[self.left, None, :]
        self.rows[:, 3:6] = CONTROL_FROM_START[1:] * self.powers[self.left + 1, None, :]
        self.rows[:, 6, 0] = 1.0

    def _ends(self) -> NDArray[np.float64]:
        """States at the start and the end of every segment, shape (S, 8, 3)."""
        return np.concatenate([self.states[self.start], self.states[self.start + 1]], axis=1)

    def _products(self) -> NDArray[np.float64]:
        """The cost's gradient with respect to every segment's ends, shape (S, 8, 3)."""
        return np.asarray(self._blocks @ self._ends())

    def _interpolate(self) -> None:
        """Fill in the velocities, accelerations and jerks of the least-snap curve through all joints."""
        product = self._products()
        right = -(product[self.left, 5:] + product[self.left + 1, 1:4])
        diagonal = self._blocks[self.left, 5:, 5:] + self._blocks[self.left + 1, 1:4, 1:4]
        linked = np.flatnonzero(np.diff(self.left) == 1)
        link = self._blocks[self.left[linked] + 1, 1:4, 5:]
        band = np.zeros((6, 3 * len(self.inner)))
        for row in range(3):
            for column in range(3):
                if column >= row:
                    band[5 + row - column, column::3] = diagonal[:, row, column]
                band[2 + row - column, 3 * (linked + 1) + column] = link[:, row, column]
        solution = solveh_banded(band, right.reshape(-1, 3))
        self.states[self.inner, 1:] = solution.reshape(-1, 3, 3)

    def hessian_blocks(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Blocks of the inner joints' states, and those between a joint and the next, zero across legs: (I, 4, 4)."""
        diagonal = self._blocks[self.left, 4:, 4:] + self._blocks[self.left + 1, :4, :4]
        link = np.zeros_like(diagonal)
        linked = np.flatnonzero(np.diff(self.left) == 1)
        link[linked] = self._blocks[self.left[linked] + 1, :4, 4:]
        return diagonal, link

    def hessian(self, scale: NDArray[np.float64]) -> sparse.csc_matrix[np.float64]:
        """The cost's Hessian of one axis, each leg's cost divided by its scale (L,), shape (4 I, 4 I)."""
        weight = 1 / scale[self.leg[self.left], None, None]
        diagonal, link = (blocks * weight for blocks in self.hessian_blocks())
        joint, row, column = np.arange(len(diagonal))[:, None, None], np.arange(4)[:, None], np.arange(4)
        entries = [
            (diagonal, 4 * joint + row, 4 * joint + column),
            (link[:-1], 4 * joint[:-1] + row, 4 * joint[1:] + column),
            (link[:-1].transpose(0, 2, 1), 4 * joint[1:] + row, 4 * joint[:-1] + column),
        ]
        return sparse_blocks(entries, (4 * len(diagonal), 4 * len(diagonal)))

    def spread(self, boxes_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far two states of a joint in the boxes (S, 2, 3) can be apart, shape (I, 4, 3).

        A derivative at the end of a piece is a multiple of a difference of its control points, all in one box.
        """
        left = boxes_m[self.left]
        powers = self.powers[self.left]
        return np.asarray((left[:, 1] - left[:, 0])[:, None, :] * (np.array([1, 14, 168, 1680]) / powers)[:, :, None])

    def control(self) -> list[NDArray[np.float64]]:
        """Control points of each leg's pieces, shape (n, 8, 3) each."""
        start = CONTROL_FROM_START @ (self.states[self.start] * self.powers[:, :, None])
        end = CONTROL_FROM_END @ (self.states[self.start + 1] * self.powers[:, :, None])
        return np.split(np.concatenate([start, end], axis=1), self.first_segment[1:])


def sparse_blocks(
    entries: Sequence[tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]], shape: tuple[int, int]
) -> sparse.csc_matrix[np.float64]:
    """A matrix of blocks with the rows and columns of their entries."""
    data = np.concatenate([values.ravel() for values, _, _ in entries])
    rows = np.concatenate([np.broadcast_to(row, values.shape).ravel() for values, row, _ in entries])
    columns = np.concatenate([np.broadcast_to(column, values.shape).ravel() for values, _, column in entries])
    return sparse.coo_matrix((data, (rows, columns)), shape=shape).tocsc()
