"""Plans of every variant of the trajectory: what holds is proved, the rest is refused and told what would do."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.core.errors import OperationCancelled
from gcs.core.inspection import NamedPoint
from gcs.core.plan import Sortie
from gcs.core.progress import SilentProgress
from gcs.planning.certificates import CertificateError, recheck
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.planner import plan_tour
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.tours.tour import Tour
from gcs.planning.variant_advice import VARIANTS, variant_advice
from gcs.planning.views.viewpoint_pose import pose_towards

KEPT_M = 2.4
"""Clearance of the centre: 0.5 m of hull and 1.9 m of errors."""


@pytest.fixture(scope="module")
def scenario(tower_scenario):
    points = (NamedPoint(name="P", position_m=(-4.0, 0.0, 10.0), normal=(-1, 0, 0)),)
    return tower_scenario.model_copy(
        update={
            "inspection": tower_scenario.inspection.model_copy(update={"points": points}),
            "vehicle": tower_scenario.vehicle.model_copy(update={"max_jerk_m_s3": None}),
        }
    )


@pytest.fixture(scope="module")
def scene(scenario, tower):
    return prepare_scene(scenario, tower, SilentProgress())


def jogged(width, until, on):
    """A way past the tower's west side with a jog: long, short, long, so that a curve through its corners swings."""
    x = -7.4 - width
    return np.array([[-7.4, -20, 10], [-7.4, until, 10], [x, until + 0.3, 10], [x - 1, until + on, 12]])


MILD, SHARP = jogged(0.5, -2.0, 8.0), jogged(1.0, 0.0, 16.0)


def with_variant(scenario, variant):
    return scenario.model_copy(update={"planner": scenario.planner.model_copy(update={"trajectory": variant})})


def to_the_tower(points):
    return np.linalg.norm(np.maximum(np.abs(points - [0, 0, 12]) - [4, 4, 12], 0), axis=-1)


def tour_along(way, scenario, scene):
    home, top = np.array(scenario.home_m), scene.space.take_off_m
    legs = [np.array([home, top, way[0]]), way, np.array([way[-1], top, home])]
    length = sum(np.linalg.norm(np.diff(leg, axis=0), axis=1).sum() for leg in legs)
    return Tour(np.arange(2), legs, length, length, "length", 3)


def poses_at(way):
    return [pose_towards(f"V{k}", place, -place * [1, 1, 0], 0.002) for k, place in enumerate((way[0], way[-1]))]


@pytest.fixture
def planned(monkeypatch, scenario, tower, scene):
    def plan(way, variant, **vehicle):
        asked = with_variant(scenario, variant)
        asked = asked.model_copy(update={"vehicle": asked.vehicle.model_copy(update=vehicle)})
        found = tour_along(way, scenario, scene)
        monkeypatch.setattr("gcs.planning.flights.flight_base.find_tour", lambda *_a, **_k: found)
        return plan_tour(asked, tower, scene, poses_at(way), SilentProgress())

    return plan


@pytest.mark.parametrize(
    ("way", "variant"), [(MILD, v) for v in ("corrected", "geometric", "corridor")] + [(SHARP, "geometric")]
)
def test_a_variant_that_keeps_the_clearance_is_a_plan(way, variant, planned, tower):
    plan = planned(way, variant)
    curve = plan.trajectory
    points = curve.value(np.linspace(0, curve.duration_s, 20_001))
    assert to_the_tower(points).min() >= KEPT_M
    assert plan.certificates.worst_viewpoint_miss_m < 1e-6
    assert plan.certificates.corridor_violation_m <= 1e-6
    assert [c for c in recheck(plan, SceneDistance(tower, 0.0)) if not c.ok] == []
    segment = np.clip(np.searchsorted(curve.starts_s, [0.3, 9.0], side="right") - 1, 0, len(curve.durations_s) - 1)
    inside = curve.value([0.3, 9.0])
    assert (inside >= plan.corridor_m[segment, 0] - 1e-9).all()
    assert (inside <= plan.corridor_m[segment, 1] + 1e-9).all()


@pytest.mark.parametrize(
    ("way", "variant", "advised"),
    [(MILD, "plain", "corrected"), (SHARP, "plain", "geometric"), (SHARP, "corrected", "geometric")],
)
def test_a_curve_that_comes_too_near_is_refused_and_told_what_would_do(way, variant, advised, planned):
    with pytest.raises(CertificateError) as error:
        planned(way, variant)
    message = str(error.value)
    assert message.startswith("min_clearance_m: between hull and scene")
    assert message.endswith(f"; planner.trajectory: {advised} would do")
    assert "\n" not in message
    planned(way, advised)  # it does


def test_several_flights_are_looked_at_one_by_one(planned, scenario, tower, scene):
    """The same way twice with a landing between: cut at home, each is as it was alone."""
    tour = tour_along(SHARP, scenario, scene)
    there, past, back = tour.legs_m
    legs = [there, past, np.vstack([back, there[1:]]), past, back]
    plan = planned(SHARP, "geometric")
    seen = [*plan.viewpoints, *(replace(v, id=v.id + 2) for v in plan.viewpoints)]
    sorties = [Sortie((0, 1), 0.0, 1.0, 1.0), Sortie((2, 3), 2.0, 3.0, 1.0)]
    distance = SceneDistance(tower, 0.0)
    for variant in ("plain", "corrected"):
        asked = with_variant(scenario, variant)
        told = variant_advice(asked, legs, seen, sorties, distance, scene.space, SilentProgress())
        assert told == "; planner.trajectory: geometric would do"


def test_nothing_is_advised_when_nothing_would_do(planned, scenario, tower, scene):
    legs, seen = tour_along(SHARP, scenario, scene).legs_m, planned(SHARP, "geometric").viewpoints
    distance, told = SceneDistance(tower, 0.0), SilentProgress()
    far = scenario.model_copy(update={"safety": scenario.safety.model_copy(update={"clearance_m": 10.0})})
    assert variant_advice(with_variant(far, "plain"), legs, seen, (), distance, scene.space, told) == ""
    assert variant_advice(with_variant(scenario, VARIANTS[-1]), legs, seen, (), distance, scene.space, told) == ""


def test_the_search_for_advice_can_be_stopped(planned, scenario, tower, scene):
    class Stopped:
        def report(self, stage, fraction):
            raise OperationCancelled("stop")

    legs, seen = tour_along(SHARP, scenario, scene).legs_m, planned(SHARP, "geometric").viewpoints
    with pytest.raises(OperationCancelled):
        variant_advice(
            with_variant(scenario, "plain"), legs, seen, (), SceneDistance(tower, 0.0), scene.space, Stopped()
        )
