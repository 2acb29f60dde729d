"""A vehicle that does not answer, or is not heard any more: said once, with exit status 4 (safety rule 9)."""

import pytest

from gcs.core.errors import LinkError
from gcs.services import fly_command

pytestmark = pytest.mark.system


async def fly(plan, url, data, say):
    async def confirm(name):
        return name

    return await fly_command.fly_plan(plan, url, mode="mission", confirm=confirm, accept=(), data_dir=data, say=say)


async def test_nobody_answers(small_plan, tmp_path, monkeypatch):
    assert fly_command.VEHICLE_TIMEOUT_S == 30.0
    monkeypatch.setattr(fly_command, "VEHICLE_TIMEOUT_S", 0.5)
    outcome = await fly(small_plan, "udpin:127.0.0.1:0", tmp_path, print)
    assert isinstance(outcome.failure, LinkError)
    assert outcome.failure.exit_status == 4
    summary = outcome.as_json()
    assert (summary["ok"], summary["proved"], summary["viewpoints"], summary["reached"]) == (False, False, 4, 0)
    assert len(summary["problems"]) == 1


async def test_a_vehicle_that_vanishes_in_flight(vehicle, small_plan, tmp_path, records, monkeypatch):
    monkeypatch.setattr(fly_command, "GIVE_UP_S", 6.0)
    flown = vehicle("px4", plan=small_plan, speedup=3)
    said = []

    def say(line):
        said.append(line)
        if "reached" in line:
            flown.ask("vanish")

    outcome = await fly(small_plan, flown.url, tmp_path, say)
    assert isinstance(outcome.failure, LinkError)
    assert "not heard for" in str(outcome.failure)
    assert outcome.as_json()["ok"] is False
    assert records(tmp_path).rows("select state from flights") == [("unknown",)]
    assert any("unknown: the vehicle is not heard" in line for line in said)
