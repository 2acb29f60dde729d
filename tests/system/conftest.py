"""Whole processes against each other: simulated vehicles, the command line and the station, as a user runs them."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import sqlite3
import subprocess
import sys
import time
import urllib.error
import urllib.request
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml

from gcs.services.plan_service import plan_to_directory
from gcs.services.simulation import Simulator, SimulatorOptions
from gcs.services.station import StationServices
from gcs.storage.plan_files import read_plan

SCENARIO = Path(__file__).resolve().parents[2] / "gcs/storage/samples/gantry-crane.scenario.yaml"
FOUR_POINTS = (
    {"name": "L1", "position_m": [-2.6, 1.94, 32.6], "normal": [0.0, 1.0, 0.0]},
    {"name": "L4", "position_m": [-2.6, 1.94, 31.0], "normal": [0.0, 1.0, 0.0]},
    {"name": "R1", "position_m": [-2.6, -1.94, 32.6], "normal": [0.0, -1.0, 0.0]},
    {"name": "R4", "position_m": [-2.6, -1.94, 31.0], "normal": [0.0, -1.0, 0.0]},
)


MOST_SECONDS = 1200
PATIENCE_S = 300.0
"""What is waited for has its time on a busy machine too; only a fault takes so long."""


@pytest.fixture(autouse=True)
def deadline():
    """No test hangs, whatever it waits for."""

    def too_long(number, frame):
        raise TimeoutError(f"the test took more than {MOST_SECONDS} s")

    before = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(MOST_SECONDS)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def _own_ports():
    """Below those that the system gives away, and for each test process others: nobody takes one before its user."""
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    return iter(range(20_000 + 1_000 * worker, 21_000 + 1_000 * worker))


PORTS = _own_ports()


def free_port(kind=socket.SOCK_DGRAM):
    for port in PORTS:
        with socket.socket(socket.AF_INET, kind) as sock, contextlib.suppress(OSError):
            sock.bind(("127.0.0.1", port))
            return port
    raise AssertionError("no port is left")


@pytest.fixture(name="free_port")
def free_port_fixture():
    """Gives a port that nobody else takes."""
    return free_port


@pytest.fixture(scope="session")
def crane_plan(made_once):
    """The sample crane's 18 points, planned by the product."""
    return made_once("crane-plan", lambda out: plan_to_directory(SCENARIO, out))


@pytest.fixture(scope="session")
def small_plan(made_once, tmp_path_factory):
    """Four of the points, for tests that are about something else than the flight."""
    scenario = yaml.safe_load(SCENARIO.read_text())
    scenario["inspection"] = {"points": list(FOUR_POINTS)}
    file = tmp_path_factory.mktemp("scenarios") / "small.yaml"
    file.write_text(yaml.safe_dump(scenario))
    return made_once("small-plan", lambda out: plan_to_directory(file, out))


