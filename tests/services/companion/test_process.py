"""`gcs companion` as a process: wrong arguments are said in one line, and an error of its own does not end it."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import logging

import pytest

from gcs.core.errors import GcsError, LinkError, NotFoundError, RefusedError
from gcs.mavlink.companion_lease import lease_status
from gcs.mavlink.dialect import mavlink
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.services.companion import process
from gcs.services.companion.companion_options import CompanionOptions
from gcs.services.companion.core import CompanionCore
from gcs.services.companion.process import run_companion
from gcs.services.companion.station_plans import StationFiles

PLAN, STRUCTURE = b"{}", b"ply"
HASH = hashlib.sha256(PLAN).hexdigest()
TOKEN = "t" * 43


async def refused(tmp_path, url="udpin:127.0.0.1:0", **given):
    arguments = {"station": None, "token_file": None, "plans": (), "keep": tmp_path / "kept"} | given
    with pytest.raises(GcsError) as error:
        await run_companion(url, options=CompanionOptions(), say=lambda line: None, **arguments)
    assert error.value.exit_status == 2
    return str(error.value)


async def test_wrong_arguments_are_named(tmp_path):
    token = tmp_path / "token"
    token.write_text(TOKEN)
    assert "nonsense: not a link URL" in await refused(tmp_path, "nonsense")
    for url in ("ftp://x", "http:/x", "http://h:99999"):
        assert "--station" in await refused(tmp_path, station=url, token_file=tmp_path / "none")
    assert "token cannot be read" in await refused(tmp_path, station="http://h:1", token_file=tmp_path / "none")
    token.write_text("")
    assert "holds no token" in await refused(tmp_path, station="http://h:1", token_file=token)
    assert "no such plan" in await refused(tmp_path, plans=(tmp_path / "none",))


@pytest.fixture
def station(file_station):
    """Knows one plan."""
    file_station.plan_hash, file_station.files = HASH, {"plan.json": PLAN, "structure.ply": STRUCTURE}
    file_station.token = TOKEN
    return file_station.url


def test_files_come_by_hash_and_what_is_wrong_is_said(station):
    assert StationFiles(station, TOKEN).get(HASH, "plan.json") == PLAN
    with pytest.raises(NotFoundError, match="knows no plan"):
        StationFiles(station, TOKEN).get("0" * 64, "plan.json")
    with pytest.raises(RefusedError, match="token"):
        StationFiles(station, "other").get(HASH, "plan.json")


def test_a_station_that_is_not_there(unused_tcp_port):
    with pytest.raises(LinkError, match="does not answer"):
        StationFiles(f"http://127.0.0.1:{unused_tcp_port}", TOKEN).get(HASH, "plan.json")


class Autopilot(asyncio.DatagramProtocol):
    """Sends a heartbeat, and counts the states of the lease that it hears."""

    def __init__(self):
        self.states = 0
        self._parser = FrameParser()

    def datagram_received(self, data, addr):
        self.states += sum(lease_status(message) is not None for message in self._parser.feed(data))


async def soon(holds, what):
    async with asyncio.timeout(30.0):
        while not holds():  # noqa: ASYNC110 - there is no event to wait for
            await asyncio.sleep(0.01)
    assert holds(), what


async def test_an_error_of_its_own_is_logged_once_and_the_process_goes_on(tmp_path, monkeypatch, caplog):
    healthy, fell, told = [True], [], []

    class FrailCore(CompanionCore):
        def on_time(self):
            if not healthy[0]:
                raise ZeroDivisionError("of its own")
            super().on_time()

        def fail(self):
            fell.append(True)
            super().fail()

    monkeypatch.setattr(process, "CompanionCore", FrailCore)
    monkeypatch.setattr(process, "warm_navigator", lambda: None)
    monkeypatch.setattr(process, "_be_prompt", lambda: None)
    running = asyncio.create_task(
        run_companion(
            "udpin:127.0.0.1:0",
            station=None,
            token_file=None,
            keep=tmp_path / "kept",
            plans=(),
            options=CompanionOptions(),
            say=told.append,
            data_dir=tmp_path,
        )
    )
    try:
        await soon(lambda: told, "it listens")
        there = ("127.0.0.1", int(told[0].rsplit(":", 1)[1]))
        transport, end = await asyncio.get_running_loop().create_datagram_endpoint(Autopilot, remote_addr=there)
        with contextlib.closing(transport):
            beat = mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 3, 3)
            transport.sendto(FramePacker(1, 1).pack(beat))
            await soon(lambda: end.states, "it is beside the autopilot")
            healthy[0] = False
            await soon(lambda: len(fell) >= 3, "it tries again and again")
            assert [r.exc_info[0] for r in caplog.records if r.levelno == logging.ERROR] == [ZeroDivisionError]
            healthy[0], before = True, end.states
            await soon(lambda: end.states > before, "it goes on")
    finally:
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running
