"""The station as a process and over real sockets."""

import asyncio
import os
import signal
import socket
import subprocess
import sys
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
import websockets

from gcs.api.server import announce, listening_socket, run_station
from gcs.api.session_token import session_token
from gcs.api.settings import StationSettings
from gcs.core.errors import ConflictError, InputError
from gcs.storage.data_directory import owned_data_directory

ROOT = Path(__file__).resolve().parents[2]


@asynccontextmanager
async def running_station(data_dir):
    ready: asyncio.Queue[StationSettings] = asyncio.Queue()
    stop = asyncio.Event()
    station = asyncio.create_task(
        run_station(StationSettings(data_dir=data_dir, port=0), ready=ready.put_nowait, stop=stop)
    )
    try:
        yield await asyncio.wait_for(ready.get(), 120)
    finally:
        stop.set()
        await asyncio.wait_for(station, 120)


async def request(settings, text):
    reader, writer = await asyncio.open_connection("127.0.0.1", settings.port)
    writer.write(text.replace("\n", "\r\n").encode())
    answer = await reader.read()
    writer.close()
    await writer.wait_closed()
    return answer.decode()


def test_a_port_that_is_taken_is_named():
    with listening_socket("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} is taken") as caught:
            listening_socket("127.0.0.1", port)
    assert caught.value.field == "--port"
    assert caught.value.exit_status == 2


def test_an_address_of_another_machine_is_named():
    with pytest.raises(InputError) as caught:
        listening_socket("192.0.2.1", 0)
    assert caught.value.field == "--host"


async def test_it_answers_on_the_port_it_says_and_leaves_it_when_it_is_stopped(tmp_path):
    async with running_station(tmp_path) as settings:
        token = session_token(tmp_path)
        head = f"GET /api/status HTTP/1.1\nHost: 127.0.0.1:{settings.port}\nConnection: close\n"
        assert " 200 " in (await request(settings, f"{head}Authorization: Bearer {token}\n\n")).splitlines()[0]
        assert " 401 " in (await request(settings, f"{head}\n")).splitlines()[0]
        evil = f"{head}Authorization: Bearer {token}\nOrigin: http://evil.example\n\n"
        assert " 403 " in (await request(settings, evil)).splitlines()[0]
        two = f"{head}Host: evil.example\nAuthorization: Bearer {token}\n\n"
        assert not (await request(settings, two)).splitlines()[0].endswith("200 OK")
    with socket.socket() as free:
        assert free.connect_ex(("127.0.0.1", settings.port)) != 0


async def test_the_live_stream_over_a_real_socket(tmp_path):
    async with running_station(tmp_path) as settings:
        url = f"ws://127.0.0.1:{settings.port}/api/live"
        bearer = {"Authorization": f"Bearer {session_token(tmp_path)}"}
        async with websockets.connect(url, additional_headers=bearer) as live:
            assert '"type":"snapshot"' in await asyncio.wait_for(live.recv(), 60)
            assert '"type":"heartbeat"' in await asyncio.wait_for(live.recv(), 60)
        for refused in ({}, {**bearer, "Origin": "http://evil.example"}):
            with pytest.raises(websockets.InvalidStatus) as caught:
                async with websockets.connect(url, additional_headers=refused):
                    pass
            assert caught.value.response.status_code == 403


async def test_a_data_directory_in_use_is_one_clear_error(tmp_path):
    with owned_data_directory(tmp_path), pytest.raises(ConflictError, match="another station"):
        await run_station(StationSettings(data_dir=tmp_path, port=0), ready=lambda _: None)


def test_what_is_said_at_the_start(tmp_path, capsys):
    announce(StationSettings(data_dir=tmp_path, port=8080))
    said = capsys.readouterr().out
    assert "http://127.0.0.1:8080" in said
    assert session_token(tmp_path) in said
    assert "other machines: they" not in said
    announce(StationSettings(data_dir=tmp_path, host="0.0.0.0", port=8080))
    assert "reached from other machines" in capsys.readouterr().out


@pytest.mark.system
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_the_process_ends_cleanly_when_it_is_interrupted(tmp_path, how):
    script = (
        f"from pathlib import Path; from gcs.api.server import serve; serve('127.0.0.1', 0, Path({str(tmp_path)!r}))"
    )
    station = subprocess.Popen(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert station.stdout is not None
    assert "gcs is ready: http://127.0.0.1:" in station.stdout.readline()
    station.send_signal(how)
    _, errors = station.communicate(timeout=300)
    assert errors == ""
    assert station.returncode in {0, -how}
