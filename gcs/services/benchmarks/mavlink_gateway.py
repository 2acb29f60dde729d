"""Cases `gateway-100` and `gateway-signed-100`: a hundred vehicles on one station.

The station runs in this process as it does in `gcs serve`: vehicles are found, asked for their messages and watched,
and the telemetry of each is looked at five times a second, as it is for the dashboards.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.core.garbage import spare_what_is_loaded
from gcs.mavlink.signing import LinkSigning, new_key
from gcs.mavlink.station import MavlinkStation
from gcs.services.benchmarks.mavlink_traffic import traffic
from gcs.services.benchmarks.row import Row
from gcs.services.vehicle_service import PUBLISH_S

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

VEHICLES = 100
TYPICAL_PER_S = 8_700.0
MANY_PER_S = 20_000.0
WARM_UP_S, QUICK_WARM_UP_S = 9.0, 1.5
DRAIN_S = 0.3


@dataclass(frozen=True)
class GatewayLoad:
    """One run.

    Attributes:
        rate_per_s: messages heard a second while measured.
        core_share: processor time of the station's process, as a share of one core.
        lost: messages that were sent and not heard, over the whole run.
    """

    rate_per_s: float
    core_share: float
    lost: int


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: two seconds instead of ten, and few vehicles.
    """
    vehicles, seconds, warm_up_s = (5, 1.0, QUICK_WARM_UP_S) if quick else (VEHICLES, 10.0, WARM_UP_S)
    if not quick:
        spare_what_is_loaded()  # as `gcs serve` does
    runs = [("gateway-100", TYPICAL_PER_S, ""), ("gateway-100", MANY_PER_S, "-20000")]
    rows = []
    for case, rate_per_s, suffix in [*runs, ("gateway-signed-100", TYPICAL_PER_S, "")]:
        key = new_key() if case == "gateway-signed-100" else None
        load = asyncio.run(measure(vehicles, rate_per_s * vehicles / VEHICLES, seconds, warm_up_s, key))
        rows += [
            Row(case, f"core_share{suffix}", load.core_share, "1"),
            Row(case, f"lost{suffix}", float(load.lost), "1"),
            Row(case, f"rate_per_s{suffix}", load.rate_per_s, "1/s"),
        ]
    return rows


async def measure(vehicles: int, rate_per_s: float, seconds: float, warm_up_s: float, key: bytes | None) -> GatewayLoad:
    """Let vehicles send to a station and take the time that it needs.

    Args:
        vehicles: how many.
        rate_per_s: messages a second of all together.
        seconds: how long.
        warm_up_s: before that, in which the vehicles are found and asked.
        key: they sign with, and the station takes nothing that is not.
    """
    station = MavlinkStation()
    url = await station.open("udpin:127.0.0.1:0", None if key is None else LinkSigning(key))
    async with looking(station):
        with traffic(int(url.rsplit(":", 1)[1]), vehicles, rate_per_s, key) as sent:
            await asyncio.sleep(warm_up_s)
            heard, spent, begin = station.links[0].messages, time.process_time(), time.monotonic()
            await asyncio.sleep(seconds)
            wall = time.monotonic() - begin
            share, rate = (time.process_time() - spent) / wall, (station.links[0].messages - heard) / wall
        await asyncio.sleep(DRAIN_S)
    total = station.links[0].messages
    await station.close_all()
    return GatewayLoad(rate, share, sent[0] - total)


@asynccontextmanager
async def looking(station: MavlinkStation) -> AsyncIterator[None]:
    """Look at the telemetry of every vehicle as often as it is sent to dashboards, for the time of a block."""

    async def look() -> None:
        while True:
            for vehicle in station.vehicles.values():
                _ = vehicle.telemetry, vehicle.link_quality
            await asyncio.sleep(PUBLISH_S)

    task = asyncio.create_task(look())
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
