"""`gcs fly`: both ways to fly, both kinds of vehicle, over good links and bad ones."""

import pytest

pytestmark = pytest.mark.system

# The stream of a sped-up flight passes through two processes of a machine that may be busy with other things; with
# PX4's usual second of patience a pause of a fifth of a second of ours would already be the stream's loss.
PATIENT = {"px4": ("--param", "COM_OF_LOSS_T=3"), "ardupilot": ()}


@pytest.mark.parametrize("loss", ["0", "0.1"])
@pytest.mark.parametrize("mode", ["mission", "offboard"])
@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_a_plan_is_flown_and_every_image_is_here(kind, mode, loss, gcs, vehicle, crane_plan, tmp_path, is_whole):
    extra = PATIENT[kind] if mode == "offboard" else ()
    flown = vehicle(kind, "--loss", loss, *extra, speedup=12 if mode == "mission" else 6, card=tmp_path / "card")
    data = tmp_path / "data"
    told = await gcs(
        "fly", crane_plan, "--connect", flown.url, "--mode", mode, "--yes", flown.name, "--json", "--data", data
    )
    summary = told.summary
    print(told.seconds, summary)
    assert told.status == 0, told.text
    assert summary["ok"] is True
    assert summary["proved"] is (mode == "mission")
    assert summary["reached"] == summary["viewpoints"] == 18
    assert summary["images_received"] == summary["images_expected"] == 18
    assert summary["problems"] == []
    assert 0.0 < summary["max_cross_track_m"] < (2.0 if mode == "mission" else 1.0)
    assert 0.0 < summary["duration_s"] < told.seconds
    is_whole(flown, crane_plan, data)
    truth = flown.truth
    assert not truth["armed"]
    assert truth["forced_arms"] == 0
