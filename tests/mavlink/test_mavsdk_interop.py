"""Transfers to an independent implementation: MAVSDK's servers, in a process of their own, over UDP."""

from __future__ import annotations

import asyncio
import json
import math
import os
import random
import socket
import subprocess
import sys
import time
import zlib
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import NotFoundError, RefusedError
from gcs.core.mission import Mission, MissionItem
from gcs.core.vehicle import Autopilot
from gcs.mavlink.canonical_form import compare
from gcs.mavlink.ftp_directory import ListDirectory
from gcs.mavlink.ftp_fetch import FetchFile
from gcs.mavlink.ftp_protocol import SequenceNumbers
from gcs.mavlink.mission_proof import MissionPeer, compare_with_vehicle, upload_and_prove
from gcs.mavlink.station import MavlinkStation
from gcs.mavlink.transaction import run

pytest.importorskip("mavsdk")
pytestmark = pytest.mark.system

SERVER = Path(__file__).with_name("mavsdk_server.py")
READER = Path(__file__).with_name("mavsdk_download.py")
PATIENCE_S = 200.0
"""Only a fault takes so long, also on a busy machine."""


class UdpVehicle(asyncio.DatagramProtocol):
    """The smallest link that a transaction can run on; loses packets of both directions on purpose."""

    def __init__(self, loss: float) -> None:
        self._rng, self._loss = random.Random(5), loss
        self._packer = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._queues: list[asyncio.Queue] = []
        self._address = None
        self.transport = None
        self.found = asyncio.Event()
        self.heartbeat = None

    def connection_made(self, transport) -> None:
        self.transport = transport

    def datagram_received(self, data, address) -> None:
        self._address = address
        if self._rng.random() < self._loss:
            return
        for message in self._parser.parse_buffer(data) or []:
            if message.get_type() == "HEARTBEAT":
                self.heartbeat = message
                self.found.set()
            for queue in self._queues:
                queue.put_nowait(message)

    def send(self, message) -> None:
        raw = message.pack(self._packer)
        self._packer.seq = (self._packer.seq + 1) % 256
        if self._rng.random() >= self._loss:
            self.transport.sendto(raw, self._address)

    @asynccontextmanager
    async def messages(self):
        queue: asyncio.Queue = asyncio.Queue()
        self._queues.append(queue)

        async def take():
            while True:
                yield await queue.get()

        try:
            yield take()
        finally:
            self._queues.remove(queue)


@pytest.fixture
def make_server(tmp_path):
    """Starts MAVSDK and yields its link and its process; ends both."""

    @asynccontextmanager
    async def make(loss: float = 0.0):
        loop = asyncio.get_running_loop()
        transport, link = await loop.create_datagram_endpoint(partial(UdpVehicle, loss), local_addr=("127.0.0.1", 0))
        port = transport.get_extra_info("sockname")[1]
        process = subprocess.Popen(  # noqa: ASYNC220 - it returns at once
            [sys.executable, str(SERVER), str(port), str(tmp_path)], stdout=subprocess.PIPE, text=True
        )
        beat = None
        try:
            await asyncio.wait_for(link.found.wait(), PATIENCE_S)

            async def heartbeats():
                while True:
                    link.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
                    await asyncio.sleep(0.5)

            beat = asyncio.ensure_future(heartbeats())
            await asyncio.sleep(0.2)
            yield link, process
        finally:
            if beat is not None:
                beat.cancel()
            process.kill()
            process.communicate()
            transport.close()

    return make


def peer(link) -> MissionPeer:
    return MissionPeer(
        1,
        1,
        Autopilot.GENERIC,
        link.send,
        time.monotonic,
        partial(run, source=link, clock=time.monotonic),
        own_system=255,
    )


def mission(count: int) -> Mission:
    items = [MissionItem(0, 5, 22, (0.0, 0.0, 0.0, math.nan), 313622000, 1216155000, 20.0, current=1)]
    for n in range(1, count):
        if n % 3:
            items.append(MissionItem(n, 5, 16, (1.0, 0.5, 0.0, 10.0 * n % 360), 313622000 + n, 1216155000, 20.1 + n))
        else:
            items.append(MissionItem(n, 2, 2000, (0.0, 0.0, 1.0, float(n)), 0, 0, 0.0))
    return Mission(tuple(items))


def ardupilot_mission(count: int) -> Mission:
    items = [MissionItem(0, 0, 16, (0.0, 0.0, 0.0, 0.0), 313622000, 1216155000, 4.0)]
    items.append(MissionItem(1, 0, 22, (0.0, 0.0, 0.0, 0.0), 313622000, 1216155000, 20.0))
    for n in range(2, count):
        if n % 3:
            items.append(MissionItem(n, 0, 16, (1.0, 0.0, 0.0, 0.0), 313622000 + n, 1216155000, 20.13 + n))
        else:
            items.append(MissionItem(n, 0, 93, (float(n), -1.0, -1.0, -1.0), 0, 0, 0.0))
    return Mission(tuple(items))


