"""Fence and rally points of a scenario on a vehicle: what is checked, what is sent, and what is left alone.

A list that the scenario has replaces the vehicle's, whole, and is proved by reading it back; what it replaces is said.
A list that the scenario does not have is never touched: a fence that is on the vehicle is somebody's, and removing it
is not this station's to decide. It is said instead, and has to be accepted by name before a flight, because such a
fence can end the flight anywhere, and the vehicle may return to such a rally point on ways that nobody checked. The
same holds for a vehicle that keeps no such list although the scenario has one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.core.errors import GcsError, LinkError, RefusedError
from gcs.core.vehicle import Autopilot
from gcs.mavlink.canonical_form import compare
from gcs.mavlink.fence_rally_items import fence_items, rally_items
from gcs.mavlink.mission_protocol import ListUnsupportedError, MissionType
from gcs.services.flight_types import PreflightCheck

if TYPE_CHECKING:
    from gcs.core.mission import MissionItem
    from gcs.core.plan import Plan
    from gcs.core.progress import Progress
    from gcs.mavlink.vehicle import Vehicle

NAMES = {MissionType.FENCE: "fence", MissionType.RALLY: "rally points"}
"""The checks' names, by which they are accepted."""

_THE = {MissionType.FENCE: "a fence", MissionType.RALLY: "a list of rally points"}
_FOREIGN = {
    MissionType.FENCE: "which may end the flight",
    MissionType.RALLY: "and it may return to them on ways that were not checked",
}
_ABSENT = {
    MissionType.FENCE: "only the plan keeps it inside the scenario's",
    MissionType.RALLY: "it returns home only",
}
_POLYGONS = 4
"""Bit of FENCE_TYPE."""
_UNION = 2
"""Bit of FENCE_OPTIONS: inside any included polygon, and not inside all of them."""


@dataclass(frozen=True)
class ListProof:
    """What became of one list.

    Attributes:
        name: `fence` or `rally points`.
        proved: whether the vehicle was shown to hold it.
        items: number of items.
        how: the way it was proved, or why it is not there, in words.
        canonical_crc32: fingerprint in the vehicle's canonical form; None when it is not there.
    """

    name: str
    proved: bool
    items: int
    how: str
    canonical_crc32: int | None = None


def lists_of_plan(plan: Plan, autopilot: Autopilot) -> dict[MissionType, tuple[MissionItem, ...]]:
    """The items of the plan's fence and rally points; empty where the scenario has none."""
    return {
        MissionType.FENCE: fence_items(plan.scenario),
        MissionType.RALLY: rally_items(plan.scenario, autopilot),
    }


async def check_lists(plan: Plan, vehicle: Vehicle, *, sent: bool) -> list[PreflightCheck]:
    """Compare what the vehicle holds with the scenario; nothing is changed.

    Args:
        plan: of the flight.
        vehicle: that is to fly it.
        sent: whether the plan's lists were sent already, and so must be there.
    """
    wanted = lists_of_plan(plan, vehicle.identity.autopilot)
    checks = [await _check(mission_type, items, vehicle, sent=sent) for mission_type, items in wanted.items()]
    if wanted[MissionType.FENCE] and checks[0].state == "ok":
        problem = await _settings_problem(plan, vehicle)
        if problem:
            checks[0] = PreflightCheck("fence", "needs_acceptance", f"{checks[0].detail}; {problem}")
    return checks


async def upload_lists(plan: Plan, vehicle: Vehicle, progress: Progress | None = None) -> list[ListProof]:
    """Put the scenario's fence and rally points on a vehicle and prove them; other lists stay as they are.

    Raises:
        RefusedError: the vehicle refused one, or holds something else.
        LinkError: the link is gone; what the vehicle holds is unknown.
    """
    proofs = []
    for mission_type, items in lists_of_plan(plan, vehicle.identity.autopilot).items():
        if not items:
            continue
        name = NAMES[mission_type]
        try:
            replaced = len(await vehicle.download_list(mission_type, progress))
            proof = await vehicle.upload_list(items, mission_type, progress)
        except ListUnsupportedError as error:
            proofs.append(ListProof(name, False, len(items), error.message))
        except (RefusedError, LinkError) as error:
            raise type(error)(f"{name}: {error.message}", field=vehicle.identity.name) from error
        else:
            how = proof.how + (f"; in the place of {replaced} that it held" if replaced else "")
            proofs.append(ListProof(name, True, len(items), how, proof.canonical_crc32))
    return proofs


async def _check(
    mission_type: MissionType, wanted: tuple[MissionItem, ...], vehicle: Vehicle, *, sent: bool
) -> PreflightCheck:
    name, count = NAMES[mission_type], len(wanted)
    try:
        held = await vehicle.download_list(mission_type)
    except ListUnsupportedError as error:
        if not wanted:
            return PreflightCheck(name, "ok", f"{error.message}, and the scenario has none")
        return PreflightCheck(name, "needs_acceptance", f"{error.message}: {_ABSENT[mission_type]}")
    except GcsError as error:
        return PreflightCheck(name, "unknown", error.message)
    if not wanted:
        if not held:
            return PreflightCheck(name, "ok", "the scenario has none, and the vehicle holds none")
        why = (
            f"the vehicle holds {_THE[mission_type]} of {len(held)} items that this plan did not bring, "
            f"{_FOREIGN[mission_type]}; "
            "it is left as it is: remove it with the station that it came from, or give the scenario its own"
        )
        return PreflightCheck(name, "needs_acceptance", why)
    found = compare(wanted, held, vehicle.identity.autopilot, mission_type)
    if found.equal:
        return PreflightCheck(name, "ok", f"the vehicle holds the scenario's, read back: {count} items")
    if sent:
        why = f"the vehicle does not hold the scenario's: {found.summary}: upload again"
        return PreflightCheck(name, "refused", why)
    instead = f", in the place of {len(held)} that the vehicle holds now" if held else ""
    return PreflightCheck(name, "ok", f"{count} items are sent before the flight{instead}")


async def _settings_problem(plan: Plan, vehicle: Vehicle) -> str:
    """What keeps ArduPilot from watching polygons as the scenario means them; empty when nothing does."""
    fence = plan.scenario.fence
    if vehicle.identity.autopilot is not Autopilot.ARDUPILOT or fence is None:
        return ""
    values = await vehicle.read_parameters(["FENCE_TYPE", "FENCE_OPTIONS"])
    kinds, options = values["FENCE_TYPE"], values["FENCE_OPTIONS"]
    if kinds is not None and not round(kinds) & _POLYGONS:
        return f"it does not watch polygons: set FENCE_TYPE {round(kinds) | _POLYGONS}"
    if len(fence.include) > 1 and not round(options or 0) & _UNION:
        return (
            f"it has to be inside all {len(fence.include)} included polygons at once, the scenario means any of them: "
            f"set FENCE_OPTIONS {round(options or 0) | _UNION}"
        )
    return ""
