"""A signed link of the companion: pymavlink's code is the autopilot at its other end, a stranger is beside it."""

from __future__ import annotations

import asyncio
import contextlib
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import NotFoundError
from gcs.core.replanning import ReplanReason, ReplanReport
from gcs.mavlink.companion_lease import lease_status
from gcs.mavlink.signing import EPOCH_S, TICKS_PER_S
from gcs.mavlink.tunnel_carrier import replanning, tunnelled
from gcs.services.companion import process
from gcs.services.companion.companion_options import CompanionOptions
from gcs.services.companion.link_key import CompanionSigning, link_signing
from gcs.services.companion.process import run_companion
from gcs.services.link_signing import key_store
from gcs.services.signing_commands import export_key, share_key
from gcs.storage.key_files import read_key_file, write_key_file
from gcs.storage.report_outbox_files import ReportOutboxFiles
from gcs.storage.signing_keys import StoredKey
from gcs.storage.signing_stamps import SigningStamps

KEY, OTHER_KEY = bytes(range(32)), bytes(range(1, 33))


class Autopilot(asyncio.DatagramProtocol):
    """Signs with a key, or does not, and hears what is signed with it."""

    def __init__(self, port, key):
        self.port = port
        self.codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.codec.robust_parsing = True
        self.codec.signing.secret_key = key
        self.codec.signing.sign_outgoing = key is not None
        self.codec.signing.timestamp = int((time.time() - EPOCH_S) * TICKS_PER_S)
        self.heard = []

    def connection_made(self, transport):
        self.transport = transport

    def datagram_received(self, data, addr):
        self.heard += [m for m in self.codec.parse_buffer(data) or [] if m.get_msgId() >= 0]

    def send(self, message):
        self.transport.sendto(message.pack(self.codec), ("127.0.0.1", self.port))

    def heartbeat(self):
        self.send(mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 3, 3))

    async def beside(self, told, words, seconds=10.0):
        """Send heartbeats until the companion has said something."""
        async with asyncio.timeout(seconds):
            while not any(words in line for line in told):
                self.heartbeat()
                await asyncio.sleep(0.05)


@contextlib.asynccontextmanager
async def companion(directory, key_file, **given):
    told = []
    running = asyncio.create_task(
        run_companion(
            "udpin:127.0.0.1:0",
            station=None,
            token_file=None,
            keep=directory,
            plans=(),
            options=CompanionOptions(),
            say=told.append,
            key_file=key_file,
            **given,
        )
    )
    try:
        async with asyncio.timeout(60.0):
            while not told and not running.done():  # noqa: ASYNC110 - what it says has no event to wait for
                await asyncio.sleep(0.01)
        yield told
    finally:
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running


@contextlib.asynccontextmanager
async def autopilot(told, key):
    port = int(told[0].rsplit(":", 1)[1])
    loop = asyncio.get_running_loop()
    transport, end = await loop.create_datagram_endpoint(lambda: Autopilot(port, key), local_addr=("127.0.0.1", 0))
    try:
        yield end
    finally:
        transport.close()


@pytest.fixture(autouse=True)
def like_any_process(monkeypatch):
    """Nothing is warmed up, and this process keeps its priority."""
    monkeypatch.setattr(process, "warm_navigator", lambda: None)
    monkeypatch.setattr(process, "_be_prompt", lambda: None)


@pytest.fixture
def key_file(tmp_path):
    write_key_file(tmp_path / "key", KEY)
    return tmp_path / "key"


async def test_all_that_it_sends_is_signed(tmp_path, key_file):
    async with companion(tmp_path / "kept", key_file) as told, autopilot(told, KEY) as end:
        await end.beside(told, "beside the autopilot of system 1")
        async with asyncio.timeout(60.0):
            while not any(m.get_type() == "TUNNEL" for m in end.heard):
                end.heartbeat()
                await asyncio.sleep(0.05)
        assert all(message.get_signed() for message in end.heard)
        assert end.codec.signing.badsig_count == 0
    assert not any("signing" in line for line in told)


