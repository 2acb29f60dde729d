"""Case `fuzz`: mutated packets into the whole receive path, while missions, parameters, files and pictures are moved.

The full run takes about five minutes. As a program (`python -m gcs.services.benchmarks.mavlink_fuzz PACKETS [SEED]`) it
runs for as long as is asked for, and prints what came of it.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import resource
import socket
import sys
import time
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from gcs.core.clock import new_id, utc_now
from gcs.core.errors import GcsError
from gcs.core.mission import Mission, MissionItem
from gcs.mavlink.events import ImageEvent, StationEvent
from gcs.mavlink.mission_protocol import MissionType
from gcs.mavlink.mutated_packets import MutatedPackets
from gcs.mavlink.packed_traffic import PackedVehicle
from gcs.mavlink.station import MavlinkStation
from gcs.services.benchmarks.row import Row
from gcs.storage.image_store import ImageStore
from gcs.storage.records import ImageRecord, ImageState

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Iterator

    from gcs.mavlink.vehicle import Vehicle

PACKETS, QUICK_PACKETS = 10_500_000, 10_000
"""Of which 24 in 25 are mutated, see `TRUE_EVERY`."""
BATCH = 32
TRUE_EVERY = 25
"""One packet in so many is of the true vehicle, so that it stays connected."""
SPOOFED, ASKED = 1, 2
"""System ids: all that the first says may be false; the second's answers may, while it is asked for things."""
ORDERS = frozenset({20, 21, 22, 176, 192, 209, 252, 300, 400})
"""Commands that move a vehicle: return, land, take off, mode, reposition, motor test, override, mission start, arm."""
COMMAND_LONG, SET_POSITION_TARGETS = 76, frozenset({84, 86})
EXCHANGE_S = 3.0
WARM_SHARE = 0.3


