"""A companion that is killed in mid-flight and started again, and one whose link is signed."""

from __future__ import annotations

import contextlib
import math

import pytest

from gcs.storage.plan_files import read_plan

pytestmark = pytest.mark.system

OVER = {"completed", "incomplete", "aborted"}
PASSPHRASE = "correct horse"


@contextlib.asynccontextmanager
async def beside(gcs, port, tmp_path, *extra):
    """A companion, up to where it has met its autopilot; killed when the block ends."""
    url = f"udpin:127.0.0.1:{port}"
    async with gcs.running("companion", "--connect", url, "--keep", tmp_path / "kept", *extra) as told:
        await told.until("beside the autopilot")
        yield told


def speed(truth):
    return math.hypot(*truth["velocity_m_s"])


async def test_a_killed_companion_goes_on_where_it_was_when_the_flight_is_resumed(
    gcs, station, vehicle, small_plan, tmp_path, free_port
):
    port = free_port()
    flown = vehicle("px4", "--companion", str(port), plan=small_plan, speedup=1, card=tmp_path / "card")
    base = await station(small_plan)
    async with beside(gcs, port, tmp_path, "--plan", small_plan):
        flight = await base.prepared(flown, "companion")
        await base.post(f"/flights/{flight}/start", confirm=flown.name)
        await flown.until(lambda truth: truth["captures"] >= 1 and speed(truth) > 0.5)
    await base.until(flight, lambda f: f["state"] == "held")
    before = flown.truth["captures"]
    async with beside(gcs, port, tmp_path) as told:
        shown = await base.until(flight, lambda f: "restarted" in (f["lease"] or {}).get("text", ""))
        assert shown["state"] == "held", "it does not fly by itself"
        await base.post(f"/flights/{flight}/resume", confirm=flown.name)
        done = await base.until(flight, lambda f: f["state"] in OVER)
    texts = [event["text"] for event in base.get(f"/flights/{flight}/events")]
    assert done["state"] == "completed", (done["problems"], texts[-30:], told.text)
    assert before < len(read_plan(small_plan).viewpoints)
    assert flown.truth["captures"] == len(read_plan(small_plan).viewpoints), "no picture twice"


async def test_a_signed_link_takes_the_key_that_was_shared_and_no_other(
    gcs, vehicle, small_plan, tmp_path, free_port, monkeypatch
):
    monkeypatch.setenv("GCS_KEY", PASSPHRASE)
    monkeypatch.setenv("GCS_DATA", str(tmp_path / "data"))
    port = free_port()
    flown = vehicle("px4", "--companion", str(port), plan=small_plan, speedup=1)
    own, key = f"udpin:127.0.0.1:{port}", tmp_path / "key"
    for command in (
        ("set-up", "--connect", flown.url, "--vehicle", flown.name),
        ("share", "--connect", flown.url, "--with", own),
        ("export", "--connect", flown.url, key),
    ):
        told = await gcs("signing", *command)
        assert told.status == 0, told.text
    async with beside(gcs, port, tmp_path) as told:
        assert "another key" not in told.text
    wrong = tmp_path / "wrong"
    wrong.write_text("00" * 31 + "01")
    wrong.chmod(0o600)
    monkeypatch.delenv("GCS_KEY")
    async with beside(gcs, port, tmp_path, "--key-file", key):
        pass
    async with gcs.running("companion", "--connect", own, "--keep", tmp_path / "kept", "--key-file", wrong) as told:
        await told.until("signed with another key")
        assert "beside" not in told.text
    told = await gcs("companion", "--connect", own, "--keep", tmp_path / "kept")
    assert told.status == 2
    assert told.text.count("\n") == 0
    assert "GCS_KEY" in told.text
