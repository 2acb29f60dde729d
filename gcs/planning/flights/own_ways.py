"""Which of the things that a vehicle can do by itself are safe, when: computed on the finished plan (safety rule 7)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.core.plan import OwnWays
from gcs.core.way_home import OwnAction
from gcs.planning.flights.retrace import MOST_POINTS, largest_accuracy_m, points_needed
from gcs.planning.flights.ways_home import check_ways_home

if TYPE_CHECKING:
    from gcs.core.plan import Plan
    from gcs.core.progress import Progress
    from gcs.planning.scene.point_distance import SceneDistance


def find_own_ways(plan: Plan, distance: SceneDistance, progress: Progress | None = None) -> OwnWays:
    """Find what a vehicle can do by itself along a plan, and what it can do from everywhere.

    How the vehicle is set up is not known yet; a plain return is taken, without a cone near home.

    Args:
        plan: what is flown.
        distance: exact distance to its scene.
        progress: reports the stage `ways_home`.
    """
    found = check_ways_home(plan, distance, None, progress)
    accuracy = largest_accuracy_m(plan)
    points = points_needed(plan.trajectory, accuracy) if accuracy > 0.0 else 0
    action = OwnAction.CONTINUE
    if found.clearest_m is not None and not found.never_clear_s:
        action = OwnAction.RETURN
    elif not found.landing_blocked_s:
        action = OwnAction.LAND
    elif accuracy > 0.0 and points <= MOST_POINTS and not found.hold_blocked_s:
        action = OwnAction.RETRACE
    rally_m = plan.scenario.rally_m
    rally = check_ways_home(plan, distance, None, progress, rally_m=rally_m) if rally_m else None
    return OwnWays(
        action=action,
        return_altitude_m=found.clearest_m,
        return_blocked_s=found.never_clear_s,
        landing_blocked_s=found.landing_blocked_s,
        hold_blocked_s=found.hold_blocked_s,
        retrace_accuracy_m=accuracy,
        retrace_points=points,
        rally_blocked_s=None if rally is None else rally.never_clear_s,
        rally_altitude_m=None if rally is None else rally.clearest_m,
    )


def describe_own_ways(ways: OwnWays, duration_s: float) -> str:
    """One line for people: what the vehicle can do by itself, and what it must not."""
    altitude = ways.return_altitude_m
    if ways.action is OwnAction.RETURN:
        return f"the vehicle's own return must fly at least {altitude:.0f} m above home; it is set so before a flight"
    told = f"during {_covered_s(ways, duration_s):.0f} s of the flight the vehicle's own return would hit the structure"
    if ways.rally_blocked_s is not None and ways.rally_altitude_m is not None:
        seconds = sum(b - a for a, b in ways.rally_blocked_s)
        told += f" (during {seconds:.0f} s with the scenario's rally points, which are sent to it)"
    if ways.action is OwnAction.LAND:
        return f"{told}; landing on the spot is clear from everywhere: its failsafes have to land"
    if ways.action is OwnAction.RETRACE:
        return (
            f"{told}: its failsafes have to let it go on with the mission, or fly it back the way it came (SmartRTL of "
            f"ArduPilot, SRTL_ACCURACY at most {ways.retrace_accuracy_m:.1f} m, SRTL_POINTS at least "
            f"{ways.retrace_points})"
        )
    return f"{told}: only a mission that its failsafes let go on can be flown"


def _covered_s(ways: OwnWays, duration_s: float) -> float:
    return duration_s if ways.return_altitude_m is None else sum(b - a for a, b in ways.return_blocked_s)
