"""`gcs demo`: all of the main job works, and whatever else speaks on its port is left alone (safety rule 2)."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.api.demo import SYSTEM_ID, Demo
from gcs.core.errors import LinkError, RefusedError
from gcs.mavlink.station import MavlinkStation
from gcs.services.simulation import SimulatorOptions

UID = "0123456789abcdef"
ASKING = {"HEARTBEAT", "TIMESYNC"}
ASKING_COMMANDS = {mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL}


class OtherVehicle:
    """A PX4 vehicle that looks real: it beats, answers who it is, and keeps what it is told."""

    def __init__(self, port, system_id, uid):
        self._uid = bytes.fromhex(uid)
        self._pack = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=1)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._socket.settimeout(0.1)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.beating = True
        self.heard = []

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *error):
        self._stop.set()
        self._thread.join()
        self._socket.close()

    @property
    def orders(self):
        """What it was told that is more than asking."""
        return [
            message
            for message in self.heard
            if message.get_type() not in ASKING
            and not (message.get_type() == "COMMAND_LONG" and message.command in ASKING_COMMANDS)
        ]

    def _say(self, message):
        with contextlib.suppress(ConnectionRefusedError):  # nobody listens yet, or any more
            self._socket.send(message.pack(self._pack))

    def _run(self):
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        beat_at = 0.0
        while not self._stop.is_set():
            if self.beating and time.monotonic() >= beat_at:
                beat_at = time.monotonic() + 0.2
                self._say(mavlink.MAVLink_heartbeat_message(2, 12, 81, 0, 3, 3))
            try:
                data = self._socket.recv(65536)
            except (TimeoutError, ConnectionRefusedError):
                continue
            for message in parser.parse_buffer(data) or ():
                self.heard.append(message)
                if message.get_type() == "COMMAND_LONG":
                    self._say(mavlink.MAVLink_command_ack_message(message.command, mavlink.MAV_RESULT_ACCEPTED))
                if message.get_type() == "COMMAND_LONG" and int(message.param1) == 148:
                    no = [0] * 8
                    self._say(
                        mavlink.MAVLink_autopilot_version_message(
                            0xFFFF, 1, 1, 1, 1, no, no, no, 1, 1, 0, self._uid.ljust(18, b"\0")
                        )
                    )


@pytest.fixture
async def station():
    station = MavlinkStation(only_system=SYSTEM_ID)
    url = await station.open("udpin:127.0.0.1:0")
    yield SimpleNamespace(
        mavlink=station,
        port=int(url.rsplit(":", 1)[1]),
        services=SimpleNamespace(vehicles=SimpleNamespace(station=station)),
    )
    await station.close_all()


@pytest.fixture
def demo(monkeypatch):
    monkeypatch.setattr("gcs.api.demo.VEHICLE_TIMEOUT_S", 2.0)
    return Demo(speedup=1.0, autopilot="px4", say=lambda line: None)


OWN = SimulatorOptions(uid=UID)


async def test_a_vehicle_of_another_system_id_gets_nothing_at_all(station, demo):
    with OtherVehicle(station.port, 1, UID) as other:
        with pytest.raises(LinkError, match=f"system id {SYSTEM_ID}"):
            await demo._own_vehicle(station.services, OWN)
        assert station.mavlink.vehicles == {}
        assert other.heard == []


async def test_a_vehicle_of_our_system_id_but_another_uid_is_only_asked_who_it_is(station, demo):
    with OtherVehicle(station.port, SYSTEM_ID, "ff" * 8) as other:
        with pytest.raises(RefusedError, match="left alone"):
            await demo._own_vehicle(station.services, OWN)
        assert other.orders == []
        assert {m.get_type() for m in other.heard} >= {"COMMAND_LONG"}  # it was asked


async def test_nobody_takes_the_place_of_our_own_vehicle(station, demo, monkeypatch):
    monkeypatch.setattr("gcs.mavlink.routing.SILENT_S", 0.3)
    with OtherVehicle(station.port, SYSTEM_ID, UID) as own, OtherVehicle(station.port, SYSTEM_ID, UID) as other:
        other.beating = False
        other.heard.clear()
        vehicle = await demo._own_vehicle(station.services, OWN)
        asked = len(own.heard)
        own.beating = False
        other.beating = True
        await asyncio.sleep(1.0)  # the route would have changed by now
        command = asyncio.ensure_future(vehicle.arm())
        await asyncio.sleep(0.3)
        command.cancel()
        await asyncio.gather(command, return_exceptions=True)
        assert len(own.heard) > asked
        assert other.heard == []


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


COMMAND = """
import functools, sys
import gcs.api.demo
gcs.api.demo.run_demo = functools.partial(gcs.api.demo.run_demo, link=sys.argv.pop())
from gcs.cli import main
main()
"""
"""The command itself, but with its vehicles' port known."""


@pytest.mark.system
def test_the_main_job_works_beside_a_vehicle_that_looks_real(tmp_path):
    port = free_port()
    line = [sys.executable, "-c", COMMAND, "demo", "--port", "0", "--data", str(tmp_path), f"udpin:127.0.0.1:{port}"]
    with OtherVehicle(port, 1, UID) as other:
        ended = subprocess.run(line, check=False, capture_output=True, text=True, timeout=600)
        heard = list(other.heard)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert heard == []
    assert ended.stderr == ""
    for words in ("planned: 18 viewpoints", "uploaded and proved", "done: 18 of 18 viewpoints, 18 of 18 images"):
        assert words in ended.stdout
    (flight,) = (tmp_path / "images").iterdir()
    assert len(list(flight.iterdir())) == 18


@pytest.mark.system
def test_a_demo_that_is_interrupted_has_not_worked(tmp_path):
    line = [sys.executable, "-u", "-m", "gcs.cli", "demo", "--port", "0", "--data", str(tmp_path)]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment) as process:
        while "planning" not in process.stdout.readline():
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate(timeout=300)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert "done" not in rest
