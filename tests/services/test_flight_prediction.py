"""What is said before a plan is flown: the mission's route, both forecasts, the choice, and the refusal."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gcs.api.views import preflight_info
from gcs.core.errors import InputError
from gcs.core.flight_law import ArduPilotLaw, Px4Law
from gcs.core.frames import geodetic_from_enu
from gcs.core.learned_dynamics import NOTHING_LEARNED, Estimate, LearnedDynamics
from gcs.core.mission import Command, Mission, MissionItem
from gcs.core.vehicle import Autopilot
from gcs.mavlink.autopilots.ardupilot import ArduPilot
from gcs.mavlink.autopilots.px4 import Px4
from gcs.planning.scene.point_distance import SceneDistance
from gcs.services.flight_prediction import mission_route, needed_clearance_m, predict_flights
from gcs.services.flight_types import PreflightReport
from gcs.services.mission_files import mission_of_plan
from gcs.services.mission_fitting import USUAL_SAMPLING, FittedMission, predict_usual_flights
from gcs.services.preflight import check_prediction
from gcs.services.vehicle_model import vehicle_model

PX4 = vehicle_model(Autopilot.PX4)


@pytest.fixture
def scene(small_structure):
    return SceneDistance(small_structure, 0.0)


def checked(found, *, offboard):
    (check,) = check_prediction(FittedMission(Mission(()), USUAL_SAMPLING, found), offboard=offboard)
    return check


def at(plan, east, north, up):
    latitude, longitude, altitude = geodetic_from_enu(np.array([east, north, up]), plan.scenario.anchor.point)
    return round(float(latitude) * 1e7), round(float(longitude) * 1e7), round(float(altitude), 2)


def mission_through(plan, *points, radius=0.5):
    """Take-off to 10 m, waypoints without holds, landing; in PX4's words."""
    nothing = (0.0, 0.0, 0.0, 0.0)
    items = [MissionItem(0, 5, Command.NAV_TAKEOFF, nothing, *at(plan, 0, 0, 10))]
    items += [MissionItem(0, 5, Command.NAV_WAYPOINT, (0.0, radius, 0.0, 0.0), *at(plan, *p)) for p in points]
    items += [MissionItem(0, 5, Command.NAV_LAND, nothing, *at(plan, 0, 0, 0))]
    return Mission(tuple(replace(item, sequence=k) for k, item in enumerate(items)))


@pytest.mark.parametrize("autopilot", [Autopilot.PX4, Autopilot.ARDUPILOT])
def test_a_missions_items_are_places_holds_and_speeds(small_plan, autopilot):
    mission = mission_of_plan(small_plan, autopilot)
    route = mission_route(small_plan, mission, home_is_first=autopilot is Autopilot.ARDUPILOT)
    corners = [[0, 0, 0], [0, 0, 10], [8, 0, 10], [0, 0, 10], [0, 0, 10]]
    assert len(route.points_m) == len(corners)
    assert abs(route.points_m - corners).max() < 0.2
    assert route.speed_m_s == small_plan.scenario.vehicle.max_speed_m_s
    # At the viewpoint it stays for its hold and both delays; take-off and landing are stops.
    assert route.hold_s[2] > 3.0
    assert (route.hold_s[[1, 4]] > 0).all()
    delays = sum(i.params[0] for i in mission.items if i.command == Command.NAV_DELAY)
    assert route.hold_s[2] == pytest.approx(delays + 1.0)


def test_both_ways_are_predicted_and_the_sentence_says_which_is_better(small_plan, scene):
    found = predict_usual_flights(small_plan, scene)
    assert [f.autopilot for f in found] == [Autopilot.PX4, Autopilot.ARDUPILOT]
    for f in found:
        assert f.needed_clearance_m == needed_clearance_m(small_plan)
        assert f.mission.time_s > f.offboard.time_s
        # 3.5 m are left at the viewpoint, which both come to
        assert f.mission.min_clearance_m == pytest.approx(3.5, abs=0.3)
        assert f.mission.keeps(f.needed_clearance_m)
        assert f.mission.max_deviation_m < 1.0
        assert ("needs no stream" in f.why) == (f.choice == "mission")
        assert ("much quicker" in f.why) == (f.choice == "offboard")
        assert (f.choice == "offboard") == (f.mission.time_s - f.mission.waits_s > 1.5 * f.offboard.time_s)
        assert f.as_json()["mission"]["time_s"] == f.mission.time_s


def test_the_api_tells_a_prediction_in_full(small_plan, scene):
    for f in predict_usual_flights(small_plan, scene):
        report = PreflightReport("flight-1", "now", (), f)
        told = preflight_info(report).prediction.model_dump(mode="json")
        assert told == json.loads(json.dumps(f.as_json()))
        assert told["basis"] == "usual settings; a usual drag of 0.35 m/s² per m/s, as it has shown none yet"
        assert told["mission_items"] == len(mission_of_plan(small_plan, f.autopilot).items)


