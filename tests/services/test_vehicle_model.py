"""What a prediction knows of a vehicle; and that a flight teaches enough of it to predict the others."""

from pathlib import Path

import numpy as np
import pytest

from gcs.core.flight_law import Airframe, Px4Law
from gcs.core.learned_dynamics import NOTHING_LEARNED, Estimate, LearnedDynamics
from gcs.core.vehicle import Autopilot
from gcs.mavlink.autopilots.ardupilot import ArduPilot
from gcs.mavlink.autopilots.px4 import Px4
from gcs.mavlink.framing import FrameParser
from gcs.mavlink.motion_samples import MotionSampler
from gcs.planning.dynamics.feed_forward import DragEstimator, TiltLagEstimator, known
from gcs.planning.dynamics.flown_path import deviation_from_curve
from gcs.services.benchmarks.flown_records import read_curve, read_flights
from gcs.services.benchmarks.predictions import misses
from gcs.services.vehicle_model import airframe_of, vehicle_model

RECORDS = Path(__file__).resolve().parents[2] / "../shared/records"
UNKNOWN = Estimate(0.0, 1e3)


def limits(stack, **told):
    return stack.limits(dict.fromkeys(stack.limit_parameters) | told)


def test_what_is_not_known_of_a_vehicle_is_usual_and_said_so():
    model = vehicle_model(Autopilot.PX4)
    assert (model.law, model.airframe, model.fed_drag_1_s) == (Px4Law(), Airframe(), Airframe().drag_1_s)
    assert model.basis == "usual settings; a usual drag of 0.35 m/s² per m/s, as it has shown none yet"


def test_parameters_that_a_vehicle_did_not_tell_are_named():
    stack = Px4()
    all_told = dict.fromkeys(stack.limit_parameters, 1.0)
    assert "usual" not in vehicle_model(Autopilot.PX4, stack.limits(all_told)).basis.split(";")[0]
    without = stack.limits(all_told | {"MPC_XY_P": None, "MPC_XY_VEL_I_ACC": None})
    assert without.law_defaults == ("MPC_XY_P", "MPC_XY_VEL_I_ACC")
    assert (
        "usual ones for MPC_XY_P, MPC_XY_VEL_I_ACC, which it did not tell"
        in vehicle_model(Autopilot.PX4, without).basis
    )


@pytest.mark.parametrize(
    ("told", "degrees"),
    [
        ({"ANGLE_MAX": 3000.0, "PSC_ANGLE_MAX": 0.0}, 30.0),
        ({"ANGLE_MAX": 3000.0, "PSC_ANGLE_MAX": 20.0}, 20.0),
        ({"ANGLE_MAX": 4500.0}, 45.0),
        ({}, None),
    ],
)
def test_the_tilt_that_ardupilots_position_control_may_use(told, degrees):
    found = limits(ArduPilot(), **told).max_tilt_rad
    assert found is None if degrees is None else found == pytest.approx(np.radians(degrees))


def test_gains_are_read_from_ardupilot_too():
    law = limits(
        ArduPilot(), PSC_POSXY_P=1.5, PSC_VELXY_P=3.0, PSC_VELXY_I=0.0, PSC_POSZ_P=2.0, PSC_VELZ_P=4.0, ATC_INPUT_TC=0.2
    ).flight_law
    assert (law.position_gain_s, law.velocity_gains_s) == (1.5, (3.0, 0.0, 0.5))
    assert (law.vertical_position_gain_s, law.vertical_velocity_gain_s, law.input_time_s) == (2.0, 4.0, 0.2)


def test_what_flights_have_shown_is_the_airframe_of_later_predictions():
    learned = LearnedDynamics(Estimate(1.0, 0.05), Estimate(0.1, 0.02), Estimate(0.22, 0.02))
    model = vehicle_model(Autopilot.PX4, None, learned)
    assert model.airframe == Airframe(1.0, 0.11)
    assert 0.7 < model.fed_drag_1_s < 0.9, "what the next stream is certain of"
    assert "showed in flight, 1.00 m/s² per m/s (27° of tilt at 5 m/s)" in model.basis
    # A drag below nothing and a lag out of all bounds are errors of an estimate, not of a vehicle.
    odd = airframe_of(LearnedDynamics(Estimate(-0.1, 0.1), None, Estimate(0.9, 0.05)))
    assert odd == Airframe(0.0, 0.15)
    assert airframe_of(NOTHING_LEARNED) == Airframe()


def test_one_recorded_flight_teaches_enough_to_predict_the_others():
    """Limits as for predictions with an airframe fitted to the other flights.

    Without the mission of half a metre's radius: whether it misses a waypoint and turns back hangs on millimetres.
    """
    if not (RECORDS / "px4").is_dir():
        pytest.skip("no recorded flights here")
    sampler, drag, tilt_lag, parser = MotionSampler(), DragEstimator(), TiltLagEstimator(), FrameParser()
    data = (RECORDS / "px4/offboard_circles_gaps.tlog").read_bytes()
    at = 0
    while at + 10 < len(data):
        size = data[at + 9] + (25 if data[at + 10] & 1 else 12)
        for message in parser.feed(data[at + 8 : at + 8 + size]):
            sample = None if message is None else sampler.take(message)
            if sample is not None:
                drag.add(sample)
                tilt_lag.add(sample)
        at += 8 + size
    airframe = airframe_of(known(drag.estimate, UNKNOWN, tilt_lag.estimate))
    curve = read_curve(RECORDS / "px4/dense")
    flights = [f for f in read_flights(RECORDS, Autopilot.PX4) if not f.name.endswith("r0.5")]
    assert len(flights) >= 6
    learned = [misses(f, deviation_from_curve(f.predicted(curve, airframe), curve.position_m)) for f in flights]
    usual = [misses(f, deviation_from_curve(f.predicted(curve, Airframe()), curve.position_m)) for f in flights]
    assert max(max(m) for m in learned) <= 1.0
    assert max(max(m) for m in usual) > 1.0, "which is why it is learned"