@dataclass(frozen=True)
class FuzzResult:
    """What came of it.

    Attributes:
        packets: sent.
        heard: messages that got past the framing.
        seconds: it took.
        crashes: errors that were none of the project's own, with their first words.
        files_outside: files that were written anywhere but in their folder.
        orders: commands and setpoints that the station sent to the vehicle though nobody asked for any.
        memory_growth_mb: of the process, after the first third.
        memory_peak_mb: most that the process has ever had.
        exchanges: transfers that were begun.
    """

    packets: int
    heard: int
    seconds: float
    crashes: tuple[str, ...]
    files_outside: int
    orders: int
    memory_growth_mb: float
    memory_peak_mb: float
    exchanges: int


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: few packets.
    """
    result = fuzz(QUICK_PACKETS if quick else PACKETS, seed=0)
    figures = {
        "packets": result.packets,
        "crashes": len(result.crashes),
        "files_outside": result.files_outside,
        "orders": result.orders,
    }
    return [
        *(Row("fuzz", name, float(value), "1") for name, value in figures.items()),
        Row("fuzz", "memory_growth", result.memory_growth_mb, "MB"),
        Row("fuzz", "memory_peak", result.memory_peak_mb, "MB"),
        Row("fuzz", "packets_per_s", result.packets / result.seconds, "1/s"),
    ]


def fuzz(packets: int, seed: int) -> FuzzResult:
    """Send mutated packets to a station.

    Args:
        packets: how many.
        seed: of the mutations.
    """
    with TemporaryDirectory() as folder, _errors() as errors:
        return asyncio.run(_fuzz(packets, seed, Path(folder), errors))


async def _fuzz(packets: int, seed: int, folder: Path, errors: list[str]) -> FuzzResult:
    station = MavlinkStation()
    url = await station.open("udpin:127.0.0.1:0")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setblocking(False)
        sock.connect(("127.0.0.1", int(url.rsplit(":", 1)[1])))
        sender = _Sender(sock, seed)
        await sender.send(2 * TRUE_EVERY)  # so that the vehicle is found
        vehicle = await station.wait_for_vehicle(5.0, ASKED)
        work = _Work(vehicle, ImageStore(folder / "data"), errors)
        tasks = [asyncio.create_task(work.exchange()), asyncio.create_task(work.take_pictures(station))]
        begin = time.monotonic()
        await sender.send(int(packets * WARM_SHARE))
        memory_mb = _memory_mb()
        await sender.send(packets - int(packets * WARM_SHARE))
        growth_mb, seconds = _memory_mb() - memory_mb, time.monotonic() - begin
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        heard = station.links[0].messages
        await station.close_all()
    outside = _files_outside(folder, folder / "data" / "images" / "fuzz")
    return FuzzResult(
        packets, heard, seconds, tuple(errors), outside, sender.orders, growth_mb, _memory_peak_mb(), work.exchanges
    )


def _files_outside(folder: Path, inside: Path) -> int:
    return sum(path.is_file() and path.parent != inside for path in folder.rglob("*"))


class _Sender:
    """Plays the vehicle and looks at what it is sent."""

    def __init__(self, sock: socket.socket, seed: int) -> None:
        self._sock = sock
        spoofed = MutatedPackets(seed, SPOOFED, answers_only=False)
        self._false = (spoofed, MutatedPackets(seed + 1, ASKED, answers_only=True))
        self._true = (PackedVehicle(SPOOFED), PackedVehicle(ASKED))
        self._begin = time.monotonic()
        self.orders = 0

    async def send(self, packets: int) -> None:
        for k in range(packets):
            boot_ms = int((time.monotonic() - self._begin) * 1e3) + 60_000
            false, true = self._false[k % 2], self._true[k // TRUE_EVERY % 2]
            packet = true.message(boot_ms) if k % TRUE_EVERY == 0 else false.next()
            with suppress(OSError):
                self._sock.send(packet)
            if k % BATCH == 0:
                self._look()
                await asyncio.sleep(0)

    def _look(self) -> None:
        while True:
            try:
                packet = self._sock.recv(2048)
            except OSError:
                return
            number = int.from_bytes(packet[7:10], "little")
            command = int.from_bytes(packet[38:40], "little")
            if number in SET_POSITION_TARGETS or (number == COMMAND_LONG and command in ORDERS):
                self.orders += 1


class _Work:
    """What a station does with a vehicle, over and over; the vehicle's own errors are expected, others are not."""

    def __init__(self, vehicle: Vehicle, store: ImageStore, errors: list[str]) -> None:
        self._vehicle = vehicle
        self._store = store
        self._errors = errors
        self.exchanges = 0

    async def exchange(self) -> None:
        vehicle = self._vehicle
        item = MissionItem(0, 5, 16, (0.0, 0.0, 0.0, 0.0), 313622000, 1216155000, 20.0, 1)
        exchanges: tuple[Callable[[], Awaitable[object]], ...] = (
            lambda: vehicle.upload_mission(Mission((item,))),
            vehicle.download_mission,
            lambda: vehicle.download_list(MissionType.FENCE),
            vehicle.read_limits,
            lambda: vehicle.list_files("/DCIM"),
            lambda: vehicle.fetch_file("/DCIM/1.jpg"),
        )
        while True:
            for each in exchanges:
                self.exchanges += 1
                await self._try(each)

    async def take_pictures(self, station: MavlinkStation) -> None:
        async with station.events() as events:
            async for heard in events:
                if isinstance(heard, StationEvent) and isinstance(heard.event, ImageEvent):
                    await self._try(partial(self._bring, heard.event.image.file))

    async def _bring(self, file: str | None) -> None:
        fetched = await self._vehicle.fetch_file(file or "")
        image = ImageRecord(
            id=new_id("image"),
            flight_id="fuzz",
            index=0,
            viewpoint_id=None,
            viewpoint_name=None,
            state=ImageState.ANNOUNCED,
            source="link",
            announced_at=utc_now(),
            vehicle_path=file,
        )
        self._store.save(image, fetched.data)

    async def _try(self, action: Callable[[], Awaitable[object]]) -> None:
        try:
            async with asyncio.timeout(EXCHANGE_S):
                await action()
        except (GcsError, TimeoutError):
            await asyncio.sleep(0)
        except Exception as error:  # what fuzzing is to find
            self._errors.append(f"{type(error).__name__}: {error}")


class _Errors(logging.Handler):
    def __init__(self, errors: list[str]) -> None:
        super().__init__(logging.ERROR)
        self._found = errors

    def emit(self, record: logging.LogRecord) -> None:
        cause = record.exc_info[1] if record.exc_info else None
        self._found.append(f"{record.getMessage()} {cause!r}")


@contextmanager
def _errors() -> Iterator[list[str]]:
    """Everything that is logged as an error in a `with` block."""
    errors: list[str] = []
    handler = _Errors(errors)
    logging.getLogger().addHandler(handler)
    try:
        yield errors
    finally:
        logging.getLogger().removeHandler(handler)


def _memory_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _memory_peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


if __name__ == "__main__":
    asked, given_seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    print(json.dumps(asdict(fuzz(asked, given_seed))))
