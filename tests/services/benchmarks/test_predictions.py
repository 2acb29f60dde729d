"""Predictions beside recorded flights of real autopilots (skipped where the records are not there)."""

from pathlib import Path

import pytest

from gcs.core.errors import InputError
from gcs.core.vehicle import Autopilot
from gcs.services.benchmarks.flown_records import read_curve, read_flights
from gcs.services.benchmarks.predictions import leave_one_out, misses, run

RECORDS = Path(__file__).resolve().parents[4] / "shared" / "records"
GRIDS = {
    Autopilot.ARDUPILOT: ((0.2, 0.35, 0.5), (0.05, 0.1)),
    Autopilot.PX4: ((0.7, 1.0, 1.3), (0.08, 0.11)),
}


@pytest.mark.skipif(not RECORDS.is_dir(), reason="no recorded flights here")
@pytest.mark.parametrize("autopilot", list(GRIDS))
def test_every_recorded_flight_is_predicted_from_the_others(autopilot):
    curve = read_curve(RECORDS / autopilot.value / "dense")
    flights = read_flights(RECORDS, autopilot)
    assert len(flights) == {Autopilot.ARDUPILOT: 9, Autopilot.PX4: 7}[autopilot]
    for flight, airframe, found in leave_one_out(curve, flights, *GRIDS[autopilot]):
        said = (
            f"{flight.name}: {found.time_s:.1f} of {flight.time_s} s, {found.max_m:.2f} of {flight.max_deviation_m} m"
        )
        assert found.complete, said
        assert max(misses(flight, found)) <= 1.0, f"{said} with {airframe}"


def test_without_records_there_is_the_law_of_dense_waypoints():
    rows = run(True)
    laws = [row for row in rows if row.figure == "speed_m_s"]
    assert len(laws) == 8
    assert all(row.value == pytest.approx(row.reference_value, rel=0.1) for row in laws)


def test_a_folder_without_records_is_named(tmp_path):
    with pytest.raises(InputError, match="not a recorded curve"):
        run(True, tmp_path)
