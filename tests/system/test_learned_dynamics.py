"""What one flight teaches of a vehicle is known at the next; and without a mode the prediction chooses."""

import pytest

pytestmark = pytest.mark.system

PATIENT = ("--param", "COM_OF_LOSS_T=3")


async def test_the_second_flight_starts_with_the_drag_that_the_first_has_shown(
    gcs, vehicle, small_plan, tmp_path, records
):
    data = tmp_path / "data"

    async def fly(number):
        drone = vehicle("px4", "--body", "sih", *PATIENT, plan=small_plan, speedup=2, card=tmp_path / f"card-{number}")
        options = ("--mode", "offboard", "--yes", drone.name, "--json", "--data", data)
        told = await gcs("fly", small_plan, "--connect", drone.url, *options)
        assert told.status == 0, told.text
        return told

    first = await fly(1)
    (row,) = records(data).rows("select vehicle, drag_s, drag_sigma_s, tilt_lag_s from learned_dynamics")
    print(row)
    assert row[0] == "px4-1"
    assert row[1] == pytest.approx(1.0, abs=0.15), "1 N s/m at 1 kg"
    assert 0.0 < row[2] <= 0.25
    assert row[3] == pytest.approx(0.25, abs=0.1)
    second = await fly(2)
    assert "a usual drag of 0.35" in first.text
    assert "the drag that it showed in flight" in second.text

    def fed_at_first(told):
        line = next(line for line in told.text.splitlines() if "learned in flight: " in line)
        return float(line.split(", ")[1].split()[0]) if "drag" in line else 0.0

    assert fed_at_first(second) > 0.4
    worst = [told.summary["max_cross_track_m"] for told in (first, second)]
    print(worst)
    assert worst[1] <= worst[0] + 0.1


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_without_a_mode_both_are_predicted_and_one_is_chosen(gcs, vehicle, small_plan, tmp_path, records, kind):
    drone = vehicle(kind, *(PATIENT if kind == "px4" else ()), plan=small_plan, speedup=3, card=tmp_path / "card")
    data = tmp_path / "data"
    told = await gcs("fly", small_plan, "--connect", drone.url, "--yes", drone.name, "--json", "--data", data)
    assert told.status == 0, told.text
    ((mode,),) = records(data).rows("select mode from flights")
    (said,) = [line for line in told.text.splitlines() if f"prepared for {drone.name}, " in line]
    print(said)
    assert f"prepared for {drone.name}, {mode}: fly it {'as a mission' if mode == 'mission' else 'offboard'}" in said
    assert "mission " in said
    assert "setpoints " in said
    assert "with the vehicle's own settings" in said