class Vehicle:
    """A simulated vehicle in a process of its own, with the tests' door to it."""

    def __init__(self, kind, plan, *extra, speedup=4.0, card=None, system_id=1):
        self.name = f"{kind}-{system_id}"
        self.system_id = system_id
        self.port = free_port()
        self.card = card
        arguments = ["--control-port", "0", "--tcp-base", "none", "--first-system-id", str(system_id), *extra]
        if card is not None:
            arguments += ["--images-dir", str(card)]
        self._simulator = Simulator(
            SimulatorOptions(
                autopilot=kind, speedup=speedup, port=self.port, structure=plan / "structure.ply", extra=arguments
            )
        )

    @property
    def url(self):
        return f"udpin:127.0.0.1:{self.port}"

    def __enter__(self):
        self._simulator.__enter__()
        end = time.monotonic() + PATIENCE_S
        while not any(line.startswith("control:") for line in self._simulator.output):
            assert time.monotonic() < end, self._simulator.output
            time.sleep(0.02)
        line = next(line for line in self._simulator.output if line.startswith("control:"))
        self._door = ("127.0.0.1", int(line.rsplit(":", 1)[1]))
        return self

    def __exit__(self, *error):
        self._simulator.__exit__(*error)

    def ask(self, line):
        """One command of the control port."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.settimeout(PATIENCE_S)
            sock.sendto(line.encode(), self._door)
            answer = json.loads(sock.recv(65536))
        assert answer["ok"], answer
        return answer

    @property
    def truth(self):
        return self.ask("state")

    async def until(self, holds, timeout_s=PATIENCE_S, what="the vehicle"):
        """Wait for its true state."""
        end = time.monotonic() + timeout_s
        while True:
            state = self.truth
            if holds(state):
                return state
            assert time.monotonic() < end, f"{what}: {state}"
            await asyncio.sleep(0.05)

    def files(self):
        """What is on its card: file name -> CRC-32."""
        folder = self.card / f"vehicle-{self.system_id}"
        return {file.name: zlib.crc32(file.read_bytes()) for file in folder.glob("*.JPG")} if folder.exists() else {}


@dataclass
class Told:
    """What a `gcs` command said and how it ended."""

    process: asyncio.subprocess.Process
    lines: list[str] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def status(self):
        return self.process.returncode

    @property
    def text(self):
        return "\n".join(self.lines)

    @property
    def summary(self):
        """The JSON object of `--json`."""
        return json.loads(next(line for line in reversed(self.lines) if line.startswith("{")))

    async def until(self, words, timeout_s=PATIENCE_S):
        """Wait until it has said something."""
        end = time.monotonic() + timeout_s
        while words not in self.text:
            assert time.monotonic() < end and self.status is None, self.text
            await asyncio.sleep(0.05)


@contextlib.asynccontextmanager
async def command(*arguments):
    """A running `gcs` command; killed when the block ends."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "gcs.cli",
        *map(str, arguments),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    told = Told(process)

    async def read():
        async for line in process.stdout:
            told.lines.append(line.decode().rstrip())

    reading = asyncio.create_task(read())
    try:
        yield told
    finally:
        if process.returncode is None:
            process.send_signal(signal.SIGCONT)
            process.kill()
        await process.wait()
        await reading


@pytest.fixture
def gcs():
    """Runs a `gcs` command to its end, or (`gcs.running`) leaves it running for a block."""

    async def run(*arguments, timeout_s=2 * PATIENCE_S):
        started = time.monotonic()
        async with command(*arguments) as told:
            try:
                await asyncio.wait_for(told.process.wait(), timeout_s)
            except (TimeoutError, asyncio.CancelledError):
                pytest.fail(f"not over after {timeout_s} s:\n{told.text}")
        told.seconds = time.monotonic() - started
        return told

    run.running = command
    return run


@pytest.fixture
def vehicle():
    """Makes simulated vehicles; all are ended with the test."""
    with contextlib.ExitStack() as stack:
        yield lambda kind, *extra, plan, **options: stack.enter_context(Vehicle(kind, plan, *extra, **options))


class Records:
    """A data directory, read from outside."""

    def __init__(self, directory):
        self._directory = Path(directory)

    def rows(self, query, *values):
        with contextlib.closing(sqlite3.connect(self._directory / "gcs.sqlite3")) as database:
            return database.execute(query, values).fetchall()

    def texts(self, kind):
        return [text for (text,) in self.rows("select text from flight_events where kind = ? order by id", kind)]

    def misses(self, vehicle):
        """Viewpoint id -> how near the vehicle missed it (m)."""
        query = "select viewpoint_id, miss_m from visits join flights on flight_id = flights.id where vehicle = ?"
        return dict(self.rows(query, vehicle.name))

    def images(self, vehicle):
        """Card name -> (CRC-32 of our file on disk, viewpoint's name)."""
        found = {}
        for path, flight, file, name in self.rows(
            "select vehicle_path, flight_id, file_name, viewpoint_name from images"
            " join flights on flight_id = flights.id where images.state = 'stored' and vehicle = ?",
            vehicle.name,
        ):
            data = (self._directory / "images" / flight / file).read_bytes()
            found[path.rsplit("/", 1)[1]] = (zlib.crc32(data), name)
        return found


@pytest.fixture
def records():
    return Records


