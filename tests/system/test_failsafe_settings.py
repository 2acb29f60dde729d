"""A failsafe that is off is set by the station when the operator says so, and then the flight goes ahead."""

import pytest

pytestmark = pytest.mark.system


async def test_a_failsafe_that_is_off_is_set_instead_of_accepted(gcs, vehicle, small_plan, tmp_path, records):
    drone = vehicle("px4", "--param", "NAV_DLL_ACT=0", plan=small_plan, speedup=5, card=tmp_path / "card")
    data = tmp_path / "data"
    fly = ("fly", small_plan, "--connect", drone.url, "--mode", "mission", "--yes", drone.name, "--data", data)
    refused = await gcs(*fly)
    assert refused.status == 5
    assert "accept NAV_DLL_ACT=2" in refused.text
    told = await gcs(*fly, "--accept", "NAV_DLL_ACT=2")
    assert told.status == 0, told.text
    assert "NAV_DLL_ACT of px4-1 was set from 0 to 2, as the operator asked" in told.text
