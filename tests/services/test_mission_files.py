"""Mission files as other ground stations read them."""

from __future__ import annotations

import json
import math

import pytest
from pymavlink import mavwp

from gcs.core.frames import GeoPoint
from gcs.core.mission import Mission, MissionItem
from gcs.core.vehicle import Autopilot
from gcs.services.mission_files import mission_planner_waypoints, qgroundcontrol_plan

HOME = GeoPoint(31.3622, 121.6155, 4.0)


def mission(frame, action, first):
    return Mission(
        (
            first,
            MissionItem(1, frame, 22, (0.0, 0.0, 0.0, 0.0), 313622000, 1216155000, 30.0),
            MissionItem(2, action, 178, (1.0, 4.0, -1.0, 0.0), 0, 0, 0.0),
            MissionItem(3, frame, 16, (1.0, 0.5, 0.0, 90.0), 313623001, 1216156002, 31.25),
            MissionItem(4, action, 203, (0.0, 0.0, 0.0, 0.0), 1, 0, 0.0),
            MissionItem(5, frame, 21, (0.0, 0.0, 0.0, 0.0), 313622000, 1216155000, 4.0),
        ),
        {0: 4},
    )


PX4 = mission(5, 2, MissionItem(0, 5, 22, (0.0, 0.0, 0.0, math.nan), 313622000, 1216155000, 30.0, current=1))
ARDUPILOT = mission(0, 0, MissionItem(0, 0, 16, (0.0, 0.0, 0.0, 0.0), 313622000, 1216155000, 4.0))


def test_plan_for_qgroundcontrol():
    content = json.loads(qgroundcontrol_plan(PX4, Autopilot.PX4, HOME, 4.0))
    assert (content["fileType"], content["version"]) == ("Plan", 1)
    assert set(content) >= {"geoFence", "rallyPoints", "mission", "groundStation"}
    body = content["mission"]
    assert body["plannedHomePosition"] == [31.3622, 121.6155, 4.0]
    assert body["firmwareType"] == 12
    items = body["items"]
    assert [i["doJumpId"] for i in items] == [1, 2, 3, 4, 5, 6]
    assert [i["command"] for i in items] == [22, 22, 178, 16, 203, 21]
    assert [i["frame"] for i in items] == [0, 0, 2, 0, 2, 0]
    assert items[0]["params"] == [0, 0, 0, None, 31.3622, 121.6155, 30.0]
    assert items[3]["params"] == [1.0, 0.5, 0.0, 90.0, 31.3623001, 121.6156002, 31.25]
    assert (items[3]["AltitudeMode"], items[3]["Altitude"]) == (2, 31.25)
    assert items[4]["params"][4] == 1
    assert "AltitudeMode" not in items[4]


def test_ardupilots_home_item_is_not_an_item_for_qgroundcontrol():
    body = json.loads(qgroundcontrol_plan(ARDUPILOT, Autopilot.ARDUPILOT, HOME, 4.0))["mission"]
    assert body["firmwareType"] == 3
    assert [i["command"] for i in body["items"]] == [22, 178, 16, 203, 21]


@pytest.mark.parametrize(("built", "autopilot"), [(PX4, Autopilot.PX4), (ARDUPILOT, Autopilot.ARDUPILOT)])
def test_waypoints_as_an_independent_reader_reads_them(tmp_path, built, autopilot):
    file = tmp_path / "mission.waypoints"
    file.write_text(mission_planner_waypoints(built, autopilot, HOME))
    loader = mavwp.MAVWPLoader()
    wanted = list(built.items[1:] if autopilot is Autopilot.ARDUPILOT else built.items)
    assert loader.load(str(file)) == len(wanted) + 1
    home = loader.wp(0)
    assert (home.command, home.current, home.frame) == (16, 1, 0)
    assert (home.x, home.y, home.z) == pytest.approx((31.3622, 121.6155, 4.0))
    for n, item in enumerate(wanted, start=1):
        got = loader.wp(n)
        assert (got.seq, got.command, got.autocontinue) == (n, item.command, 1)
        expected = [0.0 if math.isnan(p) else p for p in item.params]
        assert [got.param1, got.param2, got.param3, got.param4] == pytest.approx(expected)
        assert got.z == pytest.approx(item.z)
        if item.x > 1000:
            assert (round(got.x * 1e7), round(got.y * 1e7)) == (item.x, item.y)
            assert got.frame == 0
        else:
            assert got.x == item.x
