"""`gcs signing` against a simulated vehicle, and the station that uses the key afterwards."""

import asyncio
import contextlib
import socket
import sys

import pytest

from gcs.core.errors import InputError, LinkError, NotFoundError
from gcs.mavlink import signing_setup
from gcs.mavlink.signing import LinkSigning, Verdict
from gcs.mavlink.station import MavlinkStation
from gcs.services.link_signing import LinkSigningService, key_store
from gcs.services.signing_commands import give_key, prove_key, share_key, take_key_back
from gcs.storage.signing_keys import SigningKeyStore, StoredKey

pytestmark = pytest.mark.system


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


@contextlib.asynccontextmanager
async def simulated(port, autopilot="px4", tcp_port="none"):
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "sitl_mocks", "--autopilot", autopilot, "--port", str(port)),
        *("--tcp-base", str(tcp_port), "--exit-with-parent"),
        stdout=asyncio.subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        process.terminate()
        await asyncio.wait_for(process.wait(), 60.0)


async def test_a_key_is_given_kept_used_at_the_next_start_and_taken_back(tmp_path, monkeypatch):
    monkeypatch.setenv("GCS_KEY", "correct horse")
    url = f"udpin:127.0.0.1:{free_port()}"
    async with simulated(int(url.rsplit(":", 1)[1])):
        proof = await give_key(url, "px4-1", tmp_path, rejects_unsigned=True)
        assert proof.proved
        assert key_store(tmp_path).urls() == (url,)
        station = MavlinkStation()
        await LinkSigningService(station, key_store(tmp_path)).open(url)
        vehicle = await station.wait_for_vehicle(30.0)
        assert await vehicle.read_failsafes()
        await station.close_all()
        monkeypatch.delenv("GCS_KEY")
        with pytest.raises(InputError, match="GCS_KEY"):  # not opened without signing instead
            await LinkSigningService(station, key_store(tmp_path)).open(url)
        assert station.links == ()
        monkeypatch.setenv("GCS_KEY", "correct horse")
        await take_key_back(url, "px4-1", tmp_path)
        assert key_store(tmp_path).urls() == ()


@pytest.mark.parametrize("rotated", [False, True])
async def test_a_key_whose_answers_were_lost_reaches_the_vehicle_at_the_next_start(tmp_path, monkeypatch, rotated):
    monkeypatch.setenv("GCS_KEY", "correct horse")
    url, keys = f"udpin:127.0.0.1:{free_port()}", key_store(tmp_path)
    async with simulated(int(url.rsplit(":", 1)[1])):
        if rotated:
            assert (await give_key(url, "px4-1", tmp_path, rejects_unsigned=True)).proved
        present = keys.get(url)
        with monkeypatch.context() as patch:
            patch.setattr(signing_setup, "TELL_S", 0.02)
            lose_what_is_signed_with_a_pending_key(patch)
            with pytest.raises(LinkError, match="the new key is kept"):
                await give_key(url, "px4-1", tmp_path, rejects_unsigned=True)
        pending = keys.pending(url)
        assert keys.get(url) == present
        assert present is None or present.key != pending.key
        station = MavlinkStation()
        await LinkSigningService(station, key_store(tmp_path)).open(url)
        vehicle = await station.wait_for_vehicle(30.0)
        assert await vehicle.read_failsafes()
        await station.close_all()
        assert (await give_key(url, "px4-1", tmp_path, rejects_unsigned=True)).proved
        assert keys.get(url).key == pending.key
        assert keys.pending(url) is None


def lose_what_is_signed_with_a_pending_key(patch):
    admits, put_pending, kept = LinkSigning.admits, SigningKeyStore.put_pending, []

    def note(keys, url, stored):
        kept.append(LinkSigning(stored.key))
        put_pending(keys, url, stored)

    def admits_others(signing, message):
        return not any(key.judge(message) is Verdict.GOOD for key in kept) and admits(signing, message)

    patch.setattr(SigningKeyStore, "put_pending", note)
    patch.setattr(LinkSigning, "admits", admits_others)


async def test_without_a_passphrase_no_vehicle_is_given_a_key(tmp_path, monkeypatch):
    monkeypatch.delenv("GCS_KEY", raising=False)
    with pytest.raises(InputError, match="GCS_KEY"):
        await give_key("udpin:127.0.0.1:1", "px4-1", tmp_path, rejects_unsigned=True)


async def test_a_second_link_gets_the_key_of_the_first(tmp_path, monkeypatch):
    monkeypatch.setenv("GCS_KEY", "correct horse")
    radio, lte = "serial:/dev/ttyUSB0:57600", "udpin:0.0.0.0:14550"
    keys = key_store(tmp_path)
    with pytest.raises(NotFoundError, match="not signed"):
        share_key(radio, lte, tmp_path)
    keys.put(radio, StoredKey(bytes(range(32)), rejects_unsigned=True))
    share_key(radio, lte, tmp_path)
    assert keys.get(lte) == keys.get(radio)


async def test_a_shared_key_is_proved_on_the_second_link(tmp_path, monkeypatch):
    monkeypatch.setenv("GCS_KEY", "correct horse")
    tcp_port = free_port(socket.SOCK_STREAM)
    udp, tcp = f"udpin:127.0.0.1:{free_port()}", f"tcp:127.0.0.1:{tcp_port}"
    async with simulated(int(udp.rsplit(":", 1)[1]), "ardupilot", tcp_port):
        assert (await give_key(udp, "ardupilot-1", tmp_path, rejects_unsigned=True)).proved
        share_key(udp, tcp, tmp_path)
        assert (await prove_key(tcp, "ardupilot-1", tmp_path)).proved
    key_store(tmp_path).delete(tcp)
    with pytest.raises(NotFoundError, match="not signed"):
        await prove_key(tcp, "ardupilot-1", tmp_path)
