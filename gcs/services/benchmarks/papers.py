"""Benchmark `papers`: the experiments of the papers behind the project, with ours beside theirs.

Here are the trajectory experiments of the yard paper and the gantry-crane paper on the sample scenes; for the bridge
tower see `paper_tower`.

The papers' scenes are not published, so that figures stand side by side, not against each other. Means over the runs,
unless a figure is of one run. What a run and a variant is: see `paper_runs`.

Curves are flown in still air without drag: by the papers' rigid body, whose motors have no lag, with gains of ours,
because theirs are not given; and (`lagging`) by a vehicle with the motors and gains that simulated vehicles have.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.dynamics.geometric_controller import ControllerGains
from gcs.planning.dynamics.quadrotor import GRAVITY_M_S2
from gcs.planning.dynamics.tracking_prediction import TrackingPrediction, predict_tracking, usual_quadrotor
from gcs.services.benchmarks.paper_runs import RUNS, VARIANTS, Case, Run, Variant, prepare_run
from gcs.services.benchmarks.paper_tower import tower_rows
from gcs.services.benchmarks.row import Row

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from gcs.planning.trajectories.curve_figures import CurveFigures

CASES: tuple[Case, ...] = ("yard", "crane")


class Table(NamedTuple):
    """Five runs of a paper with one method.

    Attributes:
        mean_deviation_m: of the curve from the path.
        max_deviation_m: None where the paper has no such column.
        length_m: of the curve.
    """

    mean_deviation_m: tuple[float, ...]
    max_deviation_m: tuple[float, ...] | None
    length_m: tuple[float, ...]


class Published(NamedTuple):
    """What a paper prints.

    Attributes:
        name: of the paper.
        before: plain minimum snap.
        after: its own method.
        path_m: length of the path; None where it is not given.
        errors_before: as `ERRORS` of a flight of plain minimum snap; None where they are not given.
        errors_after: the same with its own method.
    """

    name: str
    before: Table
    after: Table
    path_m: float | None
    errors_before: tuple[float | None, ...]
    errors_after: tuple[float | None, ...]


PUBLISHED: dict[Case, Published] = {
    "yard": Published(
        "JMSE 2024, 12, 128",
        Table((3.162, 3.363, 3.162, 3.403, 3.175), None, (1917.223, 1946.701, 1917.223, 1937.157, 1919.038)),
        Table((1.114, 1.114, 1.106, 1.124, 1.086), None, (1873.703, 1870.354, 1874.921, 1874.120, 1869.729)),
        1834.897,
        (0.05, 0.06, 0.007, None, math.radians(8e-6)),
        (0.02, 0.02, 0.0025, None, math.radians(2.5e-7)),
    ),
    "crane": Published(
        "Remote Sensing 2022, 14, 1658",
        Table(
            (2.08, 1.98, 1.92, 1.89, 1.95), (10.07, 9.92, 9.27, 9.01, 9.66), (216.67, 204.62, 201.04, 199.19, 202.89)
        ),
        Table((0.39, 0.36, 0.41, 0.30, 0.37), (2.01, 1.97, 1.22, 1.90, 2.11), (173.56, 170.01, 175.55, 168.71, 177.09)),
        None,
        (None,) * 5,
        (0.16, 0.22, 0.062, 0.28, 5.1e-4),
    ),
}

ERRORS: dict[str, tuple[str, Callable[[TrackingPrediction], float]]] = {
    "tracking_x_m": ("m", lambda t: t.axes_m[0]),
    "tracking_y_m": ("m", lambda t: t.axes_m[1]),
    "tracking_z_m": ("m", lambda t: t.axes_m[2]),
    "tracking_m": ("m", lambda t: t.distance_m),
    "yaw_error_rad": ("rad", lambda t: t.yaw_rad),
}
"""Largest errors of a flight: figure, unit, and where it is."""

NO_LAG_S = 0.003
"""Time constant of the motors that is as good as none, and still much for the step of the integration."""

STIFF = ControllerGains(position_s2=64.0, velocity_s=16.0, attitude_s2=2500.0, rate_s=100.0)

BEFORE, AFTER = "plain_through", "corridor_through"
"""What stands beside the papers' single runs."""


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: one run of each, in a corner of the yard and a low part of the tower.
    """
    return [*(row for case in CASES for row in _case(case, quick)), *tower_rows(quick)]


def _case(case: Case, quick: bool) -> list[Row]:
    runs = [prepare_run(case, seed, quick) for seed in range(1 if quick else RUNS)]
    curves: dict[str, list[CurveFigures]] = {v: [r.stopping(v).figures for r in runs] for v in VARIANTS}
    curves |= {f"{v}_through": [r.through(v).figures for r in runs] for v in VARIANTS}
    published = PUBLISHED[case]
    rows = [Row(case, "path_m", _mean(f.path_length_m for f in curves[AFTER]), "m", published.name, published.path_m)]
    for name, found in curves.items():
        plain_s = [f.duration_s for f in curves["plain_through" if name.endswith("_through") else "plain"]]
        rows += _variant(case, name, found, plain_s, runs[0].scenario.safety.hull_clearance_m)
    for name, table in ((BEFORE, published.before), (AFTER, published.after)):
        rows += _single_runs(case, name, curves[name], table)
    rows += _tracking(case, "plain", runs, published.errors_before)
    return rows + _tracking(case, "corridor", runs, published.errors_after)


def _variant(
    case: Case, name: str, found: Sequence[CurveFigures], plain_s: Sequence[float], asked_m: float
) -> list[Row]:
    """What a variant does, in the mean over the runs; the clearance is the smallest of all."""
    published = PUBLISHED[case]
    table = published.before if name.startswith("plain") else published.after
    largest = None if table.max_deviation_m is None else _mean(table.max_deviation_m)
    ratio = None if published.path_m is None else _mean(table.length_m) / published.path_m
    paper, plain = published.name, "plain minimum snap, same limits"
    shares = [f.duration_s / seconds for f, seconds in zip(found, plain_s, strict=True)]

    def row(figure: str, value: float, unit: str, beside: str, beside_value: float | None) -> Row:
        return Row(case, f"{name}.{figure}", value, unit, beside, beside_value)

    return [
        row("mean_deviation_m", _mean(f.mean_deviation_m for f in found), "m", paper, _mean(table.mean_deviation_m)),
        row("max_deviation_m", _mean(f.max_deviation_m for f in found), "m", paper, largest),
        row("length_m", _mean(f.length_m for f in found), "m", paper, _mean(table.length_m)),
        row("length_ratio", _mean(f.length_m / f.path_length_m for f in found), "1", paper, ratio),
        row("duration_s", _mean(f.duration_s for f in found), "s", plain, _mean(plain_s)),
        row("longest_duration_share", max(shares), "1", plain, 1.0),
        row("min_clearance_m", min(f.min_clearance_m for f in found), "m", "asked", asked_m),
    ]


def _single_runs(case: Case, name: str, found: Sequence[CurveFigures], table: Table) -> list[Row]:
    """The papers' tables: a line for each run."""
    paper = PUBLISHED[case].name
    rows = []
    for k, f in enumerate(found):
        largest = None if table.max_deviation_m is None else table.max_deviation_m[k]
        rows += [
            Row(
                case, f"{name}.run-{k + 1}.mean_deviation_m", f.mean_deviation_m, "m", paper, table.mean_deviation_m[k]
            ),
            Row(case, f"{name}.run-{k + 1}.max_deviation_m", f.max_deviation_m, "m", paper, largest),
            Row(case, f"{name}.run-{k + 1}.length_m", f.length_m, "m", paper, table.length_m[k]),
            Row(case, f"{name}.run-{k + 1}.duration_s", f.duration_s, "s"),
        ]
    return rows


