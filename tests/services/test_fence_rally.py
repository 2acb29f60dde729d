"""What becomes of fence and rally points before a flight: sent, left alone, said, or accepted by name."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from gcs.core.errors import LinkError, RefusedError
from gcs.core.vehicle import Autopilot
from gcs.mavlink.mission_proof import UploadProof
from gcs.mavlink.mission_protocol import ListUnsupportedError, MissionType
from gcs.services.fence_rally import check_lists, lists_of_plan, upload_lists

SQUARE = ((-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0))


class Vehicle:
    """Keeps lists as they are sent."""

    def __init__(self, autopilot=Autopilot.PX4, **parameters):
        self.identity = SimpleNamespace(autopilot=autopilot, name=f"{autopilot.value}-1")
        self.held = {MissionType.FENCE: (), MissionType.RALLY: ()}
        self.parameters = {"FENCE_TYPE": 7.0, "FENCE_OPTIONS": 0.0} | parameters
        self.uploads = []
        self.fails = {}

    async def download_list(self, mission_type, progress=None):
        if mission_type not in self.held:
            raise ListUnsupportedError(f"the vehicle keeps no {mission_type.noun}")
        if "read" in self.fails:
            raise self.fails["read"]
        return self.held[mission_type]

    async def upload_list(self, items, mission_type, progress=None):
        if "upload" in self.fails:
            raise self.fails["upload"]
        self.uploads.append(mission_type)
        self.held[mission_type] = tuple(items)
        return UploadProof(len(items), len(items), "read back", 1, tuple(items))

    async def read_parameters(self, names):
        return {name: self.parameters.get(name) for name in names}


@pytest.fixture
def plan(small_plan):
    """With a fence and two rally points."""
    scenario = type(small_plan.scenario).model_validate(
        small_plan.scenario.model_dump(mode="json")
        | {"fence": {"include": [SQUARE]}, "rally_m": [[-30, 0, 0], [-30, 10, 0]]}
    )
    return replace(small_plan, scenario=scenario)


@pytest.fixture
def bare(small_plan):
    """Without either."""
    scenario = type(small_plan.scenario).model_validate(
        small_plan.scenario.model_dump(mode="json") | {"fence": None, "rally_m": []}
    )
    return replace(small_plan, scenario=scenario)


def states(checks):
    return {check.name: check.state for check in checks}


async def test_nothing_wanted_and_nothing_held_is_fine(bare):
    vehicle = Vehicle()
    assert states(await check_lists(bare, vehicle, sent=False)) == {"fence": "ok", "rally points": "ok"}
    assert await upload_lists(bare, vehicle) == []
    assert vehicle.uploads == []


@pytest.mark.parametrize("autopilot", [Autopilot.PX4, Autopilot.ARDUPILOT])
async def test_the_scenarios_lists_are_sent_and_then_found(plan, autopilot):
    vehicle = Vehicle(autopilot)
    before = await check_lists(plan, vehicle, sent=False)
    assert states(before) == {"fence": "ok", "rally points": "ok"}
    assert "4 items are sent before the flight" in before[0].detail
    missing = await check_lists(plan, vehicle, sent=True)
    assert states(missing) == {"fence": "refused", "rally points": "refused"}
    proofs = await upload_lists(plan, vehicle)
    assert [(p.name, p.proved, p.items) for p in proofs] == [("fence", True, 4), ("rally points", True, 2)]
    assert vehicle.uploads == [MissionType.FENCE, MissionType.RALLY]
    after = await check_lists(plan, vehicle, sent=True)
    assert states(after) == {"fence": "ok", "rally points": "ok"}
    assert "read back" in after[0].detail


async def test_a_fence_that_the_plan_did_not_bring_is_left_and_must_be_accepted(plan, bare):
    vehicle = Vehicle()
    await upload_lists(plan, vehicle)
    held = dict(vehicle.held)
    checks = await check_lists(bare, vehicle, sent=False)
    assert states(checks) == {"fence": "needs_acceptance", "rally points": "needs_acceptance"}
    assert "did not bring" in checks[0].detail
    assert "not checked" in checks[1].detail
    assert await upload_lists(bare, vehicle) == []
    assert vehicle.held == held


async def test_what_is_replaced_is_said(plan):
    vehicle = Vehicle()
    vehicle.held[MissionType.FENCE] = lists_of_plan(plan, Autopilot.PX4)[MissionType.FENCE][:3]
    check = (await check_lists(plan, vehicle, sent=False))[0]
    assert (check.state, "in the place of 3" in check.detail) == ("ok", True)
    assert "in the place of 3" in (await upload_lists(plan, vehicle))[0].how


async def test_a_vehicle_without_lists(plan, bare):
    vehicle = Vehicle()
    vehicle.held.clear()
    assert states(await check_lists(bare, vehicle, sent=False)) == {"fence": "ok", "rally points": "ok"}
    for sent in (False, True):
        checks = await check_lists(plan, vehicle, sent=sent)
        assert states(checks) == {"fence": "needs_acceptance", "rally points": "needs_acceptance"}
    assert [p.proved for p in await upload_lists(plan, vehicle)] == [False, False]


async def test_what_cannot_be_read_is_unknown(plan):
    vehicle = Vehicle()
    vehicle.fails["read"] = LinkError("the vehicle stopped answering")
    assert states(await check_lists(plan, vehicle, sent=True)) == {"fence": "unknown", "rally points": "unknown"}


@pytest.mark.parametrize("kind", [RefusedError, LinkError])
async def test_an_upload_that_fails_names_the_list_and_the_vehicle(plan, kind):
    vehicle = Vehicle()
    vehicle.fails["upload"] = kind("no room")
    with pytest.raises(kind, match=r"px4-1: fence: no room"):
        await upload_lists(plan, vehicle)


async def test_ardupilots_settings_must_mean_the_same(plan):
    async def fence(wanted, **parameters):
        return (await check_lists(wanted, Vehicle(Autopilot.ARDUPILOT, **parameters), sent=False))[0]

    off = await fence(plan, FENCE_TYPE=3.0)
    assert off.state == "needs_acceptance"
    assert "FENCE_TYPE 7" in off.detail
    far = tuple((x + 200.0, y) for x, y in SQUARE)
    fences = plan.scenario.fence.model_copy(update={"include": (SQUARE, far)})
    two = replace(plan, scenario=plan.scenario.model_copy(update={"fence": fences}))
    both = await fence(two, FENCE_OPTIONS=1.0)
    assert both.state == "needs_acceptance"
    assert "FENCE_OPTIONS 3" in both.detail
    assert (await fence(two, FENCE_OPTIONS=3.0)).state == "ok"
