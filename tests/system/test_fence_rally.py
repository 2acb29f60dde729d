"""Plans with a fence and rally points: proved before arming, and never in the way of somebody else's fence."""

import asyncio

import pytest
import yaml

from gcs.services.plan_service import plan_to_directory
from gcs.services.transfer_commands import upload_plan
from gcs.storage.plan_files import read_plan

pytestmark = pytest.mark.system

ARM = "400"
FENCE = [[-60, -60], [120, -60], [120, 60], [-60, 60]]


@pytest.fixture(scope="module")
def fenced_plan(tmp_path_factory, small_plan):
    """The small plan's inspection, inside a fence and with a rally point."""
    folder = tmp_path_factory.mktemp("plans")
    scenario = read_plan(small_plan).scenario.model_dump(mode="json", exclude_none=True)
    scenario["fence"] = {"include": [FENCE]}
    scenario["rally_m"] = [[-30, -20, 0]]
    (folder / "fenced.yaml").write_text(yaml.safe_dump(scenario))
    plan_to_directory(folder / "fenced.yaml", folder / "fenced")
    return folder / "fenced"


async def test_it_is_flown_with_its_fence_and_rally_points_on_the_vehicle(gcs, vehicle, fenced_plan, tmp_path):
    async def one(kind, mode):
        flown = vehicle(kind, plan=fenced_plan)
        told = await gcs(
            "fly", fenced_plan, "--connect", flown.url, "--yes", flown.name, "--json", "--mode", mode,
            "--data", tmp_path / kind,
        )  # fmt: skip
        assert told.status == 0, told.text
        assert told.summary["ok"], told.summary
        named = "the vehicle tells the id of the very list that was sent"
        assert f"fence: {named if kind == 'px4' else 'read back 4 of 4 items'}" in told.text
        assert f"rally points: {named if kind == 'px4' else 'read back 1 of 1 items'}" in told.text

    async with asyncio.TaskGroup() as group:
        group.create_task(one("px4", "mission"))
        group.create_task(one("ardupilot", "offboard"))


async def test_somebody_elses_fence_must_be_accepted_by_name(gcs, vehicle, small_plan, fenced_plan, tmp_path):
    flown = vehicle("px4", plan=small_plan)
    await upload_plan(fenced_plan, flown.url, lambda line: None)
    told = await gcs("fly", small_plan, "--connect", flown.url, "--yes", flown.name, "--json", "--data", tmp_path)
    assert told.status == 5, told.text
    assert "fence (the vehicle holds a fence of 4 items that this plan did not bring" in told.lines[-1]
    assert ARM not in flown.truth["commands"]