def _tracking(case: Case, variant: Variant, runs: Sequence[Run], errors: Sequence[float | None]) -> list[Row]:
    """Largest errors and thrusts of all runs' flights, dwells and turns included."""
    mass_kg = runs[0].scenario.vehicle.mass_kg
    usual = replace(usual_quadrotor(mass_kg), drag_n_s_m=(0.0, 0.0, 0.0))
    quick = replace(usual, motor_time_constant_s=NO_LAG_S)
    built = [r.planned(variant) for r in runs]
    flights = [predict_tracking(b.trajectory, b.yaw, parameters=quick, gains=STIFF) for b in built]
    lagging = [predict_tracking(b.trajectory, b.yaw, parameters=usual) for b in built]
    paper = PUBLISHED[case].name
    rows = [
        Row(case, f"{variant}.{figure}", max(map(of, flights)), unit, paper, error)
        for (figure, (unit, of)), error in zip(ERRORS.items(), errors, strict=True)
    ]
    hover = mass_kg * GRAVITY_M_S2 / 4
    return [
        *rows,
        Row(case, f"{variant}.least_motor_thrust_n", min(f.thrust_n[0] for f in flights), "N", "hover", hover),
        Row(case, f"{variant}.most_motor_thrust_n", max(f.thrust_n[1] for f in flights), "N", "hover", hover),
        Row(case, f"{variant}.lagging.tracking_m", max(f.distance_m for f in lagging), "m"),
        Row(case, f"{variant}.lagging.yaw_error_rad", max(f.yaw_rad for f in lagging), "rad"),
    ]


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))
