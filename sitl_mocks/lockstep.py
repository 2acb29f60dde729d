"""Many small worlds for a station that tests itself: `python -m sitl_mocks.lockstep` on standard input and output.

Time is fake and each world has its own: it stands still while the station thinks. A line of input is a JSON list of
orders, a line of output the list of their answers:

    ["open", WORLD, {fields of WorldSpec}]          -> null
    ["open-picture", WORLD, {fields of PictureSpec}] -> null
    ["open-cooperative", WORLD, {fields of CooperativeSpec}] -> null
    ["open-flight", WORLD, {fields of FlightSpec}]  -> null
    ["pass", WORLD, UNTIL_S, [HEX PACKET, ...]]     -> [NOW_S, [HEX PACKET, ...]]: see `MissionWorld.pass_time`
    ["fly", WORLD, UNTIL_S, {END: [HEX PACKET, ...]}] -> [NOW_S, {END: [HEX PACKET, ...]}]: see `FlightWorld.fly`
    ["truth", WORLD, ITEMS or null]                 -> {...}: see `MissionWorld.truth`; the world is gone afterwards
    ["faults"]                                      -> the names of all faults
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any, Protocol

from sitl_mocks.mission_faults import FAULTS
from sitl_mocks.mission_world import MissionWorld, WorldSpec
from sitl_mocks.picture_world import PictureSpec, PictureWorld


class World(Protocol):
    """What can be simulated."""

    def pass_time(self, until_s: float, packets: Sequence[bytes]) -> tuple[float, list[bytes]]:
        """Send packets, and let time pass until the station hears something, or until a time."""
        ...

    def truth(self, told: Any, /) -> dict[str, Any]:
        """What is so, beside what the station says."""
        ...


def answer(worlds: dict[int, Any], order: list[Any]) -> Any:
    """Carry out one order; what it gives must be fit for JSON."""
    name, *arguments = order
    if name == "faults":
        return list(FAULTS)
    if name == "open":
        number, spec = arguments
        worlds[number] = MissionWorld(WorldSpec(**spec))
        return None
    if name == "open-picture":
        number, spec = arguments
        worlds[number] = PictureWorld(PictureSpec(**spec))
        return None
    if name == "pass":
        number, until_s, packets = arguments
        now_s, heard = worlds[number].pass_time(until_s, [bytes.fromhex(packet) for packet in packets])
        return [now_s, [packet.hex() for packet in heard]]
    if name == "open-flight":
        from sitl_mocks.flight_world import FlightSpec, FlightWorld  # loads what flies: slow

        number, spec = arguments
        worlds[number] = FlightWorld(FlightSpec(**spec))
        return None
    if name == "fly":
        number, until_s, sent = arguments
        now_s, at_ends = worlds[number].fly(
            until_s, {end: [bytes.fromhex(packet) for packet in packets] for end, packets in sent.items()}
        )
        return [now_s, {end: [packet.hex() for packet in packets] for end, packets in at_ends.items()}]
    if name == "open-cooperative":
        from sitl_mocks.cooperative_world import CooperativeSpec, CooperativeWorld  # loads what flies: slow

        number, spec = arguments
        worlds[number] = CooperativeWorld(CooperativeSpec(**spec))
        return None
    number, read = arguments
    return worlds.pop(number).truth(read)


def main() -> None:
    """Answer until the input ends."""
    worlds: dict[int, Any] = {}
    for line in sys.stdin:
        print(json.dumps([answer(worlds, order) for order in json.loads(line)]), flush=True)


if __name__ == "__main__":
    main()
