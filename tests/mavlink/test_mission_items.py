"""Plans as mission items in both dialects: what the real autopilots were measured to take, and nothing else."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.frames import enu_from_geodetic
from gcs.core.plan import Viewpoint
from gcs.core.scenario import parse_scenario
from gcs.core.vehicle import Autopilot
from gcs.mavlink.mission_items import MissionLimits, build_mission

PX4, ARDUPILOT, GENERIC = Autopilot.PX4, Autopilot.ARDUPILOT, Autopilot.GENERIC

PX4_TAKES_IN_FRAME_2 = {178, 206, 214, 2000, 2001, 203, 1000, 1001, 205, 93, 177, 20, 530, 2003, 2500}
ARDUPILOT_TAKES = {16, 21, 22, 178, 206, 2000, 203, 1000, 205, 115, 93, 82}


def scenario(**changes):
    return parse_scenario(
        {
            "structure": {"sample": "gantry-crane"},
            "anchor": {"latitude_deg": 31.3622, "longitude_deg": 121.6155, "altitude_m": 4.0},
            "camera": {
                "sensor_width_mm": 13.2,
                "sensor_height_mm": 8.8,
                "focal_length_mm": 8.8,
                "image_width_px": 5472,
                "image_height_px": 3648,
                **changes,
            },
            "vehicle": {"max_speed_m_s": 4.0},
            "home_m": [-20, -20, 0],
        }
    )


def viewpoint(number, position, yaw_deg, pitch_deg):
    return Viewpoint(
        id=number,
        name=f"L{number}",
        position_m=np.array(position, float),
        direction=np.array([1.0, 0, 0]),
        up=np.array([0, 0, 1.0]),
        gsd_m=0.002,
        time_s=10.0 * number,
        yaw_rad=math.radians(yaw_deg),
        gimbal_pitch_rad=math.radians(pitch_deg),
    )


VIEWPOINTS = (viewpoint(0, (10, 0, 30), 90, -45), viewpoint(1, (10, 12, 30), -135, 20), viewpoint(2, (0, 12, 25), 0, 0))
TAKEOFF = np.array([-20.0, -20.0, 30.0])
LEGS = [
    np.array([[10.0, 0, 30]]),
    np.array([[14.0, 4, 30], [14.0, 8, 30], [10.0, 12, 30]]),
    np.array([[0.0, 12, 25]]),
    np.array([[0.0, 12, 30], [-20.0, -20, 30]]),
]


def mission(autopilot, limits=None, **changes):
    plan = SimpleNamespace(scenario=scenario(**changes), viewpoints=VIEWPOINTS)
    return build_mission(plan, TAKEOFF, LEGS, autopilot, limits)


def place(item):
    anchor = scenario().anchor.point
    return enu_from_geodetic(item.x / 1e7, item.y / 1e7, item.z, anchor)


@pytest.mark.parametrize("autopilot", list(Autopilot))
def test_numbered_from_zero_and_only_what_the_autopilot_takes(autopilot):
    items = mission(autopilot).items
    assert [i.sequence for i in items] == list(range(len(items)))
    assert all(i.autocontinue == 1 for i in items)
    for i in items:
        if autopilot is ARDUPILOT:
            assert i.command in ARDUPILOT_TAKES
            assert i.frame == 0
            assert all(math.isfinite(v) for v in (*i.params, i.z))
        elif i.command in {16, 21, 22}:
            assert i.frame == 5
        else:
            assert i.command in PX4_TAKES_IN_FRAME_2
            assert i.frame == 2


def test_px4_begins_with_take_off_as_current_and_ardupilot_with_home():
    px4, ardupilot = mission(PX4).items, mission(ARDUPILOT).items
    assert (px4[0].command, px4[0].current) == (22, 1)
    assert all(i.current == 0 for i in px4[1:])
    np.testing.assert_allclose(place(px4[0]), TAKEOFF, atol=0.02)
    assert (ardupilot[0].command, ardupilot[1].command) == (16, 22)
    np.testing.assert_allclose(place(ardupilot[0]), (-20, -20, 0), atol=0.02)
    np.testing.assert_allclose(place(ardupilot[1]), TAKEOFF, atol=0.02)


def test_speeds_come_before_the_first_waypoint():
    limits = MissionLimits(max_speed_m_s=3.5, max_climb_m_s=2.0, max_descent_m_s=1.0)
    px4, ardupilot = mission(PX4, limits).items, mission(ARDUPILOT, limits).items
    assert [(i.params[0], i.params[1]) for i in px4 if i.command == 178] == [(1.0, 3.5)]
    assert [(i.params[0], i.params[1]) for i in ardupilot if i.command == 178] == [(1, 3.5), (2, 2.0), (3, 1.0)]
    for items, first in ((px4, 1), (ardupilot, 2)):
        waypoint = next(i.sequence for i in items[first:] if i.command == 16)
        assert max(i.sequence for i in items if i.command == 178) < waypoint
    assert [i.params[1] for i in mission(PX4).items if i.command == 178] == [4.0]


@pytest.mark.parametrize("autopilot", list(Autopilot))
def test_places_are_those_of_the_legs_in_amsl(autopilot):
    ways = [i for i in mission(autopilot).items if i.command == 16][1 if autopilot is ARDUPILOT else 0 :]
    np.testing.assert_allclose([place(i) for i in ways], np.vstack(LEGS), atol=0.02)
    last = mission(autopilot).items[-1]
    assert last.command == 21
    np.testing.assert_allclose(place(last), (-20, -20, 0), atol=0.02)
    assert last.z == pytest.approx(4.0, abs=0.02)


@pytest.mark.parametrize("autopilot", [PX4, GENERIC])
def test_what_happens_at_a_viewpoint_px4(autopilot):
    built = mission(autopilot)
    for v in VIEWPOINTS:
        k = built.viewpoint_items[v.id]
        way, gimbal, settle, picture, after = built.items[k - 3 : k + 2]
        assert [i.command for i in (way, gimbal, settle, picture, after)] == [16, 1000, 93, 2000, 93]
        np.testing.assert_allclose(place(way), v.position_m, atol=0.02)
        assert way.params[0] >= 1.0
        assert way.params[3] == pytest.approx((90 - math.degrees(v.yaw_rad)) % 360)
        assert gimbal.params[0] == pytest.approx(math.degrees(v.gimbal_pitch_rad))
        assert picture.params == (0.0, 0.0, 1.0, v.id + 1)
        assert settle.params[1:] == after.params[1:] == (-1.0, -1.0, -1.0)
        assert after.params[0] >= 1.0


def test_what_happens_at_a_viewpoint_ardupilot():
    built = mission(ARDUPILOT)
    for v in VIEWPOINTS:
        k = built.viewpoint_items[v.id]
        way, gimbal, yaw, settle, picture, after = built.items[k - 4 : k + 2]
        assert [i.command for i in (way, gimbal, yaw, settle, picture, after)] == [16, 205, 115, 93, 203, 93]
        assert way.params == (1.0, 0.0, 0.0, 0.0)
        assert gimbal.params[0] == pytest.approx(math.degrees(v.gimbal_pitch_rad))
        assert gimbal.z == 2.0
        assert yaw.params[0] == pytest.approx((90 - math.degrees(v.yaw_rad)) % 360)
        assert yaw.params[3] == 0.0, "an absolute heading"
        assert picture.x == 1, "shoot"


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_delay_before_a_picture_is_long_enough_for_both_turns(autopilot):
    built = mission(autopilot, gimbal={"rate_deg_s": 10.0})
    delays = [next(i for i in built.items[k::-1] if i.command == 93).params[0] for k in built.viewpoint_items.values()]
    turn = 135  # from 90 to -135 deg the short way
    assert delays[1] >= max(65 / 10, turn / 30) + 1.0
    assert delays[2] >= max(20 / 10, 135 / 30) + 1.0
    assert all(d < 12 for d in delays)


def test_ardupilot_has_time_to_turn_back_from_where_its_nose_points_on_the_way():
    same = (viewpoint(0, (0, 0, 30), 90, 0), viewpoint(1, (0, -20, 30), 90, 0))
    plan = SimpleNamespace(scenario=scenario(), viewpoints=same)
    legs = [np.array([[0.0, 0, 30]]), np.array([[0.0, -20, 30]]), np.array([[-20.0, -20, 30]])]
    for autopilot, turn_deg in ((ARDUPILOT, 180), (PX4, 0)):  # it flies south; PX4 is told to look north all the way
        built = build_mission(plan, TAKEOFF, legs, autopilot)
        assert built.items[built.viewpoint_items[1] - 1].params[0] == pytest.approx(turn_deg / 30 + 1.0, abs=0.11)


def test_shortest_interval_of_the_camera_is_kept():
    built = mission(PX4, min_interval_s=30.0)
    for k in built.viewpoint_items.values():
        assert built.items[k - 1].params[0] + built.items[k + 1].params[0] >= 30.0


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_a_mission_stops_where_the_plan_flies_through_and_stays_as_long_as_a_hold_asks(autopilot):
    plain = mission(autopilot)
    first, second, third = VIEWPOINTS
    views = (replace(first, stops=False), replace(second, hold_s=8.0), replace(third, stops=False))
    asked = build_mission(SimpleNamespace(scenario=scenario(), viewpoints=views), TAKEOFF, LEGS, autopilot)
    changed = [(a, b) for a, b in zip(plain.items, asked.items, strict=True) if a != b]
    assert len(changed) == 1, "nothing but the delay behind the second picture"
    assert changed[0][1] == asked.items[asked.viewpoint_items[1] + 1]
    assert changed[0][1].params[0] + 1.0 >= 8.0, "with the second that it has settled before"


def test_acceptance_radius_is_smaller_than_the_spacing():
    ways = [i for i in mission(PX4).items if i.command == 16]
    points = np.vstack([TAKEOFF, *LEGS])
    for k, way in enumerate(ways, start=1):
        spacing = np.linalg.norm(points[k] - points[k - 1])
        assert 0 < way.params[1] < max(spacing, 0.2)
        assert way.params[1] <= 1.0


def test_heading_on_the_way_is_that_of_the_next_viewpoint():
    ways = [i for i in mission(PX4).items if i.command == 16]
    headings = [round(w.params[3]) for w in ways]
    assert headings == [0, 225, 225, 225, 90, 90, 90]


def test_legs_must_fit_the_viewpoints():
    plan = SimpleNamespace(scenario=scenario(), viewpoints=VIEWPOINTS)
    with pytest.raises(ValueError, match="one leg"):
        build_mission(plan, TAKEOFF, LEGS[:-1], PX4)


async def test_uploads_are_proved_by_both_vehicles(make_rig):
    """The scripted vehicles store what the real ones were measured to store."""
    from gcs.mavlink.mission_proof import MissionPeer, upload_and_prove

    for kind, autopilot in (("px4", PX4), ("ardupilot", ARDUPILOT)):
        rig = make_rig(kind, loss=0.1)
        built = mission(autopilot)
        proof = await upload_and_prove(built, MissionPeer(1, 1, autopilot, rig.send, rig.clock, rig.run))
        assert proof.items_read == len(built.items)
