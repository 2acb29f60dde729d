"""Fence and rally points: items of a scenario, and their proof on fake time through bad links.

The vehicles are the mission servers of the simulator, which share no protocol code with the station.
"""

from __future__ import annotations

import math
import random

import pytest

from gcs.core.errors import GcsError, LinkError, RefusedError
from gcs.core.frames import enu_from_geodetic
from gcs.core.mission import Command, MissionItem
from gcs.core.scenario import Scenario
from gcs.core.vehicle import Autopilot
from gcs.mavlink.canonical_form import compare
from gcs.mavlink.fence_rally_items import fence_items, rally_items
from gcs.mavlink.mission_clear import MissionClear
from gcs.mavlink.mission_proof import MissionPeer, download, upload_list_and_prove
from gcs.mavlink.mission_protocol import ListUnsupportedError, MissionType
from sitl_mocks.ardupilot_mission_server import ArduPilotMissionServer
from sitl_mocks.mission_items import StoredItem
from sitl_mocks.px4_mission_server import Px4MissionServer

KINDS = ["px4", "ardupilot"]
LISTS = [MissionType.FENCE, MissionType.RALLY]
SQUARE = ((-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0))
HOLE = ((-5.0, 0.0), (5.0, 0.0), (0.0, 8.0))
HOME = StoredItem(0, 16, (0.0, 0.0, 0.0, 0.0), 313622000, 1216155000, 4.0)


def scenario(**changes) -> Scenario:
    content = {
        "name": "t",
        "structure": {"sample": "gantry-crane"},
        "anchor": {"latitude_deg": 31.3622, "longitude_deg": 121.6155, "altitude_m": 4.3},
        "camera": {
            "sensor_width_mm": 13.2,
            "sensor_height_mm": 8.8,
            "focal_length_mm": 8.8,
            "image_width_px": 5472,
            "image_height_px": 3648,
            "min_interval_s": 1.0,
            "gimbal": {"pitch_min_deg": -90, "pitch_max_deg": 30, "rate_deg_s": 60},
        },
        "inspection": {"points": [{"name": "a", "position_m": [0, 0, 10], "normal": [0, -1, 0]}]},
        "vehicle": {"radius_m": 0.5, "max_speed_m_s": 5.0, "max_acceleration_m_s2": 2.5},
        "safety": {
            "clearance_m": 1.0,
            "tracking_m": 0.5,
            "position_m": 0.3,
            "model_m": 0.1,
            "corridor_half_width_m": 0.5,
        },
        "home_m": [-20, -20, 0],
        "fence": {"include": [SQUARE], "exclude": [HOLE], "max_height_m": 110},
        "rally_m": [[-30.0, 10.0, 0.0], [30.0, -40.0, 0.0]],
    }
    return Scenario.model_validate(content | changes)


class ListVehicle:
    """A mission server on the fake clock, behind the rig's bad link."""

    def __init__(self, clock, kind):
        self.clock = clock
        self.texts = []
        self.before_in = lambda message: None
        self.alter_out = lambda message: [message]
        say = lambda severity, text: self.texts.append(text)  # noqa: E731
        if kind == "px4":
            self.server = Px4MissionServer(say, lambda: None, lambda: 0)
        else:
            self.server = ArduPilotMissionServer(say, lambda: None, lambda: HOME, lambda: True)
        self.put = lambda message, source=None: None

    def held(self, mission_type):
        return self.server.others[mission_type].items

    def hear(self, message):
        self.before_in(message)
        self.server.handle(message, self.say, self.clock())

    def say(self, message):
        for altered in self.alter_out(message):
            self.put(altered)

    @property
    def deadline(self):
        servers = (self.server, *self.server.others.values())
        return self.clock() + 0.05 if any(s.upload is not None for s in servers) else math.inf

    def on_time(self):
        self.server.step(self.clock())


@pytest.fixture
def make_lists(make_rig):
    """A rig whose vehicle keeps fence and rally points: `make_lists("px4" | "ardupilot", seed=…, loss=…)`."""

    def make(kind, **faults):
        rig = make_rig(lambda clock: ListVehicle(clock, kind), **faults)

        def on_time():  # the vehicle's timers run while it is not spoken to
            rig.vehicle.on_time()
            rig.at.append((rig.clock() + 0.05, on_time))

        rig.at.append((rig.clock(), on_time))
        return rig

    return make


def peer(rig, kind):
    return MissionPeer(1, 1, Autopilot(kind), rig.send, rig.clock, rig.run, own_system=255)


def items_of(kind, mission_type):
    if mission_type is MissionType.FENCE:
        return fence_items(scenario())
    return rally_items(scenario(), Autopilot(kind))


