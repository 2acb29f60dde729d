"""`gcs companion` as it is started: what is wrong with its arguments is said in one line, before anything is opened."""

from __future__ import annotations

import hashlib

import pytest

from gcs.core.errors import GcsError, LinkError, NotFoundError, RefusedError
from gcs.services.companion.core import CompanionOptions
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
        assert "--station" in await refused(tmp_path, station=url, token_file=token)
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
