"""A vehicle whose satellites are hidden: it says so, drifts, comes down, and flies by positions that it is told."""

from concurrent.futures import Future

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.frames import GeoPoint
from sitl_mocks.ardupilot import ArduPilotVehicle
from sitl_mocks.channel import Channel
from sitl_mocks.px4 import Px4Vehicle
from sitl_mocks.scene_frame import e7
from sitl_mocks.vehicle_options import VehicleOptions

ANCHOR = GeoPoint(31.3622, 121.6155, 4.0)
HIDDEN = (((-50.0, -50.0, 3.0), (50.0, 50.0, 50.0)),)
KINDS = {"px4": Px4Vehicle, "ardupilot": ArduPilotVehicle}
READY = {"px4": (), "ardupilot": (("GPS2_TYPE", 14.0),)}
STEP_S = 0.02


class Flown:
    """A vehicle that climbs to 8 m and hovers there."""

    def __init__(self, kind, *, hidden=HIDDEN, parameters=(), seed=0):
        self.heard = []
        options = VehicleOptions(1, ANCHOR, ANCHOR, lambda _: Future(), seed, parameters, hidden=hidden)
        self.vehicle = KINDS[kind](options)
        self.kind = kind
        self.wall_s = 0.0
        channel = Channel(1, self.heard.append)
        channel.peer_is_station = True
        self.vehicle.add_channel(channel)
        self.channel = channel
        self.fly(3.0)
        self.vehicle.arm()
        self.vehicle.flight.take_off_to(8.0)

    def fly(self, seconds, tell=None):
        """Let time pass; `tell` makes a message that comes in ten times a second."""
        for step in range(round(seconds / STEP_S)):
            self.wall_s += STEP_S
            self.vehicle.step(STEP_S, self.wall_s)
            if tell is not None and step % 5 == 0:
                packet = tell().pack(mavlink.MAVLink(None, srcSystem=255))
                self.vehicle.handle(mavlink.MAVLink(None).decode(bytearray(packet)), self.channel)

    @property
    def error_m(self):
        airframe = self.vehicle.airframe
        return float(np.linalg.norm(airframe.position_m - airframe.true_position_m))

    def texts(self):
        messages = [mavlink.MAVLink(None).decode(bytearray(packet)) for packet in self.heard]
        return [m.text for m in messages if m.get_type() == "STATUSTEXT"]

    def true_place(self, *, moving=True):
        """What a perfect observer would have it told."""
        airframe, frame = self.vehicle.airframe, self.vehicle.frame
        place_m, (east, north, up) = airframe.true_position_m, airframe.true_velocity_m_s
        if self.kind == "px4":
            variances = [0.0] * 21
            variances[0] = variances[6] = variances[11] = 0.01
            return mavlink.MAVLink_vision_position_estimate_message(
                0, *frame.local_ned(place_m), 0.0, 0.0, 0.0, variances, 0
            )
        place_m = place_m - 0.2 * airframe.true_velocity_m_s  # it is taken for 0.2 s old
        place = frame.geo(place_m)
        return mavlink.MAVLink_gps_input_message(
            *(0, 1, 0 if moving else 0b11000, 0, 0, 3, e7(place.latitude_deg), e7(place.longitude_deg)),
            *(place.altitude_m, 1.0, 1.0, north, east, -up, 0.2, 0.1, 0.1, 10),
        )


@pytest.mark.parametrize("kind", KINDS)
def test_without_satellites_it_drifts_says_so_and_comes_down(kind):
    flown = Flown(kind)
    flown.fly(4.0)
    raw = flown.vehicle.telemetry.build(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT)
    assert (raw.fix_type, raw.satellites_visible) == (1, 3)
    status = flown.vehicle.telemetry.build(mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    assert not status.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_SENSOR_GPS
    assert any("GNSS" in text or "GPS" in text for text in flown.texts())
    assert flown.vehicle.mode.name != "LAND"
    errors = [flown.error_m]
    for _ in range(2):
        flown.fly(3.0)
        errors.append(flown.error_m)
    assert errors[0] < 0.5
    flown.fly(2.0)
    assert flown.vehicle.mode.name == "LAND"
    place = flown.vehicle.telemetry.build(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED)
    assert [place.y, place.x, -place.z] == pytest.approx(flown.vehicle.airframe.position_m, abs=0.1)


@pytest.mark.parametrize("kind", KINDS)
def test_below_the_hidden_box_it_has_its_fix_again(kind):
    flown = Flown(kind)
    flown.fly(60.0)
    assert not flown.vehicle.armed
    assert flown.error_m < 0.1
    assert flown.vehicle.telemetry.build(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT).fix_type >= 3


@pytest.mark.parametrize("kind", KINDS)
def test_it_flies_by_what_it_is_told(kind):
    flown = Flown(kind, parameters=READY[kind])
    flown.fly(4.0, flown.true_place)
    worst = 0.0
    for place in ([6.0, 0.0, 8.0], [6.0, 6.0, 9.0], [0.0, 0.0, 8.0]):
        flown.vehicle.flight.fly_to(np.array(place))
        for _ in range(60):
            flown.fly(0.1, flown.true_place)
            worst = max(worst, flown.error_m)
    assert worst < 0.5
    assert flown.vehicle.mode.name not in {"LAND"}
    assert np.linalg.norm(flown.vehicle.airframe.true_position_m - [0.0, 0.0, 8.0]) < 0.5


@pytest.mark.parametrize(
    ("kind", "parameters"), [("px4", (("EKF2_EV_CTRL", 0.0),)), ("ardupilot", (("GPS2_TYPE", 0.0),))]
)
def test_a_vehicle_that_is_not_set_up_for_it_uses_none(kind, parameters):
    flown = Flown(kind, parameters=parameters)
    flown.fly(14.0, flown.true_place)
    assert flown.vehicle.positioning.positions_taken == 0
    assert flown.vehicle.mode.name == "LAND"


def test_ardupilot_takes_a_velocity_that_is_left_out_for_standing_still():
    errors = {}
    for moving in (True, False):
        flown = Flown("ardupilot", parameters=READY["ardupilot"])
        flown.fly(4.0, flown.true_place)
        flown.vehicle.flight.fly_to(np.array([20.0, 0.0, 8.0]))
        flown.fly(3.0, lambda flown=flown, moving=moving: flown.true_place(moving=moving))
        errors[moving] = flown.error_m
    assert errors[False] > 2 * errors[True]


def test_without_hidden_boxes_nothing_changes():
    flown = Flown("px4", hidden=())
    flown.fly(6.0)
    assert flown.vehicle.positioning is None
    assert flown.error_m == 0.0


def test_what_it_believes_does_not_move_it():
    flown = Flown("px4", hidden=())
    flown.fly(6.0)
    airframe = flown.vehicle.airframe
    before = airframe.true_position_m
    error = np.array([1.0, -2.0, 0.5])
    airframe.believe(error, np.zeros(3))
    assert np.allclose(airframe.true_position_m, before)
    assert np.allclose(airframe.position_m, before + error)
    flown.fly(20.0)
    # It goes back to where it wants to be by its own belief: that far off in truth.
    assert np.allclose(airframe.true_position_m, before - error, atol=0.1)