@pytest.mark.parametrize(("key", "words"), [(OTHER_KEY, "signed with another key"), (None, "unsigned packets")])
async def test_what_is_not_signed_with_the_key_is_said_once_and_not_followed(tmp_path, key_file, key, words):
    async with companion(tmp_path / "kept", key_file) as told, autopilot(told, key) as end:
        await end.beside(told, words)
        await asyncio.sleep(1.2)
        assert sum(words in line for line in told) == 1
        assert not any("beside" in line for line in told)


async def test_without_the_key_it_says_that_it_needs_it(tmp_path):
    async with companion(tmp_path / "kept", None, data_dir=tmp_path) as told, autopilot(told, KEY) as end:
        await end.beside(told, "--key-file")


def report():
    return ReplanReport(9, 1, "11" * 32, "22" * 32, ReplanReason.HELD, -1, 1.0, None, None, (), ())


async def test_forged_orders_and_acknowledgements_change_nothing(tmp_path, key_file):
    before = ReportOutboxFiles(tmp_path / "kept" / "reports")
    before.keep(report())
    before.flush()
    stored = lambda: list((tmp_path / "kept" / "reports").glob("*.json"))  # noqa: E731
    (kept,) = stored()
    async with companion(tmp_path / "kept", key_file) as told, autopilot(told, KEY) as end:
        await end.beside(told, "beside the autopilot")
        async with autopilot(told, None) as stranger:
            for _ in range(5):
                stranger.send(acknowledgement())
                stranger.send(fly(lease=7))
                end.heartbeat()
                await asyncio.sleep(0.3)
        assert stored() == [kept], "nothing lost"
        assert 7 not in leases(end.heard), "no lease for a stranger"
        assert sum("unsigned packets" in line for line in told) == 1, "said once"
        end.send(acknowledgement())
        end.send(fly(lease=8))
        async with asyncio.timeout(60.0):
            while stored() or 8 not in leases(end.heard):  # noqa: ASYNC110 - as above
                await asyncio.sleep(0.02)


def acknowledgement():
    return tunnelled(replanning.MAVLink_replan_ack_message(9, 1, 0), 0, 0)


def fly(lease):
    return tunnelled(replanning.MAVLink_lease_order_message(lease, 1, [17] * 32), 0, 0)


def leases(heard):
    states = [lease_status(message) for message in heard if message.get_type() == "TUNNEL"]
    return {state.lease for state in states if state is not None}


def test_time_stamps_grow_over_restarts_also_when_the_clock_does_not(tmp_path):
    file = tmp_path / "stamp"
    ahead = int((time.time() + 1e6 - EPOCH_S) * TICKS_PER_S)
    SigningStamps(file, 1000).claim(ahead)
    first = CompanionSigning(KEY, SigningStamps(file, 1000))
    used = [first.signing.timestamp() for _ in range(400)]
    assert used[0] > ahead + 1000, "behind all that was claimed"
    second = CompanionSigning(KEY, SigningStamps(file, 1000))  # the first one was killed
    assert second.signing.timestamp() > used[-1]


def test_the_key_is_that_of_the_data_directory_or_of_a_file(tmp_path, monkeypatch):
    monkeypatch.setenv("GCS_KEY", "correct horse")
    url, own = "udpin:127.0.0.1:14550", "udpin:127.0.0.1:14560"
    assert link_signing(own, None, tmp_path, tmp_path) is None
    key_store(tmp_path).put(url, StoredKey(KEY, rejects_unsigned=False))
    share_key(url, own, tmp_path)
    shared = link_signing(own, None, tmp_path, tmp_path)
    assert (shared.signing.key, shared.signing.rejects_unsigned) == (KEY, False)
    export_key(url, tmp_path / "exported", tmp_path)
    assert read_key_file(tmp_path / "exported") == KEY
    given = link_signing("serial:/dev/none:57600", tmp_path / "exported", tmp_path, tmp_path)
    assert (given.signing.key, given.signing.rejects_unsigned) == (KEY, True)
    with pytest.raises(NotFoundError, match="not signed"):
        export_key("udpin:127.0.0.1:1", tmp_path / "none", tmp_path)
