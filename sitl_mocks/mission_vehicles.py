"""Vehicles that hold a mission and do nothing else, in real time: `python -m sitl_mocks.mission_vehicles`.

For measuring transfers beside each other: many of them cost little. A line of standard input, `PORT LOSS LATENCY_S
SEED`, makes one that sends to that UDP port of this machine over a link of its own. The process ends with its input.
"""

from __future__ import annotations

import os
import selectors
import sys
import time

from sitl_mocks.channel import Channel, LinkFaults
from sitl_mocks.dialect import AUTOPILOT_COMPONENT, Message, mavlink
from sitl_mocks.links import UdpLink
from sitl_mocks.px4_mission_server import Px4MissionServer

_BEAT_S = 0.5
_SYSTEM_ID = 1
_LONGEST_WAIT_S = 0.1
_MOST_INPUT = 65536


class MissionVehicle:
    """A PX4 as far as missions go, with the link to its station.

    Args:
        port: of the station, on this machine.
        faults: of the link.
        seed: of the faults.
    """

    def __init__(self, port: int, faults: LinkFaults, seed: int) -> None:
        self._server = Px4MissionServer(lambda _severity, _text: None, lambda: None, lambda: 0)
        self._beat_s = 0.0
        self.link = UdpLink(_SYSTEM_ID, ("127.0.0.1", port), faults, seed, self._take, time.monotonic)

    def read(self) -> None:
        """Take what has come in."""
        for wall_s, data in self.link.read():
            self.link.deliver(data, wall_s)

    @property
    def next_s(self) -> float:
        """Wall time at which `step` has something to do."""
        return min(self.link.next_s, self._server.next_s, self._beat_s)

    def step(self, wall_s: float) -> None:
        """Do what is due."""
        self.link.release(wall_s)
        self._server.step(wall_s)
        if wall_s >= self._beat_s:
            self._beat_s = wall_s + _BEAT_S
            beat = mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 0, 0, mavlink.MAV_STATE_STANDBY, 3
            )
            self.link.channel.send(beat, AUTOPILOT_COMPONENT)

    def _take(self, message: Message, channel: Channel) -> None:
        if getattr(message, "target_system", 0) == _SYSTEM_ID:
            self._server.handle(message, lambda m: channel.send(m, AUTOPILOT_COMPONENT), time.monotonic())


def main() -> None:
    """Run until the input ends."""
    vehicles: list[MissionVehicle] = []
    selector = selectors.DefaultSelector()
    selector.register(sys.stdin, selectors.EVENT_READ)
    rest = b""
    while True:
        wait_s = min((vehicle.next_s for vehicle in vehicles), default=_LONGEST_WAIT_S) - time.monotonic()
        for key, _ in selector.select(min(max(wait_s, 0.0), _LONGEST_WAIT_S)):
            if isinstance(key.data, MissionVehicle):
                key.data.read()
            elif data := os.read(sys.stdin.fileno(), _MOST_INPUT):
                *lines, rest = (rest + data).split(b"\n")
                for vehicle in map(_made, lines):
                    vehicles.append(vehicle)
                    selector.register(vehicle.link.socket, selectors.EVENT_READ, vehicle)
            else:
                return
        now_s = time.monotonic()
        for vehicle in vehicles:
            vehicle.step(now_s)


def _made(line: bytes) -> MissionVehicle:
    port, loss, latency_s, seed = line.split()
    return MissionVehicle(int(port), LinkFaults(loss=float(loss), latency_s=float(latency_s)), int(seed))


if __name__ == "__main__":
    main()
