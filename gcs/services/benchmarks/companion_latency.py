"""Case `latency`: from a lidar message to the setpoint that follows from it, on a busy machine.

A simulated vehicle is led by a companion among obstacles, in processes of their own. This process is the station that
follows the flight, and passes the companion's link on: so it knows when each scan went off to the companion. Beside it
one more process makes a plan over and over. The companion's process says when what follows from a scan was sent. One
more gets the same scans at the same time and does nothing but note when: what the machine gives anybody.
"""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.progress import SilentProgress
from gcs.mavlink.framing import FrameParser
from gcs.services.benchmarks.mavlink_offboard import beside
from gcs.services.benchmarks.random_obstacles import random_obstacles
from gcs.services.benchmarks.row import Row
from gcs.services.benchmarks.wall_plan import ANCHOR, HOME_M, WALL_M, wall_plan
from gcs.services.companion.companion_options import CompanionOptions
from gcs.services.companion.process import run_companion
from gcs.services.plan_writing import write_certified
from gcs.services.simulation import Simulator, SimulatorOptions
from gcs.services.station import StationServices
from gcs.storage.records import FlightPath, FlightState
from gcs.storage.solid_shapes import box, structure_of_solids

if TYPE_CHECKING:
    from gcs.mavlink.received_message import ReceivedMessage
    from gcs.services.benchmarks.random_obstacles import Spec
    from gcs.services.benchmarks.wall_plan import WallPlan

SCAN = "OBSTACLE_DISTANCE"
ASKED_MS = 50.0
LEADS_WITHIN_S = 120.0
OBSTACLE_SEEDS = (3, 8, 11, 19, 24)
"""Of so many random worlds all obstacles are there at once."""


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: three seconds instead of thirty, and no other work on the machine.
    """
    with TemporaryDirectory(prefix="gcs-latency-") as scratch:
        ours_ms, bare_ms = asyncio.run(_measure(Path(scratch), 3.0 if quick else 30.0, [] if quick else ["plan"]))
    return [
        *(
            Row("latency", f"p{share}_ms", float(np.percentile(ours_ms, share)), "ms", "asked", asked)
            for share, asked in ((50, None), (99, ASKED_MS))
        ),
        Row("latency", "bare_p99_ms", float(np.percentile(bare_ms, 99)), "ms"),
    ]


class _PassedOn(asyncio.DatagramProtocol):
    """The companion's link, with the times at which scans went through it.

    Args:
        bare: port of the process that gets the scans beside the companion.
    """

    def __init__(self, bare: int) -> None:
        self._bare = ("127.0.0.1", bare)
        self.scans: dict[int, float] = {}
        self._parser = FrameParser()
        self._vehicle: Any = None
        self._companion: Any = None
        self._transport: Any = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The socket is open."""
        self._transport = transport

    @property
    def port(self) -> int:
        """Of the socket."""
        return int(self._transport.get_extra_info("sockname")[1])

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Pass on: the companion speaks first, with its greeting; all else is the vehicle's."""
        if self._companion is None and _is_companions(data):
            self._companion = addr
        if addr == self._companion:
            if self._vehicle is not None:
                self._transport.sendto(data, self._vehicle)
            return
        self._vehicle = addr
        for message in self._parser.feed(data):
            if message.get_type() == SCAN:
                self.scans[int(message.time_usec)] = time.monotonic()
                self._transport.sendto(data, self._bare)
        if self._companion is not None:
            self._transport.sendto(data, self._companion)


def _is_companions(data: bytes) -> bool:
    return any(message.get_srcComponent() == 191 for message in FrameParser().feed(data))


async def _measure(scratch: Path, seconds: float, others: list[str]) -> tuple[list[float], list[float]]:
    """Delays (ms) of the scans of a while, of the companion and of the bare loop."""
    made = wall_plan()
    folder = scratch / "plan"
    write_certified(made.plan, structure_of_solids([box(*WALL_M)]), folder, SilentProgress())
    home = GeoPoint(*(float(c) for c in geodetic_from_enu(made.plan.scenario.home_m, GeoPoint(*ANCHOR))))
    services = StationServices(scratch / "station", stored_links=False)
    with ExitStack() as running:
        bare = running.enter_context(_process("bare"))
        running.callback(bare.terminate)
        assert bare.stdout is not None  # it is a pipe
        bare_port = int(await asyncio.to_thread(bare.stdout.readline))
        transport, passed_on = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: _PassedOn(bare_port), local_addr=("127.0.0.1", 0)
        )
        running.callback(transport.close)
        async with services.running(_nothing):
            url = await services.vehicles.station.open("udpin:127.0.0.1:0")
            obstacles = scratch / "obstacles.json"
            obstacles.write_text(json.dumps({"obstacles": _obstacles(made)}), encoding="utf-8")
            extra = ("--companion", str(passed_on.port), "--tcp-base", "none", "--obstacles", str(obstacles))
            port, anchor = int(url.rsplit(":", 1)[1]), GeoPoint(*ANCHOR)
            running.enter_context(Simulator(SimulatorOptions(port=port, home=home, anchor=anchor, extra=extra)))
            companion = running.enter_context(_process(f"udpout:127.0.0.1:{passed_on.port}", str(folder), str(scratch)))
            running.callback(companion.terminate)
            await _lead(services, folder)
            for what in others:
                running.enter_context(beside(what))
            begin_s = time.monotonic()
            await asyncio.sleep(seconds)
            end_s = time.monotonic()
            told = [await asyncio.to_thread(_last_words, process) for process in (companion, bare)]
    within = {stamp: at_s for stamp, at_s in passed_on.scans.items() if begin_s <= at_s < end_s}
    ours, others_s = ([1e3 * (at[stamp] - at_s) for stamp, at_s in within.items() if stamp in at] for at in told)
    return ours, others_s


