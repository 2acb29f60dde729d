"""A plan whose pictures are taken in flight, streamed to simulated vehicles of both kinds."""

import asyncio

import numpy as np
import pytest
import yaml

from gcs.core.scenario import parse_scenario
from gcs.services.image_account import scene_position
from gcs.services.image_metadata import read_metadata
from gcs.services.plan_service import plan_to_directory
from gcs.services.plan_verification import verify_plan
from gcs.storage.mesh_files import load_structure, sample_scenario
from gcs.storage.plan_files import read_plan

pytestmark = pytest.mark.system

PATIENT = {"px4": ("--param", "COM_OF_LOSS_T=3"), "ardupilot": ()}


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    """The first seven points of the sample crane, the fourth with a hold; stopping everywhere, and flying through."""
    folder = tmp_path_factory.mktemp("fly-through")
    scenario = sample_scenario("gantry-crane")
    scenario["camera"] |= {"exposure_s": 0.001, "min_interval_s": 0.8}
    structure, _ = load_structure(parse_scenario(scenario).structure, folder)
    points = [point.model_dump(mode="json", exclude_none=True) for point in structure.named_points[:7]]
    points[3]["hold_s"] = 3.0
    scenario["inspection"] = {"points": points}
    for mode in ("stop", "fly_through"):
        scenario["planner"] = {"viewpoints": mode}
        (folder / f"{mode}.yaml").write_text(yaml.safe_dump(scenario))
        plan_to_directory(folder / f"{mode}.yaml", folder / mode)
    return folder


def test_the_written_plan_is_verified_and_quicker(plans):
    stopping, passing = read_plan(plans / "stop"), read_plan(plans / "fly_through")
    assert [v.name for v in passing.viewpoints if v.stops] == [v.name for v in stopping.viewpoints if v.hold_s]
    assert passing.certificates.duration_s < 0.9 * stopping.certificates.duration_s
    assert all(check.ok for check in verify_plan(plans / "fly_through"))


async def test_pictures_are_taken_in_passing_near_their_places(gcs, vehicle, plans, tmp_path, records, is_whole):
    async with asyncio.TaskGroup() as group:
        for kind in PATIENT:
            group.create_task(_flown(kind, gcs, vehicle, plans / "fly_through", tmp_path, records, is_whole))


async def _flown(kind, gcs, vehicle, folder, tmp_path, records, is_whole):
    card, data, plan = tmp_path / f"card-{kind}", tmp_path / f"data-{kind}", read_plan(folder)
    drone = vehicle(kind, *PATIENT[kind], plan=folder, speedup=1, card=card)  # a late shutter is a missed picture
    told = await gcs(
        "fly", folder, "--connect", drone.url, "--mode", "offboard", "--yes", drone.name, "--json", "--data", data
    )
    assert told.status == 0, told.text
    assert told.summary["images_received"] == told.summary["images_expected"] == len(plan.viewpoints)
    is_whole(drone, folder, data)
    files = {name: file for file, (_, name) in records(data).images(drone).items()}
    misses = []
    for view in plan.viewpoints:
        told_by_camera = read_metadata((card / "vehicle-1" / files[view.name]).read_bytes(), view.name)
        misses.append(np.linalg.norm(np.array(scene_position(plan, told_by_camera.position)) - view.position_m))
    print(kind, np.round(misses, 2))
    assert np.median(misses) < 0.5
