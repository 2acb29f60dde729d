"""Pictures by the distance flown, and what there must be on the vehicle for it."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl_mocks.distance_trigger import DistanceTrigger

M = mavlink
ZERO = (0.0, 0.0, 0.0, 0.0)
EACH_M = 5.0


def survey(g):
    """A mission of 40 m that takes a picture every 5 m, until it is switched off half-way."""
    px4 = g.vehicle.kind == "px4"
    frame = 6 if px4 else 3
    rows = [
        (frame, 22, ZERO, -20.0, 10.0),
        (frame, 16, ZERO, -10.0, 10.0),
        (2, 206, (EACH_M, 0.0, 1.0, 0.0), 0.0, 0.0),
        (frame, 16, ZERO, 13.0, 10.0),
        (2, 206, (0.0, 0.0, 0.0, 0.0), 0.0, 0.0),
        (frame, 16, ZERO, 30.0, 10.0),
    ]
    items = [] if px4 else [g.item(0, 0, 16)]
    for frame, command, params, north, z in rows:
        place = {"x": 0, "y": 0} if frame == 2 else {}
        items.append(g.item(len(items), frame, command, params, north, -20.0, z, current=int(not items), **place))
    return items


def fly(g):
    assert g.upload(survey(g))[0] == 0
    g.run(2.0)
    if g.vehicle.kind == "px4":
        g.arm()
        assert g.set_mode(4, 4) == [0, 0]
    else:
        g.set_mode(4)
        g.arm()
        g.set_mode(3)
        g.command(M.MAV_CMD_MISSION_START)
    return g.run_until(lambda: g.vehicle.mission_current()[2] == 5)


def places(g):
    return np.array([shot.exposure.position_m for shot in g.vehicle.camera.shots])


def test_ardupilot_tells_of_an_exposure_at_each_distance(ardupilot):
    heard = fly(ardupilot)
    assert len(ardupilot.of("CAMERA_FEEDBACK", heard)) == len(places(ardupilot)) == 5
    assert np.diff(places(ardupilot)[:, 1]) == pytest.approx(EACH_M, abs=0.3)
    assert ardupilot.of("CAMERA_IMAGE_CAPTURED") == []


def test_px4_tells_of_captures_in_the_trigger_mode_for_it(make_ground):
    g = make_ground("px4", parameters=(("TRIG_MODE", 4),))
    heard = fly(g)
    assert len(g.of("CAMERA_IMAGE_CAPTURED", heard)) == len(places(g)) == 5
    assert np.diff(places(g)[:, 1]) == pytest.approx(EACH_M, abs=0.3)


def test_px4_without_it_only_passes_the_command_on(px4):
    heard = fly(px4)
    assert [m.param1 for m in px4.of("COMMAND_LONG", heard) if m.command == 206] == [EACH_M, 0.0]
    assert px4.vehicle.camera.shots == []


def test_without_a_camera_ardupilot_flies_the_mission_and_tells_of_nothing(make_ground):
    g = make_ground("ardupilot", parameters=(("CAM1_TYPE", 0),))
    assert g.of("CAMERA_FEEDBACK", fly(g)) == []
    assert g.vehicle.camera.shots == []
    assert g.command(M.MAV_CMD_DO_DIGICAM_CONTROL, 0, 0, 0, 0, 1) == [M.MAV_RESULT_FAILED]


def test_without_a_gimbal_ardupilot_points_nothing(make_ground):
    g = make_ground("ardupilot", parameters=(("MNT1_TYPE", 0),))
    assert g.command(M.MAV_CMD_DO_MOUNT_CONTROL, -35.0, 0, 0, 0, 0, 0, 2) == [M.MAV_RESULT_FAILED]
    g.run(2.0)
    assert g.vehicle.gimbal.pitch_rad == g.vehicle.gimbal.target_rad != pytest.approx(np.radians(-35.0))


def test_a_new_flight_takes_no_pictures_of_its_own(ardupilot):
    ardupilot.command(M.MAV_CMD_DO_SET_CAM_TRIGG_DIST, EACH_M, 0, 1)
    ardupilot.run(0.1)
    assert len(places(ardupilot)) == 1
    ardupilot.in_air(20.0)
    assert len(places(ardupilot)) == 1


def test_the_first_one_is_due_at_once_only_when_asked_for():
    for at_once in (False, True):
        trigger = DistanceTrigger(2.0, at_once=at_once)
        due = [trigger.is_due(np.array([x, 0.0, 0.0])) for x in np.arange(0.0, 5.1, 0.5)]
        assert [k * 0.5 for k, yes in enumerate(due) if yes] == ([0.0] if at_once else []) + [2.0, 4.0]
