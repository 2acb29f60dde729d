"""A whole vehicle on fake time, by the orders of the lockstep process."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import InputError
from sitl_mocks.lockstep import answer

M = mavlink
SPEC = {"autopilot": "px4", "seed": 3, "anchor": [31.3622, 121.6155, 4.0], "home": [31.36201962, 121.61528979, 4.0]}
CRATE = {"kind": "vehicle", "path_m": [[-20.0, -14.0]], "radius_m": 1.0, "height_m": 9.0}


class End:
    def __init__(self, system, component):
        self._packer = M.MAVLink(None, srcSystem=system, srcComponent=component)
        self._parser = M.MAVLink(None)
        self.outbox, self.heard = [], []

    def send(self, message):
        self.outbox.append(bytes(message.pack(self._packer)).hex())

    def hear(self, packets):
        for packet in packets:
            self.heard += self._parser.parse_buffer(bytes.fromhex(packet)) or []


class Flight:
    def __init__(self, **changes):
        self.worlds = {}
        assert answer(self.worlds, ["open-flight", 1, {**SPEC, **changes}]) is None
        self.ends = {"station": End(255, 190), "companion": End(1, 191)}
        self.now_s = 0.0

    def run(self, until_s):
        while self.now_s < until_s:
            sent = {name: end.outbox for name, end in self.ends.items()}
            for end in self.ends.values():
                end.outbox = []
            self.now_s, heard = answer(self.worlds, ["fly", 1, until_s, sent])
            for name, end in self.ends.items():
                end.hear(heard[name])

    def of(self, name, kind):
        return [m for m in self.ends[name].heard if m.get_type() == kind]


def take_off(flight):
    flight.run(4.0)
    command = M.MAVLink_command_long_message
    flight.ends["station"].send(command(1, 1, M.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0))
    flight.run(4.5)
    nan = math.nan
    flight.ends["station"].send(command(1, 1, M.MAV_CMD_NAV_TAKEOFF, 0, nan, 0, 0, nan, nan, nan, 9.0))
    flight.run(15.0)


def test_a_flight_with_truth_at_its_end_and_lidar_for_the_companion_alone():
    flight = Flight(obstacles=[CRATE])
    take_off(flight)
    assert not flight.of("station", "OBSTACLE_DISTANCE")
    ahead = flight.of("companion", "OBSTACLE_DISTANCE")[-1].distances[0]
    assert ahead == pytest.approx(500, abs=12)
    flight.ends["companion"].send(M.MAVLink_command_long_message(1, 100, 2000, 0, 0, 0, 1, 1, 0, 0, 0))
    flight.run(16.0)
    truth = answer(flight.worlds, ["truth", 1, None])
    assert truth["obstacles"]["least_distance_m"] == pytest.approx(4.5, abs=0.1)
    assert truth["mode"] == "AUTO.LOITER" and not truth["obstacles"]["touched"]
    (shot,) = truth["shots"]
    assert shot["position_m"] == pytest.approx([-20.0, -20.0, 5.0], abs=0.3)
    assert not flight.worlds


def test_the_links_lose_and_delay_and_a_seed_gives_the_same_flight_again():
    flights = [Flight(loss=0.3, latency_s=0.1) for _ in range(2)]
    for flight in flights:
        flight.run(10.0)
    beats = [[m.get_seq() for m in flight.of("companion", "HEARTBEAT")] for flight in flights]
    assert beats[0] == beats[1]
    whole = Flight()
    whole.run(10.0)
    assert len(flights[0].ends["companion"].heard) < 0.85 * len(whole.ends["companion"].heard)


def test_wrong_obstacles_are_refused():
    with pytest.raises(InputError, match="radius_m"):
        Flight(obstacles=[{**CRATE, "radius_m": -1}])