def _obstacles(made: WallPlan) -> list[Spec]:
    """What stands and moves about the way, as in an obstacle file; it goes to and fro for ever."""
    plan = made.plan
    way_m = plan.trajectory.value(np.arange(0.0, plan.trajectory.duration_s, 0.2))
    viewpoints_m = np.array([viewpoint.position_m for viewpoint in plan.viewpoints])
    drawn = [
        obstacle
        for seed in OBSTACLE_SEEDS
        for obstacle in random_obstacles(
            np.random.default_rng(seed), way_m, np.asarray(HOME_M), viewpoints_m, plan.scenario.centre_clearance_m
        )
    ]
    return [
        {key: value for key, value in obstacle.items() if key != "name"} | {"repeats": len(obstacle["path_m"]) > 1}
        for obstacle in drawn
    ]


def _process(*arguments: str) -> subprocess.Popen[str]:
    line = [sys.executable, "-m", __name__, *arguments]
    return subprocess.Popen(line, stdout=subprocess.PIPE, text=True)


def _last_words(process: subprocess.Popen[str]) -> dict[int, float]:
    """End a process, and read when it was done with each scan."""
    process.terminate()
    told, _ = process.communicate()
    return {int(stamp): at_s for stamp, at_s in json.loads(told.splitlines()[-1]).items()}


def _nothing(told: object) -> str:
    """Nobody reads along."""
    del told
    return ""


def _unread(line: str) -> None:
    """Nobody reads this either."""


async def _lead(services: StationServices, plan: Path) -> None:
    """Start the flight, and wait until the companion leads."""
    vehicle = await services.vehicles.station.wait_for_vehicle(30.0)
    await vehicle.request_position_references(60.0)
    plan_id = services.plans.adopt(plan).plan.id
    flight = await services.flights.create(plan_id, vehicle.identity.name, FlightPath.COMPANION)
    await services.flights.start(flight.id, confirm=vehicle.identity.name, accept=())
    async with asyncio.timeout(LEADS_WITHIN_S):
        while services.database.flights.get(flight.id).state is not FlightState.FLYING:  # noqa: ASYNC110
            await asyncio.sleep(0.1)


def _companion(url: str, plan: Path, keep: Path) -> None:
    """Run one, and print in the end when what follows from each scan was sent."""
    sent: dict[int, float] = {}

    def taken(message: ReceivedMessage) -> None:
        if message.get_type() == SCAN:
            sent[int(message.time_usec)] = time.monotonic()

    async def until_terminated() -> None:
        ended = asyncio.Event()
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, ended.set)
        running = asyncio.create_task(
            run_companion(
                url,
                station=None,
                token_file=None,
                keep=keep / "kept",
                plans=(plan,),
                options=CompanionOptions(),
                say=_unread,
                on_taken=taken,
            )
        )
        await asyncio.wait({running, asyncio.create_task(ended.wait())}, return_when=asyncio.FIRST_COMPLETED)
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running

    asyncio.run(until_terminated())
    print(json.dumps(sent))


def _bare() -> None:
    """Print a port, note when each scan came there, and print that in the end."""
    came: dict[int, float] = {}
    parser = FrameParser()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as door:
        door.bind(("127.0.0.1", 0))
        print(door.getsockname()[1], flush=True)
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        with suppress(KeyboardInterrupt):
            while True:
                for message in parser.feed(door.recv(65536)):
                    if message.get_type() == SCAN:
                        came[int(message.time_usec)] = time.monotonic()
    print(json.dumps(came))


if __name__ == "__main__":
    if sys.argv[1] == "bare":
        _bare()
    else:
        _companion(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