def truly_held(rig, kind, mission_type):
    """Whether the store has the scenario's list, judged by places and counts alone."""
    wanted = items_of(kind, mission_type)
    held = [(i.command, i.x, i.y, i.params[0]) for i in rig.vehicle.held(mission_type)]
    heights = [i.z for i in rig.vehicle.held(mission_type)]
    return held == [(i.command, i.x, i.y, i.params[0]) for i in wanted] and heights == pytest.approx(
        [i.z for i in wanted]
    )


# Items ---------------------------------------------------------------------------------------------------------------


def test_the_corners_of_a_fence_come_back_to_where_they_were():
    given = scenario()
    items = fence_items(given)
    assert [i.command for i in items] == [5001] * 4 + [5002] * 3
    assert [i.params[0] for i in items] == [4.0] * 4 + [3.0] * 3
    assert [i.sequence for i in items] == list(range(7))
    for item, corner in zip(items, (*SQUARE, *HOLE), strict=True):
        there = enu_from_geodetic(item.x * 1e-7, item.y * 1e-7, given.anchor.altitude_m, given.anchor.point)
        assert math.dist(there[:2], corner) < 0.01


def test_a_closed_polygon_is_sent_open():
    closed = scenario(fence={"include": [(*SQUARE, SQUARE[0])]})
    assert fence_items(closed) == fence_items(scenario(fence={"include": [SQUARE]}))


def test_a_scenario_without_lists_has_no_items():
    bare = scenario(fence=None, rally_m=[])
    assert fence_items(bare) == ()
    assert rally_items(bare, Autopilot.PX4) == ()
    assert fence_items(scenario(fence={"max_height_m": 50})) == ()


@pytest.mark.parametrize(("kind", "height"), [("px4", 4.3), ("ardupilot", 4.0)])
def test_rally_points_are_above_sea_level(kind, height):
    items = rally_items(scenario(), Autopilot(kind))
    assert {(i.command, i.frame) for i in items} == {(Command.NAV_RALLY_POINT, 0)}
    assert [i.z for i in items] == pytest.approx([height, height], abs=0.005)


def test_canonical_forms_tell_what_matters():
    fence = fence_items(scenario())
    for autopilot in Autopilot:
        moved = [*fence[:-1], MissionItem(6, 0, 5002, (3.0, 0.0, 0.0, 0.0), fence[-1].x + 3, fence[-1].y, 0.0)]
        assert compare(fence, fence, autopilot, MissionType.FENCE).equal
        assert not compare(fence, moved, autopilot, MissionType.FENCE).equal
        assert not compare(fence, fence[:-1], autopilot, MissionType.FENCE).equal
        turned = [MissionItem(i.sequence, i.frame, 5002, i.params, i.x, i.y, i.z) for i in fence]
        assert not compare(fence, turned, autopilot, MissionType.FENCE).equal
        points = rally_items(scenario(), autopilot)
        higher = [MissionItem(i.sequence, i.frame, i.command, i.params, i.x, i.y, i.z + 3) for i in points]
        assert not compare(points, higher, autopilot, MissionType.RALLY).equal


# Transfers -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mission_type", LISTS)
@pytest.mark.parametrize("seed", range(6))
async def test_proved_through_loss_doubling_and_reordering(make_lists, kind, mission_type, seed):
    rig = make_lists(kind, seed=seed, loss=0.05 * seed, double=0.1, jitter_s=0.05)
    proof = await upload_list_and_prove(items_of(kind, mission_type), mission_type, peer(rig, kind))
    assert proof.items_read == len(items_of(kind, mission_type))
    assert truly_held(rig, kind, mission_type)
    assert rig.vehicle.server.items == [], "the mission is another list"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(30))
async def test_random_faults_never_give_a_false_answer(make_lists, kind, seed):
    rng = random.Random(7000 + seed)
    mission_type = rng.choice(LISTS)
    rig = make_lists(
        kind,
        seed=seed,
        loss=rng.choice([0, 0.2, 0.4, 0.6]),
        double=rng.choice([0, 0.5]),
        jitter_s=rng.choice([0, 0.3, 1.0]),
        corrupt=rng.choice([0, 0.1]),
    )
    try:
        await upload_list_and_prove(items_of(kind, mission_type), mission_type, peer(rig, kind))
    except GcsError as error:
        assert isinstance(error, LinkError | RefusedError)
        assert not isinstance(error, ListUnsupportedError)
    else:
        assert truly_held(rig, kind, mission_type)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mission_type", LISTS)
