"""How the autopilots fly missions: against closed forms, against laws measured on real ones, and at their limits."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.core.flight_law import Airframe, ArduPilotLaw, Px4Law
from gcs.planning.dynamics.ardupilot_mission import predict_ardupilot_mission
from gcs.planning.dynamics.predicted_flight import SAMPLE_S, MissionRoute
from gcs.planning.dynamics.px4_mission import predict_px4_mission

BOTH = [(predict_ardupilot_mission, ArduPilotLaw()), (predict_px4_mission, Px4Law())]


def route(points, holds=None, radius=0.0, **speeds):
    places = np.asarray(points, float)
    stays = np.zeros(len(places)) if holds is None else np.asarray(holds, float)
    return MissionRoute(places, np.full(len(places), radius), stays, **speeds)


def passed(flight, point):
    return float(np.linalg.norm(flight.position_m - np.asarray(point, float), axis=1).min())


def at_rest_near(flight, point, within):
    """How long (s) it is slower than 5 cm/s there."""
    speed = np.linalg.norm(np.gradient(flight.position_m, SAMPLE_S, axis=0), axis=1)
    near = np.linalg.norm(flight.position_m - np.asarray(point, float), axis=1) < within
    return SAMPLE_S * np.count_nonzero(near & (speed < 0.05))


@pytest.mark.parametrize(("jerk", "factor"), [(1.0, 0.57), (5.0, 0.5)])
@pytest.mark.parametrize("spacing", [1.0, 2.0, 4.0])
def test_ardupilot_crawls_along_dense_waypoints_as_measured(jerk, factor, spacing):
    places = np.zeros((int(80 / spacing) + 1, 3))
    places[:, 0] = spacing * np.arange(len(places))
    flight = predict_ardupilot_mission(route(places), ArduPilotLaw(jerk_m_s3=jerk), Airframe())
    x = flight.position_m[:, 0]
    a, b = np.searchsorted(x, [30.0, 60.0])
    speed = 30.0 / (flight.time_s[b] - flight.time_s[a])
    assert speed == pytest.approx(factor * (jerk * spacing**2) ** (1 / 3), rel=0.1)


def test_ardupilots_long_leg_takes_its_profiles_time():
    # T = L / V + V / A + A / J + t_j from rest to rest, t_j = 0.3 s
    flight = predict_ardupilot_mission(route([[0, 0, 20], [200, 0, 20]], speed_m_s=5.0), ArduPilotLaw(), Airframe(0.0))
    there = float(flight.time_s[np.argmax(flight.position_m[:, 0] > 199.9)])
    assert there == pytest.approx(200 / 5 + 5 / 2.5 + 2.5 + 0.3, rel=0.04)


@pytest.mark.parametrize(("predict", "law"), BOTH)
def test_a_hold_is_a_stop_and_a_waypoint_without_one_is_not(predict, law):
    corner = [40.0, 0.0, 20.0]
    places = [[0, 0, 20], corner, [40, 40, 20]]
    held = predict(route(places, [0, 5.0, 0], 0.5, speed_m_s=4.0), law, Airframe())
    through = predict(route(places, None, 2.0, speed_m_s=4.0), law, Airframe())
    assert held.finished
    assert through.finished
    assert at_rest_near(held, corner, 0.6) >= 2.0
    assert passed(held, corner) < 0.1
    assert at_rest_near(through, corner, 3.0) == 0.0
    assert 0.1 < passed(through, corner) < 2.5
    assert held.duration_s > through.duration_s + 5.0
    for flight in (held, through):
        assert np.linalg.norm(flight.position_m[-1] - [40, 40, 20]) < 0.3


def test_ardupilot_turns_no_further_from_a_waypoint_than_its_radius():
    places = [[0, 0, 20], [40, 0, 20], [40, 40, 20]]
    ways = [
        passed(predict_ardupilot_mission(route(places), ArduPilotLaw(radius_m=r), Airframe(0.0, 0.02)), places[1])
        for r in (0.3, 1.0, 2.0)
    ]
    assert ways[0] < 0.45
    assert ways[1] < 1.1
    assert ways[2] < 2.1
    assert ways[0] < ways[1] <= ways[2] + 1e-9


@pytest.mark.parametrize(("predict", "law"), BOTH)
def test_climbing_and_sinking_keep_to_their_own_limits(predict, law):
    flight = predict(route([[0, 0, 5], [0, 0, 45], [0, 0, 5]], [0, 1, 0], 0.5), law, Airframe())
    rate = np.diff(flight.position_m[:, 2]) / SAMPLE_S
    assert rate.max() == pytest.approx(law.climb_m_s, rel=0.1)
    assert -rate.min() == pytest.approx(law.descent_m_s, rel=0.1)
    # The heights are reached; the level place never changes.
    assert flight.position_m[:, 2].max() == pytest.approx(45.0, abs=0.6)
    assert abs(flight.position_m[:, :2]).max() < 1e-9


def test_px4_slows_for_a_waypoint_by_the_tangent_circle():
    # v = sqrt(c a r tan(alpha / 2)) with a right angle between the legs
    law = Px4Law(acceleration_m_s2=3.0, turn_gain=0.5)
    places = [[0, 0, 20], [60, 0, 20], [60, 60, 20]]
    flight = predict_px4_mission(route(places, None, 2.0, speed_m_s=5.0), law, Airframe(0.0, 0.05))
    speed = np.linalg.norm(np.gradient(flight.position_m, SAMPLE_S, axis=0), axis=1)
    near = np.linalg.norm(flight.position_m - places[1], axis=1) < 2.5
    assert speed[near].min() == pytest.approx(np.sqrt(0.5 * 3.0 * 2.0), rel=0.3)
    assert speed.max() == pytest.approx(5.0, rel=0.05)


def test_px4_crawls_where_waypoints_are_nearer_than_their_radius():
    near, far = (
        predict_px4_mission(
            route(np.array([[s * k, 0, 20] for k in range(round(60 / s) + 1)]), None, 2.0, speed_m_s=4.0),
            Px4Law(),
            Airframe(),
        ).duration_s
        for s in (1.5, 6.0)
    )
    assert near > 1.5 * far


def test_places_that_repeat_are_one_stop():
    twice = predict_ardupilot_mission(
        route([[0, 0, 20], [20, 0, 20], [20, 0, 20], [20, 20, 20]], [0, 0, 3.0, 0]), ArduPilotLaw(), Airframe()
    )
    once = predict_ardupilot_mission(
        route([[0, 0, 20], [20, 0, 20], [20, 20, 20]], [0, 3.0, 0]), ArduPilotLaw(), Airframe()
    )
    assert twice.duration_s == pytest.approx(once.duration_s)


def test_what_cannot_be_flown_is_one_clear_error():
    places = [[0, 0, 20], [20, 0, 20]]
    with pytest.raises(InputError, match="positive number") as caught:
        predict_ardupilot_mission(route(places), ArduPilotLaw(jerk_m_s3=0.0), Airframe())
    assert caught.value.field == "jerk_m_s3"
    with pytest.raises(InputError, match="positive number") as caught:
        predict_px4_mission(route(places, None, 0.0, speed_m_s=0.0), Px4Law(), Airframe())
    assert caught.value.field == "cruise_m_s"
    with pytest.raises(InputError, match="two places"):
        route([[0, 0, 20]])
    with pytest.raises(InputError, match="finite"):
        route([[0, 0, np.nan], [1, 0, 0]])


def test_a_px4_that_does_not_get_to_a_place_is_given_up_there_however_long_the_mission_is():
    places = [[0, 0, 20], [30, 0, 25], [30, 30, 20], [30, 20000, 20]]
    never = replace(Px4Law(), height_radius_m=1e-300)
    flight = predict_px4_mission(route(places, None, 1.0, speed_m_s=8.0), never, Airframe())
    assert not flight.finished
    assert flight.duration_s < 2 * (31 / 0.1 + 120)


def test_splines_pass_through_their_places_and_bulge_between_them():
    angle = np.linspace(0, np.pi, 9)
    places = np.stack([20 * np.cos(angle), 20 * np.sin(angle), np.full(9, 20.0)], axis=1)
    law = ArduPilotLaw(acceleration_m_s2=2.5, jerk_m_s3=5.0)
    curved = MissionRoute(places, np.zeros(9), np.zeros(9), 2.0, 2.0, 2.0, curved=True)
    flight = predict_ardupilot_mission(curved, law, Airframe(0.0, 0.02))
    assert flight.finished
    assert np.linalg.norm(flight.position_m[-1] - places[-1]) < 0.3
    out = np.linalg.norm(flight.position_m[:, :2], axis=1)
    assert out.max() > 20.0
    assert max(passed(flight, p) for p in places) < 0.5
