"""Cooperative positioning between two vehicles as the station has them: the checks before, and the running itself."""

import asyncio
import contextlib
from types import SimpleNamespace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import LinkError, RefusedError
from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.vehicle import Heard, Telemetry
from gcs.services.sighted_flight import SightedFlight
from sitl_mocks.sighting_sensor import SensorErrors, range_pitch_azimuth, sighting

ORIGIN = GeoPoint(31.3622, 121.6155, 4.0)
OBSERVER_M, SEEN_M = np.array([0.0, -20.0, 9.0]), np.array([1.0, 2.0, 6.0])
NOW_S = 100.0


class Vehicle:
    def __init__(self, system, *, lag_s=0.2, link="own", connected=True):
        self.identity = SimpleNamespace(name=f"px4-{system}", system_id=system, component_id=1)
        self.connected = connected
        self.lag_s = lag_s
        self.link = f"{link} {system if link == 'own' else ''}"
        self.told = asyncio.Queue()
        self.queue = asyncio.Queue()
        self.link_quality = SimpleNamespace(round_trip_s=0.1)
        self.clock = SimpleNamespace(rate=1.0)
        fix = Heard(1, NOW_S)
        self.telemetry = Telemetry(gps_fix=fix, origin=Heard(ORIGIN, NOW_S), local_position_m=Heard(SEEN_M, NOW_S))

    async def read_position_lag(self):
        if self.lag_s is None:
            raise RefusedError("set something")
        return self.lag_s

    def shares_link_with(self, other):
        return self.link == other.link

    def vehicle_now(self):
        return NOW_S

    def tell_position(self, fix):
        self.told.put_nowait(fix)

    @contextlib.asynccontextmanager
    async def messages(self):
        async def heard():
            while True:
                yield await self.queue.get()

        yield heard()


def flight(observer, seen):
    return SightedFlight(observer, seen, lambda _: None, lambda: NOW_S)


async def test_the_check_lets_a_fit_pair_pass():
    pair = flight(Vehicle(2, lag_s=None), Vehicle(1))
    await pair.check()
    assert pair.lag_s == 0.2
    assert pair.source is None
    await flight(Vehicle(2), Vehicle(1)).check()  # each on a link of its own


async def test_the_check_refuses_what_would_not_work():
    same = Vehicle(1)
    with pytest.raises(RefusedError, match="own observer"):
        await flight(same, same).check()
    with pytest.raises(LinkError, match="not heard"):
        await flight(Vehicle(2, connected=False), Vehicle(1)).check()
    with pytest.raises(RefusedError, match="set something"):
        await flight(Vehicle(2), Vehicle(1, lag_s=None)).check()


async def test_on_one_link_an_observer_that_would_take_the_positions_too_is_refused():
    with pytest.raises(RefusedError, match="for its own"):
        await flight(Vehicle(2, link="radio"), Vehicle(1, link="radio")).check()
    await flight(Vehicle(2, link="radio", lag_s=None), Vehicle(1, link="radio")).check()


async def test_what_the_observer_sees_is_told_for_the_moment_at_which_it_is_taken():
    observer, seen = Vehicle(2), Vehicle(1)
    pair = flight(observer, seen)
    await pair.check()
    latitude, longitude, altitude = (float(c) for c in geodetic_from_enu(OBSERVER_M, ORIGIN))
    boot_ms = round(NOW_S * 1e3) - 50
    place = (boot_ms, round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1e3), 0, 0, 0, 0, 0)
    running = asyncio.create_task(pair.run())
    for message in (
        mavlink.MAVLink_gps_raw_int_message(0, 6, 1, 1, 0, 0, 0, 0, 0, 14, h_acc=20, v_acc=30),
        mavlink.MAVLink_global_position_int_message(*place),
        mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3),
        sighting(boot_ms, 1, range_pitch_azimuth(SEEN_M - OBSERVER_M), SensorErrors()),
    ):
        packet = message.pack(mavlink.MAVLink(None, srcSystem=2, srcComponent=1))
        observer.queue.put_nowait(mavlink.MAVLink(None).decode(bytearray(packet)))
    fix = await asyncio.wait_for(seen.told.get(), 30.0)
    running.cancel()
    assert np.allclose(fix.position_m, SEEN_M, atol=0.02)
    assert fix.at_vehicle_s == pytest.approx(NOW_S + 0.05 - 0.2)  # half the round trip ahead, less what it is taken for
    assert "px4-2" in pair.source