@pytest.fixture
def is_whole():
    """Every viewpoint reached within half a metre, every picture here with the CRC-32 that it has on the card."""

    def check(vehicle, plan, data):
        held = Records(data)
        viewpoints = read_plan(plan).viewpoints
        misses = held.misses(vehicle)
        assert set(misses) == {v.id for v in viewpoints}
        assert max(misses.values()) <= 0.5
        images = held.images(vehicle)
        assert {name for _, name in images.values() if name} == {v.name for v in viewpoints}
        assert {name: crc for name, (crc, _) in images.items()} == vehicle.files()

    return check


class Station:
    """`gcs serve`, driven over REST with the token of its data directory."""

    def __init__(self, data):
        self.data = Path(data)
        self.port = free_port(socket.SOCK_STREAM)
        self._process = None

    def start(self):
        self._process = subprocess.Popen(
            [sys.executable, "-m", "gcs.cli", "serve", "--port", str(self.port), "--data", str(self.data)],
            stdout=subprocess.DEVNULL,
        )
        end = time.monotonic() + PATIENCE_S
        while True:
            try:
                return self.get("/status")
            except (OSError, urllib.error.URLError):
                assert self._process.poll() is None and time.monotonic() < end, "the station did not start"
                time.sleep(0.1)

    def signal(self, number):
        self._process.send_signal(number)
        if number == signal.SIGKILL:
            self._process.wait()

    def stop(self):
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGCONT)
            self._process.terminate()
            try:
                self._process.wait(60)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def call(self, method, path, body=None, timeout_s=PATIENCE_S):
        """Status and answer of a request."""
        request = urllib.request.Request(
            f"http://127.0.0.1:{self.port}/api{path}",
            method=method,
            data=None if body is None else json.dumps(body).encode(),
            headers={
                "Authorization": f"Bearer {(self.data / 'token').read_text().strip()}",
                "Content-Type": "application/json",
            },
        )
        try:
            with urllib.request.urlopen(request, timeout=timeout_s) as answer:
                return answer.status, json.loads(answer.read() or b"null")
        except urllib.error.HTTPError as error:
            with error:
                return error.code, json.loads(error.read())

    def get(self, path):
        status, answer = self.call("GET", path)
        assert status == 200, answer
        return answer

    async def post(self, path, expect=200, **body):
        status, answer = await asyncio.to_thread(self.call, "POST", path, body)
        assert status == expect, answer
        return answer

    def flight(self, flight_id):
        return self.get(f"/flights/{flight_id}")

    async def until(self, flight_id, holds, timeout_s=PATIENCE_S):
        """Wait until a flight's record says so."""
        end = time.monotonic() + timeout_s
        while True:
            flight = await asyncio.to_thread(self.flight, flight_id)
            if holds(flight):
                return flight
            if time.monotonic() > end:
                log = [e["text"] for e in self.get(f"/flights/{flight_id}/events")][-15:]
                pytest.fail(f"{flight['state']}: {flight['problems']}; {log}")
            await asyncio.sleep(0.2)

    async def vehicle_heard(self, name, timeout_s=PATIENCE_S):
        end = time.monotonic() + timeout_s
        while True:
            for vehicle in await asyncio.to_thread(self.get, "/vehicles"):
                if vehicle["name"] == name and vehicle["connected"]:
                    return
            assert time.monotonic() < end, f"{name} is not heard"
            await asyncio.sleep(0.1)

    async def prepared(self, vehicle, mode):
        """Open the link, wait for the vehicle, and prepare a flight; its id."""
        await self.post("/links", expect=201, url=vehicle.url)
        await self.vehicle_heard(vehicle.name)
        (plan,) = self.get("/plans")
        flight = await self.post("/flights", expect=201, plan_id=plan["id"], vehicle=vehicle.name, mode=mode)
        return flight["id"]


@pytest.fixture
def station(tmp_path):
    """Makes a station that knows a plan."""
    made = []

    async def make(plan):
        data = tmp_path / "station"
        services = StationServices(data, stored_links=False)
        async with services.running(lambda event: ""):
            services.plans.adopt(plan)
        made.append(Station(data))
        made[-1].start()
        return made[-1]

    yield make
    for one in made:
        one.stop()