def line_of(process) -> dict:
    while True:
        line = process.stdout.readline()
        if line.startswith("{"):
            return json.loads(line)


@pytest.mark.parametrize(("loss", "count"), [(0.0, 120), (0.1, 15)])
async def test_upload_to_mavsdk_is_proved_and_complete(make_server, loss, count):
    wanted = mission(count)
    async with make_server(loss) as (link, process):
        proof = await asyncio.wait_for(upload_and_prove(wanted, peer(link)), PATIENCE_S)
        assert (proof.items_sent, proof.items_read) == (count, count)
        got = await asyncio.wait_for(asyncio.to_thread(line_of, process), PATIENCE_S)
        assert len(got["items"]) == count
        for item, values in zip(wanted.items, got["items"], strict=True):
            sequence, frame, command, *params, x, y, z, auto = values
            assert (sequence, frame, command, x, y, auto) == (
                item.sequence,
                item.frame,
                item.command,
                item.x,
                item.y,
                item.autocontinue,
            )
            assert z == pytest.approx(item.z, rel=1e-6)
            assert params == pytest.approx(list(item.params), rel=1e-6, nan_ok=True)
        other = Mission(tuple(i if i.sequence != 5 else mission(6).items[2] for i in wanted.items[:5]))
        assert not (await asyncio.wait_for(compare_with_vehicle(other, peer(link)), PATIENCE_S)).equal


@pytest.mark.parametrize("loss", [0.0, 0.1])
async def test_files_from_mavsdk(make_server, tmp_path, loss):
    content = os.urandom(100_003)
    (tmp_path / "DCIM").mkdir()
    (tmp_path / "DCIM" / "IMG_0001.jpg").write_bytes(content)
    (tmp_path / "DCIM" / "empty.txt").write_bytes(b"")
    async with make_server(loss) as (link, _):
        sequence = SequenceNumbers()

        async def do(kind, path, tries=3):
            """MAVSDK's server now and then fails to read; the station tries again, too."""
            transaction = kind(path, 1, 1, link.send, time.monotonic, sequence=sequence, own_system=255)
            try:
                return await asyncio.wait_for(run(transaction, link, time.monotonic), PATIENCE_S)
            except RefusedError:
                if tries == 1:
                    raise
            return await do(kind, path, tries - 1)

        listing = await do(ListDirectory, "/DCIM")
        assert {(e.name, e.size) for e in listing.entries} == {("IMG_0001.jpg", 100_003), ("empty.txt", 0)}
        fetched = await do(FetchFile, "/DCIM/IMG_0001.jpg")
        assert fetched.data == content
        assert fetched.crc32 == zlib.crc32(content)
        assert fetched.confirmed
        assert (await do(FetchFile, "/DCIM/empty.txt")).data == b""
        with pytest.raises(NotFoundError):
            await do(FetchFile, "/DCIM/none.jpg")


@pytest.mark.parametrize("autopilot", [Autopilot.PX4, Autopilot.ARDUPILOT])
@pytest.mark.parametrize("loss", [0.0, 0.1])
async def test_mavsdk_reads_from_the_simulated_vehicle_what_we_put_there(autopilot, loss):
    """Three independent implementations: our upload, the simulated vehicle's store, MAVSDK's download."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = ["-m", "sitl_mocks", "--autopilot", autopilot.value, "--port", str(port), "--tcp-base", "none"]
    wanted = mission(40) if autopilot is Autopilot.PX4 else ardupilot_mission(40)
    simulator = subprocess.Popen(  # noqa: ASYNC220 - it returns at once
        [sys.executable, *command, "--loss", str(loss), "--seed", "3", "--exit-with-parent"], stdout=subprocess.DEVNULL
    )
    try:
        station = MavlinkStation()
        try:
            await station.open(f"udpin:127.0.0.1:{port}")
            vehicle = await station.wait_for_vehicle(PATIENCE_S)
            proof = await asyncio.wait_for(vehicle.upload_mission(wanted), PATIENCE_S)
            assert (proof.items_sent, proof.items_read) == (40, 40)
        finally:
            await station.close_all()
        if loss:
            return  # MAVSDK's own download is not what is tested on a bad link
        reader = await asyncio.create_subprocess_exec(
            sys.executable, str(READER), str(port), stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL
        )
        out, _ = await asyncio.wait_for(reader.communicate(), PATIENCE_S)
    finally:
        simulator.kill()
        simulator.wait()
    line = next(line for line in out.decode().splitlines() if line.startswith("{"))
    read = [
        MissionItem(sequence, frame, number, tuple(params), x, y, z, autocontinue=auto)
        for sequence, frame, number, *params, x, y, z, auto in json.loads(line)["items"]
    ]
    comparison = compare(wanted.items, read, autopilot)
    assert comparison.equal, comparison.summary
