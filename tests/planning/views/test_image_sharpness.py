"""Focus, blur and skew of a flown trajectory's pictures, and that the certificate fails when they are too much."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.core.plan import Plan
from gcs.core.progress import SilentProgress
from gcs.planning.certificates import CertificateError, certify, check_sharpness, recheck
from gcs.planning.views.image_sharpness import measure_sharpness, passing_speeds_m_s

CARRIED = {"coverage": None, "tour_cost": 1.0, "tour_lower_bound": 0.9, "energy_wh": 5.0, "open_sky": 1.0}


def changed(scenario, hover_speed_m_s=0.1, **camera):
    return scenario.model_copy(
        update={
            "camera": scenario.camera.model_copy(update=camera),
            "vehicle": scenario.vehicle.model_copy(update={"hover_speed_m_s": hover_speed_m_s}),
        }
    )


def certified(flight, scenario, distance, viewpoints=None):
    views = flight.viewpoints if viewpoints is None else viewpoints
    return certify(flight.built, flight.path_m, views, scenario, distance, SilentProgress(), **CARRIED)


def failures(flight, scenario, viewpoints=None):
    views = flight.viewpoints if viewpoints is None else viewpoints
    sharpness = measure_sharpness(flight.built.trajectory, views, scenario)
    return {check.name: check.message for check in check_sharpness(sharpness, scenario) if not check.ok}


def test_drift_alone_blurs_a_picture_taken_at_rest(tower_flight, tower_scenario, tower_distance):
    scenario = changed(tower_scenario, 0.2, exposure_s=1 / 200, shutter="rolling", readout_s=0.015)
    found = certified(tower_flight, scenario, tower_distance)
    assert found.max_blur_px == pytest.approx(0.2 / 200 / 0.002, rel=1e-6)
    assert found.max_skew_px == pytest.approx(0.2 * 0.015 / 0.002, rel=1e-6)


def test_nothing_is_said_of_what_the_camera_does_not_state(tower_flight, tower_scenario, tower_distance):
    found = certified(tower_flight, tower_scenario, tower_distance)
    assert found.max_blur_px is None
    assert found.max_skew_px is None
    assert failures(tower_flight, tower_scenario) == {}


def test_speed_is_that_of_the_curve_at_the_exposure(tower_flight, tower_scenario):
    """A picture in mid-leg is blurred by the flown speed, drift on top; the worst viewpoint is named."""
    curve = tower_flight.built.trajectory
    moving = replace(tower_flight.viewpoints[1], name="M", time_s=tower_flight.viewpoints[1].time_s + 4.0, gsd_m=0.003)
    views = [tower_flight.viewpoints[0], moving, tower_flight.viewpoints[3]]
    step = 1e-4
    flown = np.linalg.norm(curve.value(moving.time_s + step) - curve.value(moving.time_s - step)) / (2 * step)
    assert flown > 0.5
    scenario = changed(tower_scenario, 0.3, exposure_s=1 / 1000)
    sharpness = measure_sharpness(curve, views, scenario)
    assert sharpness.blur.viewpoint == "M"
    assert sharpness.max_blur_px == pytest.approx((flown + 0.3) / 1000 / 0.003, rel=1e-6)


@pytest.mark.parametrize(
    ("camera", "drift", "name"),
    [
        ({"exposure_s": 1 / 100}, 0.21, "max_blur_px"),
        ({"shutter": "rolling", "readout_s": 0.03, "max_skew_px": 1.0}, 0.08, "max_skew_px"),
        ({"f_number": 1.4, "blur_circle_px": 0.5, "nearest_focus_m": 12.0}, 0.0, "focus"),
    ],
)
def test_too_much_fails_the_certificate_and_names_the_viewpoint(
    tower_flight, tower_scenario, tower_distance, camera, drift, name
):
    scenario = changed(tower_scenario, drift, **camera)
    closest = replace(tower_flight.viewpoints[2], name="CLOSE", gsd_m=0.0019)
    views = [*tower_flight.viewpoints[:2], closest, tower_flight.viewpoints[3]]
    with pytest.raises(CertificateError, match=f"{name}.*CLOSE"):
        certified(tower_flight, scenario, tower_distance, views)
    assert set(failures(tower_flight, scenario, views)) == {name}


def test_at_the_limit_it_holds(tower_flight, tower_scenario):
    c = tower_scenario.camera.model_copy(update={"exposure_s": 1 / 100, "shutter": "rolling", "readout_s": 0.03})
    fastest = c.fastest_m_s(c.distance_for_gsd(0.002))
    limits = {"exposure_s": 1 / 100, "shutter": "rolling", "readout_s": 0.03}
    assert failures(tower_flight, changed(tower_scenario, fastest, **limits)) == {}
    assert failures(tower_flight, changed(tower_scenario, fastest * 1.01, **limits)) != {}
    focus = c.distance_for_gsd(0.002)
    assert failures(tower_flight, changed(tower_scenario, f_number=2.8, nearest_focus_m=focus)) == {}


def plan_with(flight, scenario, certificates):
    return Plan(
        scenario=scenario,
        cables=(),
        viewpoints=tuple(flight.viewpoints),
        path_m=flight.path_m,
        path_stops=flight.path_stops,
        corridor_m=flight.built.corridor_m,
        trajectory=flight.built.trajectory,
        yaw=flight.built.yaw,
        gimbal_pitch=flight.built.gimbal_pitch,
        coverage=None,
        certificates=certificates,
        stages_s={},
    )


@pytest.mark.parametrize(
    ("told", "finds"),
    [({}, set()), ({"max_blur_px": 0.1}, {"recorded max_blur_px"}), ({"max_blur_px": None}, {"recorded max_blur_px"})],
)
def test_a_recorded_figure_is_computed_again(tower_flight, tower_scenario, tower_distance, told, finds):
    scenario = changed(tower_scenario, exposure_s=1 / 200)
    certificates = replace(certified(tower_flight, scenario, tower_distance), **told)
    checks = recheck(plan_with(tower_flight, scenario, certificates), tower_distance)
    assert {check.name for check in checks if not check.ok} == finds


def test_a_plan_with_a_slower_shutter_is_found_out(tower_flight, tower_scenario, tower_distance):
    scenario = changed(tower_scenario, exposure_s=1 / 200)
    certificates = certified(tower_flight, scenario, tower_distance)
    slow = changed(tower_scenario, exposure_s=1 / 20)
    checks = recheck(plan_with(tower_flight, slow, certificates), tower_distance)
    assert {check.name for check in checks if not check.ok} == {"max_blur_px", "recorded max_blur_px"}


def flown_through(scenario, **camera):
    planner = scenario.planner.model_copy(update={"viewpoints": "fly_through"})
    return changed(scenario, **camera).model_copy(update={"planner": planner})


def test_a_picture_in_flight_may_be_as_blurred_and_skewed_as_the_camera_says(tower_flight, tower_scenario):
    """At the speed that is given for a view, blur or skew computed by hand is at its limit, drift counted in."""
    scenario = flown_through(tower_scenario, exposure_s=1 / 400, shutter="rolling", readout_s=0.02, max_skew_px=3.0)
    views = [replace(tower_flight.viewpoints[k], gsd_m=gsd) for k, gsd in enumerate((0.001, 0.002, 0.004))]
    speeds = passing_speeds_m_s(views, scenario)
    for view, speed in zip(views, speeds, strict=True):
        blur, skew = (speed + 0.1) / 400 / view.gsd_m, (speed + 0.1) * 0.02 / view.gsd_m
        assert max(blur / 1.0, skew / 3.0) == pytest.approx(1.0) or speed == 0.0
    assert speeds[0] == 0.0, "0.05 m/s would not even cover the drift"
    assert (speeds[1:] > 0).all()


def test_the_vehicle_stops_where_blur_is_not_known_or_a_hold_is_asked(tower_flight, tower_scenario):
    views = [replace(tower_flight.viewpoints[0], hold_s=3.0), *tower_flight.viewpoints[1:]]
    assert not passing_speeds_m_s(views, flown_through(tower_scenario)).any()
    assert not passing_speeds_m_s(views, flown_through(tower_scenario, exposure_s=1e-3, shutter="rolling")).any()
    assert not passing_speeds_m_s(views, changed(tower_scenario, exposure_s=1e-3)).any(), "as it was not asked for"
    assert (passing_speeds_m_s(views, flown_through(tower_scenario, exposure_s=1e-3)) > 0).tolist() == [
        False,
        True,
        True,
        True,
    ]


def test_a_picture_in_flight_of_unknown_blur_is_found(tower_flight, tower_scenario):
    views = [replace(v, stops=v.id != 2) for v in tower_flight.viewpoints]
    assert set(failures(tower_flight, tower_scenario, views)) == {"unjudged_blur"}
    assert failures(tower_flight, changed(tower_scenario, exposure_s=1e-3), views) == {}
