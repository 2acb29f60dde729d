"""Flights among random obstacles: the draw is fair, and the figures count what they say."""

import itertools
import math

import numpy as np
import pytest

from gcs.core.replanning import ReplanReason
from gcs.services.benchmarks.companion_flights import FlightOutcome
from gcs.services.benchmarks.local_flights import rows_of
from gcs.services.benchmarks.random_obstacles import FROM_HOME_M, GAP_M, blocked_in_the_end, random_obstacles

HOME = np.array([-14.0, -10.0, 0.0])
WAY = np.linspace((-14.0, -10.0, 2.6), (7.0, 7.0, 3.3), 100)
KEEP_M = 1.6


def outcome(**changes):
    usual = {
        "seed": 1,
        "autopilot": "px4",
        "least_m": 1.5,
        "touched": (),
        "viewpoints": 4,
        "moved": 0,
        "photographed": 3,
        "skipped": (ReplanReason.VIEWPOINT_BLOCKED,),
        "reachable": 0,
        "reports_made": 2,
        "reports_once": 2,
        "by_hand": None,
        "flown_s": 60.0,
    }
    return FlightOutcome(**(usual | changes))


def test_every_draw_is_fair_and_has_something_in_the_way():
    for seed in range(100):
        drawn = random_obstacles(np.random.default_rng(seed), WAY, HOME, WAY[::30], KEEP_M)
        assert any(spec["height_m"] > 2 for spec in drawn)
        standing = [spec for spec in drawn if len(spec["path_m"]) == 1]
        for spec in drawn:
            path = np.asarray(spec["path_m"])
            for share in np.linspace(0, 1, 40):
                place = path[0] + share * (path[-1] - path[0])
                assert math.dist(place, HOME[:2]) > FROM_HOME_M - 0.5
                for other in standing:
                    gap = math.dist(place, other["path_m"][0]) - spec["radius_m"] - other["radius_m"]
                    assert other is spec or gap > GAP_M - 0.5 or spec in standing


def test_nothing_goes_through_anything():
    def place(spec, at_s):
        (x, y), (to_x, to_y) = spec["path_m"][0], spec["path_m"][-1]
        length = math.dist((x, y), (to_x, to_y))
        share = min(at_s * spec["speed_m_s"] / length, 1.0) if length else 0.0
        return x + share * (to_x - x), y + share * (to_y - y)

    for seed in range(50):
        drawn = random_obstacles(np.random.default_rng(seed), WAY, HOME, WAY[::30], KEEP_M)
        for one, other in itertools.combinations(drawn, 2):
            gap = min(math.dist(place(one, t / 2), place(other, t / 2)) for t in range(240))
            assert gap > one["radius_m"] + other["radius_m"]


def test_few_viewpoints_are_blocked_for_good():
    blocked = [
        blocked_in_the_end(
            random_obstacles(np.random.default_rng(seed), WAY, HOME, WAY[::30], KEEP_M), WAY[::30], KEEP_M
        )
        for seed in range(200)
    ]
    assert 0.02 < np.mean(blocked) < 0.25


def test_what_is_blocked_in_the_end():
    places = np.array([[0.0, 0.0, 3.0], [5.0, 0.0, 3.0], [0.0, 9.0, 3.0]])
    arrives = {"path_m": [[30.0, 0.0], [2.5, 0.0]], "radius_m": 1.0, "base_m": 0.0, "height_m": 8.0}
    low = {"path_m": [[0.0, 9.0]], "radius_m": 1.0, "base_m": 0.0, "height_m": 1.3}
    assert blocked_in_the_end([arrives], places, 1.6).tolist() == [True, True, False]
    assert blocked_in_the_end([low], places, 1.6).tolist() == [False, False, False]


def test_the_figures_add_up():
    flights = [
        outcome(),
        outcome(touched=("truck",), least_m=-0.1),
        outcome(photographed=2),
        outcome(photographed=2, moved=1),
        outcome(reports_once=1, by_hand="stuck", skipped=(ReplanReason.LEASE_ENDED,), reachable=1),
    ]
    figures = {row.figure: row.value for row in rows_of(flights, 20.0)}
    assert figures["collisions"] == figures["unaccounted"] == figures["reports_not_once"] == 1
    assert (figures["photographed"], figures["skipped_and_reported"], figures["viewpoints"]) == (13, 5, 20)
    assert (figures["skipped.viewpoint_blocked"], figures["skipped.lease_ended"]) == (4, 1)
    assert figures["moved_and_photographed"] == 1
    assert figures["skipped_though_reachable"] == 1
    assert figures["ended_by_hand"] == 1 and figures["least_distance_m"] == pytest.approx(-0.1)
    assert figures["cpu_s_per_flight"] == pytest.approx(4.0)
