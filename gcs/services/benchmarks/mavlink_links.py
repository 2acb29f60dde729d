"""Cases `link-5` to `link-30`: uploads of 50 items over a lossy link with a round trip of 50 ms, beside MAVSDK's.

Both clients send to the same simulated vehicle, in real time, over links that lose packets by the same seed: `seconds`
is the median of the transfers alone, `proof_seconds` what the proof takes besides. How often an upload succeeds within
120 s, repeated ones included, is counted on fake time over 200 links.
"""

from __future__ import annotations

import asyncio
import json
import random
import socket
import statistics
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import IO, TYPE_CHECKING

from gcs.core.errors import GcsError
from gcs.core.vehicle import Autopilot
from gcs.mavlink.mission_proof import MissionPeer, upload_and_prove
from gcs.mavlink.station import MavlinkStation
from gcs.services.benchmarks.lockstep_worlds import STATION, LockstepWorlds, Order, WorldLink
from gcs.services.benchmarks.mavlink_missions import random_mission, wire_items
from gcs.services.benchmarks.row import Row

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gcs.core.mission import Mission

LOSSES = {"link-5": 0.05, "link-10": 0.1, "link-20": 0.2, "link-30": 0.3}
ITEMS = 50
LATENCY_S = 0.025
PAIRS, UPLOADS = {"link-5": 20, "link-20": 20, "link-30": 20}, 200
QUICK_PAIRS, QUICK_UPLOADS = {"link-5": 1}, 10
AT_ONCE = 10
WITHIN_S = 120.0
MAVSDK = "mavsdk"
_MAVSDK_MODULE = "gcs.mavlink.mavsdk_upload"
_FOUND_WITHIN_S = 30.0


@dataclass(frozen=True)
class Pair:
    """One upload by each client over the same link; None where it failed, or was not run.

    Attributes:
        transfer_s: ours, without the proof.
        proof_s: of ours.
        mavsdk_s: MAVSDK's.
    """

    transfer_s: float | None
    proof_s: float | None
    mavsdk_s: float | None


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: one pair, and few uploads on fake time.
    """
    rows: list[Row] = []
    for case, loss in LOSSES.items():
        with _vehicles() as orders:
            pairs = asyncio.run(_pairs(loss, (QUICK_PAIRS if quick else PAIRS).get(case, 0), orders))
        count = QUICK_UPLOADS if quick else UPLOADS
        with LockstepWorlds() as worlds:
            proved = sum(worlds.run_all(_proved_in_time(loss, seed) for seed in range(count)))
        rows += _rows(case, pairs, proved / count)
    return rows


def _rows(case: str, pairs: list[Pair], success: float) -> Iterator[Row]:
    ours = [pair.transfer_s for pair in pairs if pair.transfer_s is not None]
    theirs = [pair.mavsdk_s for pair in pairs if pair.mavsdk_s is not None]
    both = [p.transfer_s / p.mavsdk_s for p in pairs if p.transfer_s is not None and p.mavsdk_s is not None]
    if ours:
        median = statistics.median(theirs) if theirs else None
        yield Row(case, "seconds", statistics.median(ours), "s", MAVSDK, median)
    if both:
        yield Row(case, "seconds_ratio", statistics.median(both), "1")
    if proofs := [pair.proof_s for pair in pairs if pair.proof_s is not None]:
        yield Row(case, "proof_seconds", statistics.median(proofs), "s")
    their_success = len(theirs) / len(pairs) if pairs and find_spec("mavsdk") is not None else None
    yield Row(case, "success", success, "1", MAVSDK, their_success)


async def _pairs(loss: float, count: int, orders: IO[str]) -> list[Pair]:
    places = asyncio.Semaphore(AT_ONCE)

    async def pair(seed: int) -> Pair:
        async with places:
            mission = random_mission(Autopilot.PX4, random.Random(seed), ITEMS)
            transfer_s, proof_s = await _ours(mission, loss, seed, orders)
            return Pair(transfer_s, proof_s, await _mavsdk(mission, loss, seed, orders))

    return list(await asyncio.gather(*(pair(seed) for seed in range(count))))


async def _ours(mission: Mission, loss: float, seed: int, orders: IO[str]) -> tuple[float | None, float | None]:
    station = MavlinkStation()
    try:
        url = await station.open("udpin:127.0.0.1:0")
        _order_vehicle(int(url.rsplit(":", 1)[1]), loss, seed, orders)
        vehicle = await station.wait_for_vehicle(_FOUND_WITHIN_S)
        proof = await vehicle.upload_mission(mission)
    except GcsError:
        return None, None
    finally:
        await station.close_all()
    return proof.transfer_s, proof.proof_s


async def _mavsdk(mission: Mission, loss: float, seed: int, orders: IO[str]) -> float | None:
    if find_spec("mavsdk") is None:
        return None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    client = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", _MAVSDK_MODULE, str(port)),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    _order_vehicle(port, loss, seed, orders)
    told, _ = await client.communicate(json.dumps(wire_items(mission)).encode())
    for line in told.decode().splitlines():
        if line.startswith("{"):
            answer = json.loads(line)
            return float(answer["seconds"]) if answer["ok"] else None
    return None


@contextmanager
def _vehicles() -> Iterator[IO[str]]:
    """A process that makes a vehicle of each order that is written to it."""
    command = [sys.executable, "-m", "sitl_mocks.mission_vehicles"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, text=True) as process:
        if process.stdin is None:
            raise RuntimeError("the process has no input")
        yield process.stdin


def _order_vehicle(port: int, loss: float, seed: int, orders: IO[str]) -> None:
    orders.write(f"{port} {loss} {LATENCY_S} {seed}\n")
    orders.flush()


async def _proved_in_time(loss: float, seed: int) -> bool:
    """Whether an upload on fake time is proved within 120 s, repeated ones included."""
    mission = random_mission(Autopilot.PX4, random.Random(seed), ITEMS)
    spec = {"autopilot": "px4", "faults": [], "seed": seed, "loss": loss, "plan": wire_items(mission), "held": []}
    await Order("open", seed, {**spec, "latency_s": LATENCY_S, "jitter_s": 0.0})
    link = WorldLink(seed)
    peer = MissionPeer(1, 1, Autopilot.PX4, link.send, link.clock, link.run, own_system=STATION[0])
    proved = False
    while not proved and link.now_s < WITHIN_S:
        try:
            await upload_and_prove(mission, peer)
            proved = True
        except GcsError:
            continue
    proved = proved and link.now_s <= WITHIN_S
    return proved and (await link.truth())["held"]
