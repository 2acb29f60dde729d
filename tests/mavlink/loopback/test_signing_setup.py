"""Keys given to simulated vehicles, which sign with pymavlink's own code."""

import asyncio
import contextlib
import socket
import sys
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import ConflictError, LinkError, RefusedError, StorageError
from gcs.mavlink import signing_setup
from gcs.mavlink.signing import LinkSigning, Verdict, new_key
from gcs.mavlink.signing_setup import FRESH_S, SigningProbe, set_up_signing
from gcs.mavlink.station import MavlinkStation

pytestmark = pytest.mark.system

HOST = "127.0.0.1"


@contextlib.asynccontextmanager
async def simulated(kind, station, *extra):
    url = await station.open(f"udpin:{HOST}:0")
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "sitl_mocks", "--autopilot", kind, "--port", url.rsplit(":", 1)[1]),
        *("--tcp-base", "none", "--exit-with-parent", *extra),
        stdout=asyncio.subprocess.DEVNULL,
    )
    try:
        vehicle = await station.wait_for_vehicle(60.0)
        await vehicle.until(lambda: vehicle.telemetry.armed is not None, 60.0, "its state")
        yield url, vehicle
    finally:
        await station.close_all()
        process.terminate()
        await asyncio.wait_for(process.wait(), 60.0)


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_a_key_is_given_proved_rotated_and_taken_back(kind):
    station = MavlinkStation()
    async with simulated(kind, station) as (url, vehicle):
        for key in (new_key(), new_key()):
            proof = await station.set_up_signing(vehicle, url, LinkSigning(key))
            assert proof.proved, proof
            assert await vehicle.read_failsafes()
            (info,) = station.links
            assert info.signing.rejects_unsigned
            assert info.signing.counts[Verdict.GOOD] > 20
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
            false = mavlink.MAVLink_heartbeat_message(2, 12 if kind == "px4" else 3, 128 + 29, 0, 4, 3)
            stranger.sendto(false.pack(codec), (HOST, int(url.rsplit(":", 1)[1])))
            await asyncio.sleep(0.3)
        assert (await station.prove_signing(vehicle, url)).proved
        assert station.links[0].signing.rejects_unsigned
        assert vehicle.telemetry.armed.value is False
        assert "unsigned" in station.links[0].signing.problem
        assert len(station.ways(vehicle)) == 1
        await station.remove_signing(vehicle, url)
        assert station.links[0].signing is None
        await vehicle.until(lambda: vehicle.connected, 60.0, "its heartbeats")
        for ask in (station.prove_signing, station.remove_signing):
            with pytest.raises(ConflictError, match="not signed"):
                await ask(vehicle, url)


async def test_a_station_with_the_wrong_key_hears_nothing_and_says_why():
    station = MavlinkStation(lost_after_s=1.0)
    async with simulated("px4", station) as (url, vehicle):
        right = LinkSigning(new_key())
        await station.set_up_signing(vehicle, url, right)
        (entry,) = station._links.values()
        entry.link.signing = LinkSigning(new_key())
        async with asyncio.timeout(60.0):
            while vehicle.connected:  # noqa: ASYNC110 - silence has no event to wait for
                await asyncio.sleep(0.05)
        assert "another key" in station.links[0].signing.problem
        entry.link.signing = LinkSigning(right.key)  # as after a restart of the station
        await vehicle.until(lambda: vehicle.connected, 60.0, "its heartbeats")


async def test_a_vehicle_that_is_armed_or_heard_elsewhere_gets_no_key():
    station = MavlinkStation()
    async with simulated("px4", station) as (url, vehicle):
        with pytest.raises(ConflictError, match="close the others"):
            await station.set_up_signing(vehicle, "udpin:127.0.0.1:1", LinkSigning(new_key()))
        await vehicle.wait_ready_to_arm(60.0)
        await vehicle.arm()
        with pytest.raises(RefusedError, match="disarmed"):
            await station.set_up_signing(vehicle, url, LinkSigning(new_key()))
        assert station.links[0].signing is None


async def test_a_link_with_another_vehicle_gets_no_key_and_loses_none():
    station = MavlinkStation()
    async with simulated("px4", station, "--count", "2") as (url, vehicle):
        other = await station.wait_for_vehicle(60.0, other_than=vehicle)
        with pytest.raises(
            ConflictError, match=f"{other.identity.name} would not be heard on it any more: open a link"
        ):
            await station.set_up_signing(vehicle, url, LinkSigning(new_key()))
        assert station.links[0].signing is None
        (entry,) = station._links.values()
        entry.link.signing = LinkSigning(new_key(), rejects_unsigned=False)
        with pytest.raises(ConflictError, match="open a link of its own"):
            await station.remove_signing(vehicle, url)
        assert entry.link.signing is not None


