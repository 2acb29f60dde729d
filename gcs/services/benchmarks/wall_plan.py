"""The plan that the benchmark's companions fly: a few pictures of a wall, all from one height."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from gcs.core.plan import Plan
from gcs.core.progress import SilentProgress
from gcs.core.scenario import parse_scenario
from gcs.planning.planner import make_plan
from gcs.services.companion.flyable_plan import flyable_plan
from gcs.storage.solid_shapes import box, structure_of_solids

if TYPE_CHECKING:
    from gcs.core.structure import Structure
    from gcs.services.companion.flyable_plan import FlyablePlan

HEIGHT_M = 3.4
"""Of the points on the wall, so of about the whole flight: the planes of the lidar."""

WALL_M = ((-16.0, 10.0, 0.0), (16.0, 11.0, 8.0))
POINTS_EAST_M = (-10.0, -3.0, 4.0, 11.0)
HOME_M = (-14.0, -10.0, 0.0)
SAFETY = {"clearance_m": 0.5, "tracking_m": 0.3, "position_m": 0.2, "model_m": 0.1}
ANCHOR = (31.3622, 121.6155, 4.0)


@dataclass(frozen=True, eq=False)
class WallPlan:
    """A plan and its hash."""

    plan: Plan
    plan_hash: str


class WallPlans:
    """Implements `gcs.services.companion.doors.PlanSource` for this one plan."""

    def get(self, plan_hash: str, offboard_timeout_s: float) -> FlyablePlan | None:
        """See PlanSource."""
        del plan_hash  # there is no other plan
        return _flyable(offboard_timeout_s)


@lru_cache(maxsize=1)
def wall_plan() -> WallPlan:
    """The plan, made when first asked for."""
    scenario = parse_scenario(
        {
            "name": "wall",
            "structure": {"meshes": [{"file": "wall.ply"}]},
            "anchor": dict(zip(("latitude_deg", "longitude_deg", "altitude_m"), ANCHOR, strict=True)),
            "ground_m": 0.0,
            "home_m": HOME_M,
            "safety": SAFETY,
            "camera": {
                "sensor_width_mm": 35.9,
                "sensor_height_mm": 24.0,
                "focal_length_mm": 35.0,
                "image_width_px": 8192,
                "image_height_px": 5460,
            },
            "inspection": {
                "points": [
                    {"name": f"P{east:+g}", "position_m": (east, WALL_M[0][1], HEIGHT_M), "normal": (0.0, -1.0, 0.0)}
                    for east in POINTS_EAST_M
                ]
            },
        }
    )
    plan = make_plan(scenario, _wall(), SilentProgress())
    assert isinstance(plan, Plan)  # no battery is given that could need several flights
    return WallPlan(plan, hashlib.sha256(repr(scenario).encode()).hexdigest())


@lru_cache
def _flyable(offboard_timeout_s: float) -> FlyablePlan:
    made = wall_plan()
    return flyable_plan(made.plan, made.plan_hash, _wall(), offboard_timeout_s)


def _wall() -> Structure:
    return structure_of_solids([box(*WALL_M)])
