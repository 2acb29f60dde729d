"""Case `offboard-50hz`: how evenly setpoints go out while the station and the machine are busy.

In this process a station hears a hundred vehicles and looks at their telemetry, and streams setpoints over a link of
its own; the system says when each arrived at its other end. Beside it a process computes a plan over and over, as a
planning job does, and two processes spin. A bare loop that sleeps for 20 ms at a time, in one more process at the same
time, says what the machine gives anybody.
"""

from __future__ import annotations

import asyncio
import json
import os
import socket
import struct
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING

import numpy as np

from gcs.jobs.planning_jobs import NICENESS
from gcs.mavlink.events import OffboardEnd
from gcs.mavlink.link_url import parse_link_url
from gcs.mavlink.links import make_link
from gcs.mavlink.offboard import OffboardSession, Setpoint, SetpointStream
from gcs.mavlink.station import MavlinkStation
from gcs.services.benchmarks.mavlink_gateway import QUICK_WARM_UP_S, TYPICAL_PER_S, VEHICLES, WARM_UP_S, looking
from gcs.services.benchmarks.mavlink_traffic import traffic
from gcs.services.benchmarks.row import Row

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gcs.mavlink.link_base import Link

RATE_HZ = 50.0
DEADMAN_S = 2.0
SO_TIMESTAMPNS = 35
"""Linux's option that has it tell when it took each datagram in, which over loopback is when that was sent."""


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: two seconds instead of thirty, few vehicles, and nothing else on the machine.
    """
    if quick:
        ours, bare = asyncio.run(_measure(5, 2.0, QUICK_WARM_UP_S, []))
    else:
        ours, bare = asyncio.run(_measure(VEHICLES, 30.0, WARM_UP_S, ["spin", "spin", "plan"]))
    return [
        Row("offboard-50hz", "p99_ms", _p99_error_ms(ours), "ms", "bare sleep loop", _p99_error_ms(bare)),
        Row("offboard-50hz", "longest_gap_ms", _longest_ms(ours), "ms", "bare sleep loop", _longest_ms(bare)),
        Row("offboard-50hz", "setpoints", float(len(ours)), "1"),
    ]


def _p99_error_ms(times_s: list[float]) -> float:
    return 1e3 * float(np.percentile(np.abs(np.diff(times_s) - 1.0 / RATE_HZ), 99))


def _longest_ms(times_s: list[float]) -> float:
    return 1e3 * float(np.max(np.diff(times_s)))


async def _measure(
    vehicles: int, seconds: float, warm_up_s: float, others: list[str]
) -> tuple[list[float], list[float]]:
    """Times at which setpoints were sent, and at which the bare loop woke."""
    station = MavlinkStation()
    url = await station.open("udpin:127.0.0.1:0")
    with ExitStack() as running:
        rate_per_s = TYPICAL_PER_S * vehicles / VEHICLES
        running.enter_context(traffic(int(url.rsplit(":", 1)[1]), vehicles, rate_per_s))
        async with looking(station):
            await asyncio.sleep(warm_up_s)
            for what in others:
                running.enter_context(beside(what))
            bare = running.enter_context(beside("sleep", str(seconds)))
            ours = await _stream(seconds)
            told = await asyncio.to_thread(bare.communicate)
    await station.close_all()
    return ours, json.loads(told[0])


def _nobody(link: Link, peer: object, message: object) -> None:
    """What comes back on the setpoints' link is of no concern."""


async def _stream(seconds: float) -> list[float]:
    """Stream setpoints for a while; the times at which each arrived."""
    times_s: list[float] = []

    def circle(vehicle_s: float) -> Setpoint:
        angle = 0.2 * vehicle_s
        out, along = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
        return Setpoint(20.0 * out, 4.0 * along, -0.8 * out, angle)

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.setblocking(False)
        vehicle.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        url = f"udpout:127.0.0.1:{vehicle.getsockname()[1]}"
        link = make_link(parse_link_url(url), (255, 190), _nobody, time.monotonic)
        await link.open()
        (peer,) = link.peers
        session = OffboardSession(
            "benchmark",
            SetpointStream(target=(1, 1), clock=time.monotonic, deadman_s=DEADMAN_S, source=circle),
            own_system=255,
            peer=lambda: peer,
            passed=_written,
            vehicle_at=lambda station_s: station_s,
            clock_rate=lambda: 1.0,
            rate_hz=RATE_HZ,
            on_end=_ended,
            leave=_stay,
        )
        session.start()
        end = time.monotonic() + seconds
        while time.monotonic() < end and session.active:
            session.feed()
            times_s += _arrived(vehicle)
            await asyncio.sleep(0.1)
        session.halt(OffboardEnd.STOPPED)
        session.join(1.0)
        await link.close()
        return times_s + _arrived(vehicle)


def _arrived(vehicle: socket.socket) -> list[float]:
    """When each datagram that is waiting came in (s)."""
    times_s = []
    with suppress(BlockingIOError):
        while True:
            _, ((_, _, stamp),), _, _ = vehicle.recvmsg(512, socket.CMSG_SPACE(16))
            whole_s, nanoseconds = struct.unpack("qq", stamp)
            times_s.append(whole_s + 1e-9 * nanoseconds)
    return times_s


def _written(packet: bytes) -> None:
    """Nothing is recorded."""


def _ended(session: OffboardSession) -> None:
    """Nobody is to be told."""


async def _stay(session: OffboardSession) -> None:
    """There is no vehicle that could hold."""


@contextmanager
def beside(what: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A process of this module, for the time of a `with` block."""
    command = [sys.executable, "-m", __name__, what, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def _sleep_loop(seconds: float) -> None:
    times_s: list[float] = []
    due = begin = time.monotonic()
    while due < begin + seconds:
        due += 1.0 / RATE_HZ
        time.sleep(max(0.0, due - time.monotonic()))
        times_s.append(time.monotonic())
    print(json.dumps(times_s))


def _plan_again_and_again() -> None:
    from pathlib import Path

    from gcs.core.progress import SilentProgress
    from gcs.core.scenario import parse_scenario
    from gcs.planning.planner import make_plan
    from gcs.storage.mesh_files import load_structure, sample_scenario

    os.nice(NICENESS)
    scenario = parse_scenario(sample_scenario("gantry-crane"))
    structure, _ = load_structure(scenario.structure, Path())
    while True:
        make_plan(scenario, structure, SilentProgress())


if __name__ == "__main__":
    if sys.argv[1] == "sleep":
        _sleep_loop(float(sys.argv[2]))
    elif sys.argv[1] == "plan":
        _plan_again_and_again()
    else:
        while True:
            pass
