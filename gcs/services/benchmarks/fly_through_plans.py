"""Rows `plan-fly-*` of benchmark `trajectories`: whole plans of the sample crane that fly through their viewpoints.

`over_time_optimal` is the flight over the time-optimal profile along its own curve, under the same limits; the speed at
which the camera takes a picture sharply is one of them, at its place. `over_stopping` is the plan's duration over that
of the same plan with a stop at every viewpoint. All points are on one side of the crane: how long the vehicle takes to
turn is no property of the curve.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gcs.core.inspection import Inspection
from gcs.core.plan import Plan
from gcs.core.progress import SilentProgress
from gcs.core.scenario import parse_scenario
from gcs.planning.planner import make_plan
from gcs.planning.trajectories.flight_limits import limits_of
from gcs.planning.views.image_sharpness import passing_speeds_m_s
from gcs.services.benchmarks.row import Row
from gcs.services.benchmarks.time_optimal import time_optimal_s
from gcs.storage.mesh_files import load_structure, sample_scenario

EXPOSURES = {"quick": 1 / 8000, "slow": 1 / 1000}
"""With the first the camera limits the speed hardly anywhere, with the second at every viewpoint."""

JERK_M_S3 = 6.0
"""As of the rows `fly-*`: without a limit the profile changes its acceleration at once, which no curve here does."""

SIDE = "L"
"""Names of the points on one side begin with it."""

NODES_PER_SECOND = 12
MOST = 1.15
"""What is asked of the ratio to the time-optimal profile."""


def fly_through_rows(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: few points, and one exposure time.
    """
    rows: list[Row] = []
    for name, exposure_s in EXPOSURES.items():
        if quick and name != "quick":
            continue
        passing, stopping = (_plan(exposure_s, viewpoints, quick) for viewpoints in ("fly_through", "stop"))
        case = f"plan-fly-{name}"
        flown_s = passing.certificates.duration_s
        rows += [
            Row(case, "over_time_optimal", flown_s / _least_s(passing), "1", "asked", MOST),
            Row(case, "over_stopping", flown_s / stopping.certificates.duration_s, "1"),
            Row(case, "stops", float(sum(view.stops for view in passing.viewpoints)), "1"),
        ]
    return rows


def _plan(exposure_s: float, viewpoints: str, quick: bool) -> Plan:
    asked: dict[str, Any] = sample_scenario("gantry-crane")
    asked["camera"] |= {"exposure_s": exposure_s, "min_interval_s": 0.5}
    asked["vehicle"] |= {"max_jerk_m_s3": JERK_M_S3}
    asked["planner"] = asked.get("planner", {}) | {"viewpoints": viewpoints}
    scenario = parse_scenario(asked)
    structure, _ = load_structure(scenario.structure, Path())
    points = [point for point in structure.named_points if point.name.startswith(SIDE)]
    inspection = Inspection(points=tuple(points[:4] if quick else points))
    plan = make_plan(scenario.model_copy(update={"inspection": inspection}), structure, SilentProgress())
    assert isinstance(plan, Plan), "its battery is enough for one flight"
    return plan


def _least_s(plan: Plan) -> float:
    """Least time along the plan's curve, which does not rest on its way."""
    speeds = passing_speeds_m_s(plan.viewpoints, plan.scenario).tolist()
    slow = [(view.time_s, speed) for view, speed in zip(plan.viewpoints, speeds, strict=True)]
    nodes = round(NODES_PER_SECOND * plan.trajectory.duration_s)
    return time_optimal_s(plan.trajectory, limits_of(plan.scenario.vehicle), nodes, slow)
