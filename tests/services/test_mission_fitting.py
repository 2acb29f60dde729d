"""Missions that come too near are sampled finer or flown slower, those that are too long coarser; never at a risk."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.core.errors import RefusedError
from gcs.core.mission import Command
from gcs.core.trajectory import PiecewisePolynomial
from gcs.core.vehicle import Autopilot
from gcs.mavlink.mission_upload import NoRoomError
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.trajectories.mission_sampling import CHORD_ERROR_M
from gcs.services import mission_fitting
from gcs.services.fitted_upload import upload_fitted
from gcs.services.mission_fitting import (
    USUAL_SAMPLING,
    MissionSampling,
    fit_mission,
    predicted_mission,
    sampled_mission,
)
from gcs.services.preflight import check_prediction
from gcs.services.vehicle_model import vehicle_model

PX4 = vehicle_model(Autopilot.PX4)
REST = np.array([0, 0, 0, 0, 35, -84, 70, -20], dtype=float)


def straight(start, end):
    step = np.asarray(end, dtype=float) - start
    coefficients = REST[:, None] * step[None, :]
    coefficients[0] += start
    return coefficients, max(2.0, float(np.linalg.norm(step)) / 2.0)


def quarter(radius):
    """Past the south-western corner of the box (12, -2), from its western to its southern side, 10 m up."""
    u = np.linspace(0.0, 1.0, 200)
    angle = np.pi / 2 * np.polyval(REST[::-1], u)
    place = np.stack([12 - radius * np.cos(angle), -2 - radius * np.sin(angle), np.full(200, 10.0)], axis=1)
    return np.polyfit(u, place, 7)[::-1], radius * 1.2


@pytest.fixture
def round_the_corner(small_plan):
    """A plan that goes round a corner at a given distance, out and back, and photographs from behind it."""

    def make(distance):
        beside, below, view = (12 - distance, 8, 10), (12, -2 - distance, 10), (18, -2 - distance, 10)
        pieces = [
            straight((0, 0, 0), (0, 0, 10)),
            straight((0, 0, 10), beside),
            straight(beside, (12 - distance, -2, 10)),
            quarter(distance),
            straight(below, view),
            straight(view, (18, -15, 10)),
            straight((18, -15, 10), (0, -15, 10)),
            straight((0, -15, 10), (0, 0, 10)),
            straight((0, 0, 10), (0, 0, 0)),
        ]
        durations = np.array([seconds for _, seconds in pieces])
        curve = PiecewisePolynomial(np.stack([c for c, _ in pieces]), durations)
        viewpoint = replace(
            small_plan.viewpoints[0], position_m=np.array(view, float), time_s=float(durations[:5].sum())
        )
        return replace(small_plan, trajectory=curve, viewpoints=(viewpoint,))

    return make


@pytest.fixture
def scene(small_structure):
    return SceneDistance(small_structure, 0.0)


def keeps(fitted):
    return fitted.prediction.mission.keeps(fitted.prediction.needed_clearance_m)


def test_where_there_is_room_the_usual_sampling_is_taken_at_once(round_the_corner, scene):
    fitted = fit_mission(round_the_corner(6.0), scene, Autopilot.PX4, PX4)
    assert (fitted.sampling, fitted.tried) == (MissionSampling(climb_m_s=3.0, descent_m_s=1.5), 1)
    assert keeps(fitted)


@pytest.mark.parametrize(("autopilot", "distance"), [(Autopilot.PX4, 2.1), (Autopilot.ARDUPILOT, 2.15)])
def test_a_mission_that_comes_too_near_is_sampled_finer_before_it_is_refused(
    round_the_corner, scene, autopilot, distance
):
    plan, model = round_the_corner(distance), vehicle_model(autopilot)
    usual = predicted_mission(plan, scene, autopilot, model, USUAL_SAMPLING)
    assert not keeps(usual)
    fitted = fit_mission(plan, scene, autopilot, model)
    assert keeps(fitted)
    assert fitted.tried > 1
    assert fitted.sampling.chord_error_m < CHORD_ERROR_M
    (check,) = check_prediction(fitted, offboard=False)
    assert check.state == "ok"
    assert fitted.sampling.words in check.detail


def test_where_nothing_helps_it_is_refused_and_the_tries_are_bounded_and_told(round_the_corner, scene):
    fitted = fit_mission(round_the_corner(1.95), scene, Autopilot.PX4, PX4)
    assert not keeps(fitted)
    assert fitted.sampling.chord_error_m == CHORD_ERROR_M
    assert fitted.tried == 5
    (check,) = check_prediction(fitted, offboard=False)
    assert check.state == "refused"
    assert "nor with any of 4 finer or slower samplings" in check.detail


def test_a_slower_mission_says_so_to_the_vehicle(round_the_corner):
    mission = sampled_mission(round_the_corner(2.3), Autopilot.ARDUPILOT, MissionSampling(0.1, 2.0))
    speeds = [i.params[1] for i in mission.items if i.command == Command.DO_CHANGE_SPEED]
    assert speeds == [2.0, 2.0, 2.0]


def test_a_mission_commands_no_more_than_the_vehicles_own_vertical_limits(round_the_corner, scene):
    model = vehicle_model(Autopilot.ARDUPILOT)
    fitted = fit_mission(round_the_corner(6.0), scene, Autopilot.ARDUPILOT, model)
    speeds = [i.params[1] for i in fitted.mission.items if i.command == Command.DO_CHANGE_SPEED]
    assert speeds == [5.0, model.law.climb_m_s, model.law.descent_m_s]


def test_a_vehicle_of_little_room_gets_a_coarser_mission_if_that_keeps_clear(round_the_corner, scene):
    plan = round_the_corner(6.0)
    usual = len(sampled_mission(plan, Autopilot.PX4, USUAL_SAMPLING).items)
    fitted = fit_mission(plan, scene, Autopilot.PX4, PX4, usual - 1)
    assert len(fitted.mission.items) < usual
    assert fitted.sampling.chord_error_m > CHORD_ERROR_M
    assert keeps(fitted)
    # Near the corner the same would cut it.
    near = round_the_corner(2.3)
    usual = len(sampled_mission(near, Autopilot.PX4, USUAL_SAMPLING).items)
    cut = fit_mission(near, scene, Autopilot.PX4, PX4, usual - 1)
    assert not keeps(cut)
    assert check_prediction(cut, offboard=False)[0].state == "refused"


def test_what_no_sampling_makes_small_enough_is_refused_with_the_number_and_how_to_split(round_the_corner, scene):
    with pytest.raises(RefusedError, match=r"stores no more than 6: split .* over \d plans or more.*--mode offboard"):
        fit_mission(round_the_corner(6.0), scene, Autopilot.PX4, PX4, 6)


def test_an_autopilot_that_cannot_be_predicted_gets_the_usual_mission(round_the_corner, scene):
    fitted = fit_mission(round_the_corner(1.95), scene, Autopilot.GENERIC, None)
    assert (fitted.sampling, fitted.prediction) == (USUAL_SAMPLING, None)


class Room:
    """A vehicle that stores so many items, and may say so."""

    def __init__(self, items, says):
        self.items, self.says, self.held, self.refusals = items, says, None, 0

    async def upload_mission(self, mission, progress=None):
        if len(mission.items) > self.items:
            self.refusals += 1
            raise NoRoomError("no room", self.items if self.says else None)
        self.held = mission
        return "proof"


@pytest.mark.parametrize("says", [True, False])
async def test_after_a_refusal_for_want_of_room_a_coarser_mission_is_sent(round_the_corner, scene, says):
    plan = round_the_corner(6.0)
    first, said = fit_mission(plan, scene, Autopilot.PX4, PX4), []
    coarsest = len(sampled_mission(plan, Autopilot.PX4, MissionSampling(1.2)).items)
    vehicle = Room(coarsest, says)

    async def refit(most_items):
        return fit_mission(plan, scene, Autopilot.PX4, PX4, most_items)

    proof, sent = await upload_fitted(vehicle, first, refit, said.append)
    assert (proof, vehicle.held) == ("proof", sent.mission)
    assert len(sent.mission.items) <= coarsest
    assert len(said) == vehicle.refusals <= (1 if says else 3)
    assert "sent instead" in said[-1]


async def test_a_coarser_mission_that_would_come_too_near_is_not_sent(round_the_corner, scene):
    plan = round_the_corner(2.3)
    first = fit_mission(plan, scene, Autopilot.PX4, PX4)
    vehicle = Room(len(first.mission.items) - 1, says=True)

    async def refit(most_items):
        del most_items
        coarser = len(sampled_mission(plan, Autopilot.PX4, MissionSampling(0.6)).items)
        return fit_mission(plan, scene, Autopilot.PX4, PX4, coarser)

    with pytest.raises(RefusedError, match="too near"):
        await upload_fitted(vehicle, first, refit, print)
    assert vehicle.held is None


def test_a_mission_is_flown_slower_where_finer_chords_do_not_do(round_the_corner, scene, monkeypatch):
    """The prediction decides: here one that keeps clear only of what is slow."""
    real = mission_fitting.predict_flights

    def only_slow(plan, distance, mission, model):
        found = real(plan, distance, mission, model)
        slow = any(i.command == Command.DO_CHANGE_SPEED and i.params[1] <= 3.0 for i in mission.items)
        return replace(found, mission=replace(found.mission, min_clearance_m=9.0 if slow else 0.0))

    monkeypatch.setattr(mission_fitting, "predict_flights", only_slow)
    fitted = fit_mission(round_the_corner(6.0), scene, Autopilot.PX4, PX4)
    assert fitted.sampling == MissionSampling(0.15, 3.0, 3.0, 1.5)
    assert "flown at 3.0 m/s" in check_prediction(fitted, offboard=False)[0].detail