@pytest.mark.parametrize("old", [None, LinkSigning(new_key())])
async def test_after_a_set_up_that_nothing_answers_the_link_is_as_before(old, monkeypatch):
    monkeypatch.setattr(signing_setup, "TELL_S", 0.001)
    order, link, new = [], SimpleNamespace(signing=old), LinkSigning(new_key())
    peer = SimpleNamespace(send=lambda m: order.append(m.get_type()), send_unsigned=lambda m: None)
    with pytest.raises(LinkError, match="its answers were lost; the new key is kept"):
        await set_up_signing(
            SilentVehicle(0.0), link, peer, new, asyncio.get_running_loop().time, lambda: order.append("kept")
        )
    assert order[:2] == ["kept", "SETUP_SIGNING"]
    assert link.signing is old
    assert old is None or old.pending == new.key


async def test_a_vehicle_that_was_disarmed_when_last_heard_may_be_armed_now():
    sent, link = [], SimpleNamespace(signing=None)
    peer = SimpleNamespace(send=sent.append, send_unsigned=sent.append)
    vehicle, signing = SilentVehicle(FRESH_S + 0.1), LinkSigning(new_key())
    with pytest.raises(RefusedError, match="disarmed and heard"):
        await set_up_signing(vehicle, link, peer, signing, lambda: 0.0, lambda: sent.append("kept"))
    assert sent == []


async def test_a_key_that_cannot_be_kept_is_not_sent():
    sent, link = [], SimpleNamespace(signing=None)
    peer = SimpleNamespace(send=sent.append, send_unsigned=sent.append)

    def keep():
        raise StorageError("the disk is full")

    with pytest.raises(StorageError):
        await set_up_signing(SilentVehicle(0.0), link, peer, LinkSigning(new_key()), lambda: 0.0, keep)
    assert (sent, link.signing) == ([], None)


class SilentVehicle:
    """Disarmed when it was heard last."""

    identity = SimpleNamespace(system_id=1, component_id=1, name="px4-1")

    def __init__(self, heard_ago_s):
        self.telemetry = SimpleNamespace(armed=SimpleNamespace(value=False, age_s=lambda now_s: heard_ago_s))

    @contextlib.asynccontextmanager
    async def messages(self):
        async def nothing():
            await asyncio.Event().wait()
            yield

        yield nothing()


class FakeTime:
    now = 100.0

    def __call__(self):
        return self.now


def drive_probe(answer):
    """A probe on fake time; `answer(signed, told)` says whether and how (signed or not) a question is answered."""
    clock, answers, told = FakeTime(), [], [0]

    def ask(message, signed):
        signed_answer = answer(signed, told[0])
        if signed_answer is not None:
            answers.append((message.ts1, signed_answer))

    def tell():
        told[0] += 1

    probe = SigningProbe(
        (1, 1),
        tell=tell,
        ask_signed=lambda m: ask(m, True),
        ask_unsigned=lambda m: ask(m, False),
        clock=clock,
    )
    probe.start()
    while not probe.finished:
        while answers:
            stamp, is_signed = answers.pop(0)
            probe.handle(
                SimpleNamespace(
                    get_type=lambda: "TIMESYNC",
                    get_srcSystem=lambda: 1,
                    get_srcComponent=lambda: 1,
                    tc1=1,
                    ts1=stamp,
                    is_signed=is_signed,
                )
            )
        clock.now = max(clock.now, probe.deadline)
        probe.on_time()
    return probe.result(), told[0]


def test_the_probe_tells_a_key_that_is_enforced_from_one_that_is_not_and_from_none():
    proof, told = drive_probe(lambda signed, told: True if signed and told >= 3 else None)
    assert proof.proved
    assert told == 3
    proof, _ = drive_probe(lambda signed, told: True)
    assert (proof.proved, proof.signed_answers > 0) == (False, True)
    assert "not enforced" in proof.words
    proof, _ = drive_probe(lambda signed, told: False)  # a vehicle that knows nothing of signing answers all, unsigned
    assert (proof.proved, proof.signed_answers) == (False, 0)
    proof, _ = drive_probe(lambda signed, told: None)
    assert (proof.proved, proof.signed_answers) == (False, 0)
