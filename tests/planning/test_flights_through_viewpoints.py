"""Certificates of a flight round the tower whose pictures are taken in flight."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.core.progress import SilentProgress
from gcs.core.scenario import parse_scenario
from gcs.core.trajectory import AngleProfile
from gcs.planning.certificates import check_figures, check_sharpness
from gcs.planning.trajectories.curve_figures import measure
from gcs.planning.trajectories.trajectory_builder import build_trajectory
from gcs.planning.views.image_sharpness import measure_sharpness, passing_speeds_m_s


@pytest.fixture(scope="module")
def scenario(tower_scenario):
    camera = tower_scenario.camera.model_copy(update={"exposure_s": 1 / 1000})
    planner = tower_scenario.planner.model_copy(update={"viewpoints": "fly_through"})
    return tower_scenario.model_copy(update={"camera": camera, "planner": planner})


@pytest.fixture(scope="module")
def passing(tower_flight, scenario):
    """The same tour, flown through all viewpoints but the third, where it holds."""
    views = [replace(v, hold_s=4.0 * (v.id == 2)) for v in tower_flight.viewpoints]
    built = build_trajectory(
        tower_flight.legs,
        np.array([v.yaw_rad for v in views]),
        np.array([v.gimbal_pitch_rad for v in views]),
        scenario,
        SilentProgress(),
        passing_speeds_m_s=passing_speeds_m_s(views, scenario),
        holds_s=np.array([v.hold_s for v in views]),
    )
    timed = zip(views, built.exposures_s, built.stops, strict=True)
    return SimpleNamespace(
        built=built,
        path_m=tower_flight.path_m,
        viewpoints=[replace(v, time_s=float(t), stops=bool(stop)) for v, t, stop in timed],
    )


def failed(flight, scenario, distance, viewpoints=None, **changes):
    views, built = viewpoints or flight.viewpoints, replace(flight.built, **changes)
    figures = measure(built, flight.path_m, views, scenario, distance, SilentProgress())
    checks = [*check_figures(figures, scenario)]
    checks += check_sharpness(measure_sharpness(built.trajectory, views, scenario), scenario)
    return {check.name for check in checks if not check.ok}


def test_a_flight_through_viewpoints_is_certified(passing, scenario, tower_flight, tower_distance):
    assert passing.built.stops.tolist() == [False, False, True, False]
    assert not failed(passing, scenario, tower_distance)
    curve, times = passing.built.trajectory, passing.built.exposures_s
    assert curve.duration_s < tower_flight.built.trajectory.duration_s
    step = 1e-4
    flown = np.linalg.norm(curve.value(times + step) - curve.value(times - step), axis=1) / (2 * step)
    blur = (flown + scenario.vehicle.hover_speed_m_s) / 1000 / 0.002
    assert 0.5 < blur.max() <= 1.0
    assert flown[2] == pytest.approx(0.0, abs=1e-9)
    places = np.array([v.position_m for v in passing.viewpoints])
    assert np.linalg.norm(curve.value(times) - places, axis=1).max() < 1e-3


def test_a_stop_that_is_flown_through_is_found(passing, scenario, tower_distance):
    views = [replace(v, stops=True) for v in passing.viewpoints]
    assert {"rest_speed"} <= failed(passing, scenario, tower_distance, views) <= {"rest_speed", "rest_acceleration"}


def test_too_much_blur_in_flight_is_found(passing, scenario, tower_distance):
    camera = scenario.camera.model_copy(update={"exposure_s": 1 / 500})
    assert failed(passing, scenario.model_copy(update={"camera": camera}), tower_distance) == {"max_blur_px"}


def test_a_hold_that_is_too_short_is_found(passing, scenario, tower_distance):
    views = [replace(v, hold_s=6.0 * (v.id == 2)) for v in passing.viewpoints]
    assert failed(passing, scenario, tower_distance, views) == {"hold"}
    views = [replace(v, hold_s=0.5 * (v.id == 1)) for v in passing.viewpoints]
    assert failed(passing, scenario, tower_distance, views) == {"hold"}


def test_pictures_too_soon_after_each_other_are_found(passing, scenario, tower_distance):
    soonest = float(np.diff(passing.built.exposures_s).min())
    camera = scenario.camera.model_copy(update={"min_interval_s": soonest + 0.01})
    found = failed(passing, scenario.model_copy(update={"camera": camera}), tower_distance)
    assert found == {"picture_interval"}


def test_a_camera_that_turns_during_an_exposure_is_found(passing, scenario, tower_distance):
    times, angles = passing.built.gimbal_pitch.times_s, passing.built.gimbal_pitch.angles_rad
    exposure = passing.built.exposures_s[1]
    knot = int(np.searchsorted(times, exposure))
    moved = times.copy()
    moved[knot - 1] = exposure + 0.5 * (times[knot] - exposure)
    turning = AngleProfile(moved, angles)
    assert {"exposure_turn"} <= failed(passing, scenario, tower_distance, gimbal_pitch=turning)


def test_only_a_corridor_is_flown_through(scenario):
    asked = scenario.model_dump(mode="json", exclude_none=True)
    asked["planner"]["trajectory"] = "plain"
    with pytest.raises(InputError, match=r"planner: viewpoints: fly_through needs trajectory: corridor, not plain"):
        parse_scenario(asked)


def test_a_hold_is_a_positive_time(scenario):
    asked = scenario.model_dump(mode="json", exclude_none=True)
    for wrong in (0.0, -1.0, 1e9, "long"):
        asked["inspection"]["points"][0]["hold_s"] = wrong
        with pytest.raises(InputError, match=r"inspection\.points\.0\.hold_s"):
            parse_scenario(asked)
