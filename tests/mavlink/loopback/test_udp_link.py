import asyncio
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.link_url import parse_link_url
from gcs.mavlink.udp_link import THICK_PER_S, UdpLink

FLOOD = 2000


class Ear:
    """A link and what it heard; its clock goes on by what it hears, `per_s` datagrams a second on any machine."""

    def __init__(self, per_s):
        self.heard = []
        self.more = asyncio.Event()
        self.link = UdpLink(parse_link_url("udpin:127.0.0.1:0"), (255, 190), self.hear, lambda: len(self.heard) / per_s)
        self.speaker = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def hear(self, link, peer, message):
        self.heard.append(message.time_boot_ms)
        self.more.set()

    def say(self, number):
        self.speaker.send(mavlink.MAVLink_system_time_message(0, number).pack(mavlink.MAVLink(None)))

    async def flood(self):
        await self.link.open()
        self.speaker.connect(("127.0.0.1", self.link.address.number))
        for number in range(FLOOD):
            self.say(number)
            if number % 100 == 99:
                await asyncio.sleep(0.001)

    async def until_heard(self, count):
        async with asyncio.timeout(60.0):
            while len(self.heard) < count:
                self.more.clear()
                await self.more.wait()


@pytest.fixture
async def ear():
    made = []

    def make(per_s):
        made.append(Ear(per_s))
        return made[-1]

    yield make
    for each in made:
        await each.link.close()
        each.speaker.close()


@pytest.fixture
async def looks_away(monkeypatch):
    """How often the event loop was told to watch a socket no more."""
    loop, times = asyncio.get_running_loop(), []
    remove = loop.remove_reader
    monkeypatch.setattr(loop, "remove_reader", lambda number: times.append(number) or remove(number))
    return times


@pytest.mark.parametrize("per_s", [THICK_PER_S / 2, THICK_PER_S * 2], ids=["thin", "thick"])
async def test_a_flood_is_taken_whole_and_in_order_and_so_is_what_comes_after_it(ear, looks_away, per_s):
    one = ear(per_s)
    await one.flood()
    await one.until_heard(FLOOD)
    assert one.heard == list(range(FLOOD))
    assert bool(looks_away) == (per_s > THICK_PER_S)
    one.say(7)
    await one.until_heard(FLOOD + 1)


async def test_a_link_that_lets_datagrams_gather_is_closed_for_good(ear, looks_away):
    one = ear(THICK_PER_S * 2)
    await one.flood()
    await one.until_heard(FLOOD)
    assert looks_away
    await one.link.close()
    one.say(7)
    await asyncio.sleep(0.05)
    assert len(one.heard) == FLOOD