def test_a_vehicle_that_has_shown_its_drag_is_predicted_with_it(small_plan, scene):
    """Missions of a vehicle with much drag wait for it; what that does to deviations, see the recorded flights."""
    mission = mission_of_plan(small_plan, Autopilot.PX4)
    usual, dragged = (
        predict_flights(small_plan, scene, mission, vehicle_model(Autopilot.PX4, None, learned))
        for learned in (NOTHING_LEARNED, LearnedDynamics(drag=Estimate(1.2, 0.1)))
    )
    assert dragged.mission.time_s > usual.mission.time_s + 0.5
    assert dragged.offboard != usual.offboard
    assert "showed in flight, 1.20" in dragged.line


def test_setpoints_are_predicted_only_where_the_station_sends_them(small_plan, scene):
    """In the columns over home the autopilot takes off and lands, however wide the stream would be flown there."""
    mission = mission_of_plan(small_plan, Autopilot.PX4)
    model = vehicle_model(Autopilot.PX4, None, LearnedDynamics(drag=Estimate(1.4, 0.2)))
    found = predict_flights(small_plan, scene, mission, model).offboard
    assert found.place_m[2] > 9.0, "it comes nearest to the box and not to the ground beside home"
    assert found.time_s == pytest.approx(small_plan.trajectory.duration_s, abs=3.0)
    assert 8.0 < found.at_s < 14.0


def test_other_autopilots_are_not_predicted():
    assert vehicle_model(Autopilot.GENERIC) is None
    assert check_prediction(FittedMission(Mission(()), USUAL_SAMPLING, None), offboard=False) == []


def test_a_mission_that_comes_too_near_is_refused_and_offboard_suggested(small_plan, scene):
    near = mission_through(small_plan, (10.9, 0, 10))
    found = predict_flights(small_plan, scene, near, PX4)
    assert found.choice == "offboard"
    assert found.mission.min_clearance_m == pytest.approx(0.8, abs=0.3)
    check = checked(found, offboard=False)
    assert check.state == "refused"
    assert "m too near at (10." in check.detail
    assert "--mode offboard" in check.detail
    assert checked(found, offboard=True).state == "ok"


def test_it_is_the_flown_corner_that_counts_and_not_the_waypoints(small_plan, scene):
    # All legs keep 2.5 m from the box, 2 m from the hull; a wide acceptance radius lets the corner be cut.
    around = ((0.0, -4.5, 10), (18.5, -4.5, 10), (18.5, 12.0, 10), (0.0, 12.0, 10))
    small, wide = (
        predict_flights(small_plan, scene, mission_through(small_plan, *around, radius=r), PX4).mission
        for r in (0.5, 5.0)
    )
    assert small.min_clearance_m == pytest.approx(2.0, abs=0.3)
    assert wide.min_clearance_m < small.min_clearance_m - 0.3
    assert wide.time_s < small.time_s


def test_a_prediction_against_setpoints_needs_acceptance(small_plan, scene):
    found = predict_flights(small_plan, scene, mission_of_plan(small_plan, Autopilot.PX4), PX4)
    bad = replace(found, offboard=replace(found.offboard, min_clearance_m=0.2))
    assert checked(bad, offboard=True).state == "needs_acceptance"
    assert checked(bad, offboard=False).state == "ok"


def test_a_mission_without_a_place_is_refused(small_plan):
    with pytest.raises(InputError, match="names no place"):
        mission_route(small_plan, Mission(()), home_is_first=False)


def test_parameters_become_the_law():
    told = dict.fromkeys(Px4().limit_parameters) | {
        "MPC_XY_CRUISE": 7.0,
        "MPC_Z_V_AUTO_DN": 1.0,
        "MPC_XY_VEL_D_ACC": 0.0,
        "MPC_TILTMAX_AIR": 30.0,
        "MPC_JERK_AUTO": -1.0,
    }
    law = Px4().limits(told).flight_law
    usual = Px4Law()
    assert law == replace(
        usual,
        cruise_m_s=7.0,
        descent_m_s=1.0,
        velocity_gains_s=(*usual.velocity_gains_s[:2], 0.0),
        max_tilt_rad=np.pi / 6,
    )
    told = dict.fromkeys(ArduPilot().limit_parameters) | {
        "WPNAV_RADIUS": 150.0,
        "WPNAV_JERK": 5.0,
        "WPNAV_ACCEL_C": 0.0,
    }
    assert ArduPilot().limits(told).flight_law == ArduPilotLaw(radius_m=1.5, jerk_m_s3=5.0)