async def test_answers_about_another_list_are_not_ours(make_lists, wire, kind, mission_type):
    """Stale acknowledgements, requests and counts of the mission and of the other list, good and bad."""
    rig = make_lists(kind)
    others = [t for t in MissionType if t is not mission_type]

    def with_stale(message):
        stale = [wire.MAVLink_mission_ack_message(255, 190, result, t) for t in others for result in (0, 1, 3, 4, 13)]
        stale += [wire.MAVLink_mission_request_int_message(255, 190, 0, t) for t in others]
        stale += [wire.MAVLink_mission_count_message(255, 190, 1, t) for t in others]
        return [*stale, message]

    rig.vehicle.alter_out = with_stale
    await upload_list_and_prove(items_of(kind, mission_type), mission_type, peer(rig, kind))
    assert truly_held(rig, kind, mission_type)


@pytest.mark.parametrize("mission_type", LISTS)
async def test_invalid_sequence_of_a_doubled_item_is_no_failure(make_lists, mission_type):
    rig = make_lists("ardupilot", up={"double": 1.0})
    heard = []
    rig.on_heard = lambda t, m: heard.append(m)
    await upload_list_and_prove(items_of("ardupilot", mission_type), mission_type, peer(rig, "ardupilot"))
    assert 13 in {m.type for m in heard if m.get_type() == "MISSION_ACK"}
    assert truly_held(rig, "ardupilot", mission_type)


@pytest.mark.parametrize("kind", KINDS)
async def test_a_lost_final_acknowledgement_is_a_success(make_lists, kind):
    rig = make_lists(kind)
    rig.down.faults.drop = lambda m: m.get_type() == "MISSION_ACK"
    proof = await upload_list_and_prove(items_of(kind, MissionType.FENCE), MissionType.FENCE, peer(rig, kind))
    assert "acknowledgement did not come" in proof.how
    assert truly_held(rig, kind, MissionType.FENCE)


@pytest.mark.parametrize("kind", KINDS)
async def test_a_fence_that_changes_after_the_acknowledgement_is_not_proved(make_lists, kind):
    rig = make_lists(kind)

    def spoil(message):
        if message.get_type() == "MISSION_REQUEST_LIST":
            del rig.vehicle.held(MissionType.FENCE)[-1:]

    rig.vehicle.before_in = spoil
    with pytest.raises(RefusedError, match="holds something else than was sent"):
        await upload_list_and_prove(items_of(kind, MissionType.FENCE), MissionType.FENCE, peer(rig, kind))


async def test_a_fence_that_the_vehicle_finds_bad_is_refused_and_the_old_one_stays(make_lists):
    rig = make_lists("ardupilot")
    await upload_list_and_prove(items_of("ardupilot", MissionType.FENCE), MissionType.FENCE, peer(rig, "ardupilot"))
    bad = fence_items(scenario(fence={"include": [SQUARE]}))[:3]
    with pytest.raises(RefusedError, match="holds something else"):
        await upload_list_and_prove(bad, MissionType.FENCE, peer(rig, "ardupilot"))
    assert truly_held(rig, "ardupilot", MissionType.FENCE)


@pytest.mark.parametrize("kind", KINDS)
async def test_too_many_corners_are_refused_with_what_helps(make_lists, kind):
    rig = make_lists(kind)
    round_m = [(60 * math.cos(2 * math.pi * k / 90), 60 * math.sin(2 * math.pi * k / 90)) for k in range(90)]
    many = fence_items(scenario(fence={"include": [round_m]}))
    with pytest.raises(RefusedError, match=r"the fence has 90 items.*64 to 70 corners"):
        await upload_list_and_prove(many, MissionType.FENCE, peer(rig, kind))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mission_type", LISTS)
async def test_clearing_one_list_leaves_the_others(make_lists, kind, mission_type):
    rig = make_lists(kind, loss=0.2, seed=3)
    for each in LISTS:
        await upload_list_and_prove(items_of(kind, each), each, peer(rig, kind))
    await rig.run(MissionClear(1, 1, rig.send, rig.clock, mission_type, own_system=255))
    assert await download(peer(rig, kind), mission_type=mission_type) == ()
    for each in LISTS:
        assert bool(rig.vehicle.held(each)) == (each is not mission_type)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mission_type", LISTS)
async def test_a_vehicle_without_the_list_is_told_apart(make_lists, kind, mission_type):
    rig = make_lists(kind)
    rig.vehicle.server.others.clear()
    with pytest.raises(ListUnsupportedError, match=mission_type.noun):
        await upload_list_and_prove(items_of(kind, mission_type), mission_type, peer(rig, kind))
    with pytest.raises(ListUnsupportedError, match=mission_type.noun):
        await download(peer(rig, kind), mission_type=mission_type)
