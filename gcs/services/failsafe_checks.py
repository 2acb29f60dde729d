"""Whether what each failsafe of the vehicle does is safe from everywhere along the plan (safety rules 5 and 7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gcs.core.vehicle import LAST_BATTERY, FlightMode
from gcs.core.way_home import OwnAction
from gcs.services.preflight import check_failsafes
from gcs.storage.records import FlightPath

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gcs.core.vehicle import Failsafe
    from gcs.planning.flights.ways_home import Intervals, WaysHome
    from gcs.services.flight_types import PreflightCheck

MODES = {
    FlightPath.MISSION: (FlightMode.MISSION, FlightMode.HOLD),
    FlightPath.OFFBOARD: (FlightMode.OFFBOARD, FlightMode.HOLD),
    FlightPath.COMPANION: (FlightMode.OFFBOARD, FlightMode.HOLD),
}
"""Modes that a flight is in when a failsafe comes: what it flies with, and its pauses."""

ABOUT_PLACES = frozenset({"fence", "return"})
"""Failsafes that cannot come up along a plan: it never meets the fence."""

WORDS = {
    OwnAction.CONTINUE: "goes on with a mission",
    OwnAction.HOLD: "holds",
    OwnAction.LAND: "lands",
    OwnAction.RETURN: "returns",
    OwnAction.RETRACE: "flies back the way it came",
}
"""What can be set, best first."""
PREFERRED = (OwnAction.RETURN, OwnAction.LAND, OwnAction.RETRACE, OwnAction.CONTINUE, OwnAction.HOLD)


@dataclass(frozen=True)
class OwnWaysOfVehicle:
    """What the vehicle's own actions would do along the plan, with its own parameters.

    Attributes:
        found: its return, landing and hold.
        return_known: whether it told how it returns.
        retrace_problem: why flying back the way it came is not safe; empty when it is.
        retrace_settings: what to set besides so that it is, in words; None when nothing helps.
        duration_s: of the plan.
    """

    found: WaysHome
    return_known: bool
    retrace_problem: str
    retrace_settings: str | None
    duration_s: float

    def blocked_s(self, action: OwnAction) -> Intervals:
        """When an action would come too near to something."""
        everywhere = ((0.0, self.duration_s),)
        if action is OwnAction.RETURN:
            return self.found.blocked_s if self.return_known else everywhere
        if action is OwnAction.LAND:
            return self.found.landing_blocked_s
        if action is OwnAction.RETRACE:
            return everywhere if self.retrace_problem else self.found.hold_blocked_s
        if action is OwnAction.HOLD:
            return self.found.hold_blocked_s
        return everywhere if action is OwnAction.FALL else ()


def check_failsafes_along(
    failsafes: Sequence[Failsafe], ways: OwnWaysOfVehicle, path: FlightPath
) -> list[PreflightCheck]:
    """`check_failsafes`, and each one's action held against the scene.

    A failsafe whose action would hit is refused when it can be set so that it does not; the check says how. Where no
    setting of it is safe everywhere, as for PX4's battery under a structure, it must be accepted by name. What is done
    with a nearly empty battery, after the failsafe for a low one, is a last resort: it is said, and not refused.

    Args:
        failsafes: as they were read.
        ways: what the vehicle's actions would do.
        path: how the plan is flown.
    """
    return [_check(failsafe, ways, path) for failsafe in failsafes]


def _check(failsafe: Failsafe, ways: OwnWaysOfVehicle, path: FlightPath) -> PreflightCheck:
    (check,) = check_failsafes([failsafe])
    if failsafe.about in ABOUT_PLACES or not failsafe.active:
        return check
    worst: Intervals = ()
    mode, action = MODES[path][0], OwnAction.NOTHING
    for m in MODES[path]:
        done = failsafe.actions.get(m, OwnAction.NOTHING)
        blocked = ways.blocked_s(done)
        if _seconds(blocked) > _seconds(worst):
            worst, mode, action = blocked, m, done
    if not worst:
        return check
    if action is OwnAction.RETRACE and ways.retrace_problem:
        why = ways.retrace_problem
    else:
        in_hold = " while it holds" if mode is FlightMode.HOLD else ""
        seconds, first = _seconds(worst), worst[0][0]
        why = f"during {seconds:.0f} s of the plan, first at {first:.0f} s,{in_hold} that would hit the structure"
    if failsafe.about == LAST_BATTERY:
        return replace(check, detail=f"{check.detail}; {why}")
    safe = [a for a in PREFERRED if a in failsafe.settings and _can_be_safe(a, ways, path)]
    if safe:
        how = " or ".join(f"{_setting(a, failsafe, ways)} ({WORDS[a]})" for a in safe[:2])
        return replace(check, state="refused", detail=f"{check.detail}; {why}: set {how}")
    return replace(check, state="needs_acceptance", detail=f"{check.detail}; {why}, and so would any setting of it")


def _can_be_safe(action: OwnAction, ways: OwnWaysOfVehicle, path: FlightPath) -> bool:
    if action is OwnAction.CONTINUE:
        return path is FlightPath.MISSION
    if action is OwnAction.RETRACE:
        return ways.retrace_settings is not None and not ways.found.hold_blocked_s
    return not ways.blocked_s(action)


def _setting(action: OwnAction, failsafe: Failsafe, ways: OwnWaysOfVehicle) -> str:
    besides = f" with {ways.retrace_settings}" if action is OwnAction.RETRACE and ways.retrace_settings else ""
    return failsafe.settings[action] + besides


def _seconds(intervals: Intervals) -> float:
    """How long intervals are together; a single instant counts too."""
    return sum(b - a + 1e-3 for a, b in intervals)
