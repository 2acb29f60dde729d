"""Pads beside home: apart, clear of the structure and inside the fence."""

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.core.scenario import Fence
from gcs.planning.flights.fleet_pads import pads_of_fleet

WORK = np.array([0.0, 0.0, 12.0])


def asking(scenario, count=3, home=None, **more):
    vehicle = scenario.vehicle.model_copy(update={"count": count, "pads_m": more.pop("pads", ())})
    return scenario.model_copy(update={"vehicle": vehicle, "home_m": home or scenario.home_m, **more})


def test_a_row_across_the_way_to_the_work(tower_scenario, tower_distance):
    scenario = asking(tower_scenario)
    pads = pads_of_fleet(scenario, tower_distance, WORK)
    np.testing.assert_allclose(pads[0], scenario.home_m)
    steps = np.linalg.norm(np.diff(pads, axis=0), axis=1)
    assert (steps >= scenario.safety.apart_m).all()
    assert abs((pads[1] - pads[0]) @ (WORK - pads[0])) < 1e-6


def test_a_row_keeps_clear_of_the_structure_and_the_fence(tower_scenario, tower_distance):
    narrow = Fence(include=(((-40.0, -8.0), (40.0, -8.0), (40.0, 2.0), (-40.0, 2.0)),))
    scenario = asking(tower_scenario, home=(-10.0, -5.0, 0.0), fence=narrow)
    pads = pads_of_fleet(scenario, tower_distance, WORK)
    asked = scenario.centre_clearance_m + scenario.safety.corridor_half_width_m
    assert (tower_distance.distance(pads + np.array([0, 0, 3.0]), ground=False) >= asked).all()
    assert (pads[:, 1] > -8).all()
    assert (pads[:, 1] < 2).all()


def test_no_row_has_room(tower_scenario, tower_distance):
    tight = Fence(include=(((-22.0, -22.0), (-18.0, -22.0), (-18.0, -18.0), (-22.0, -18.0)),))
    with pytest.raises(InputError, match=r"vehicle\.pads_m: no row of 3 pads"):
        pads_of_fleet(asking(tower_scenario, fence=tight), tower_distance, WORK)


def test_given_pads_are_taken_when_they_are_far_enough_apart(tower_scenario, tower_distance):
    given = asking(tower_scenario, pads=((-30.0, 20.0, 0.0), (30.0, 20.0, 0.0)))
    np.testing.assert_allclose(pads_of_fleet(given, tower_distance, WORK)[1:], given.vehicle.pads_m)
    near = asking(tower_scenario, pads=((-30.0, 20.0, 0.0), (-30.0, 25.0, 0.0)))
    with pytest.raises(InputError, match=r"pads of vehicles 2 and 3 are 5\.0 m apart"):
        pads_of_fleet(near, tower_distance, WORK)
