"""Double-arc avoidance against closed forms and dense samples."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.planning.paths.double_arc import (
    STEEPEST,
    TOLERANCE_M,
    DoubleArc,
    cable_distance,
    cut_by_cable,
    double_arc,
    inclined_plane,
)
from gcs.planning.paths.path_search import past_stays

LENGTH = 12.0
START, GOAL = np.array([-LENGTH / 2, -6.0, 40.0]), np.array([LENGTH / 2, -6.0, 40.0])
MIDDLE = (START + GOAL) / 2
RADIUS = 0.075


def stay(inclination_deg, through=MIDDLE, reach=30.0):
    """A stay through a point, coming down southwards."""
    angle = math.radians(inclination_deg)
    way = np.array([0.0, -math.cos(angle), -math.sin(angle)])
    return np.stack([through - reach * way, through + reach * way])


def fan(*stays):
    return np.array(stays)


LOWEST = stay(70.0, MIDDLE + np.array([0.0, 8.0, -20.0]))
"""Of the fan; it lies nearer to the tower than the leg, out of its way."""


@pytest.mark.parametrize("inclination_deg", [25.0, 40.0, 55.0, 69.0])
def test_t_misses_a_stay_through_the_middle_by_its_closed_form(inclination_deg):
    cables = fan(stay(inclination_deg), LOWEST)
    plane = inclined_plane(START, GOAL, cables)
    assert plane.theta_max_rad == pytest.approx(math.radians(70.0))
    apex = plane.apex_m("touching")
    missed = cable_distance(apex[None], cables[:1], np.zeros(1))[0]
    assert missed == pytest.approx(LENGTH / 2 * math.sin(math.radians(70.0 - inclination_deg)), abs=1e-9)


def test_t_meets_the_lowest_stay_itself():
    plane = inclined_plane(START, GOAL, fan(stay(70.0)))
    assert cable_distance(plane.apex_m("touching")[None], fan(stay(70.0)), np.zeros(1))[0] == pytest.approx(0, abs=1e-9)
    endless = fan(stay(70.0, reach=500.0))
    assert "comes to 0.00 m of a stay" in double_arc(START, GOAL, endless, np.array([RADIUS]), 1.0)


def test_both_readings_of_the_radius():
    plane = inclined_plane(START, GOAL, fan(stay(40.0), LOWEST))
    below = plane.length_m / 2 * plane.down
    centres = np.stack([START + below, GOAL + below])
    assert np.linalg.norm(plane.apex_m("touching") - centres, axis=1) == pytest.approx([LENGTH / 2] * 2)
    for which in (0, 1):
        crossing = plane.apex_m("crossing", which)
        assert np.linalg.norm(crossing - centres, axis=1) == pytest.approx([LENGTH] * 2)
    apart = plane.apex_m("crossing", 0) - plane.apex_m("crossing", 1)
    assert np.linalg.norm(apart) == pytest.approx(math.sqrt(3) * LENGTH)
    inclination = np.arctan2(-plane.down[2], np.hypot(plane.down[0], plane.down[1]))
    assert inclination == pytest.approx(math.radians(70.0))
    assert plane.down[1] < 0, "away from the tower, as the stays come down"


@pytest.mark.parametrize(("inclination_deg", "clearance"), [(30.0, 2.4), (40.0, 2.4), (55.0, 2.4), (60.0, 3.0)])
def test_the_whole_curve_keeps_the_clearance(inclination_deg, clearance):
    cables, radii = fan(stay(inclination_deg), LOWEST), np.full(2, RADIUS)
    arc = double_arc(START, GOAL, cables, radii, clearance)
    assert isinstance(arc, DoubleArc)
    assert arc.clearance_m >= clearance
    dense = arc.curve(np.linspace(0, 1, 20_001))
    true = cable_distance(dense, cables, radii).min()
    assert true - TOLERANCE_M - 1e-6 <= arc.clearance_m <= true + 1e-9
    assert dense[[0, 10_000, 20_000]] == pytest.approx(np.stack([START, arc.apex_m, GOAL]))
    assert arc.polyline_m[[0, -1]] == pytest.approx(np.stack([START, GOAL]))
    off = np.linalg.norm(arc.polyline_m[:, None] - dense, axis=2).min(axis=1)
    assert off.max() < 1e-2


def test_the_touching_point_comes_first_and_a_wider_one_only_where_it_is_too_near():
    near, radii = fan(stay(30.0), LOWEST), np.full(2, RADIUS)
    assert (double_arc(START, GOAL, near, radii, 2.0).reading, double_arc(START, GOAL, near, radii, 2.0).widened) == (
        "touching",
        1.0,
    )
    steep = fan(stay(60.0), LOWEST)
    only = {"readings": ("touching",)}
    missed = [double_arc(START, GOAL, steep, radii, 0.8, widened=(w,), **only) for w in (1.0, 1.25, 1.5, 2.0)]
    assert isinstance(missed[0], DoubleArc)
    wide = double_arc(START, GOAL, steep, radii, 1.8, **only)
    assert wide.widened > 1.0
    assert isinstance(double_arc(START, GOAL, steep, radii, 1.8, widened=(1.0,), **only), str)
    crossing = double_arc(START, GOAL, steep, radii, 1.8)
    assert crossing.reading == "crossing"
    assert crossing.widened == 1.0


def test_there_is_no_such_way_off_the_level_or_along_the_stays():
    cables, radii = fan(stay(40.0), LOWEST), np.full(2, RADIUS)
    up = GOAL + np.array([0.0, 0.0, 0.5 * LENGTH])
    assert double_arc(START, up, cables, radii, 1.0) == "the two places are not of one height"
    south = MIDDLE + np.array([0.0, -8.0, 0.0])
    assert "along the leg" in double_arc(MIDDLE, south, cables, radii, 1.0)
    assert double_arc(START, START, cables, radii, 1.0) == "the leg has no length"


def test_nearly_one_height_will_do():
    rise = 0.9 * STEEPEST * LENGTH
    goal = GOAL + np.array([0.0, 0.0, rise])
    plane = inclined_plane(START, goal, fan(stay(40.0), LOWEST))
    assert plane.down @ (goal - START) == pytest.approx(0.0, abs=1e-9)
    assert isinstance(double_arc(START, goal, fan(stay(40.0), LOWEST), np.full(2, RADIUS), 1.5), DoubleArc)


def test_which_stays_cut_a_leg_against_dense_samples():
    rng = np.random.default_rng(3)
    share = np.linspace(0, 1, 801)[:, None]
    for _ in range(60):
        a, b = rng.uniform(-8, 8, (2, 3))
        ends = rng.uniform(-8, 8, (4, 2, 3))
        true = np.array([cable_distance(a + share * (b - a), e[None], np.zeros(1)).min() for e in ends])
        kept = true + rng.choice([-0.05, 0.05], 4)
        assert (cut_by_cable(a, b, ends, kept) == (true < kept)).all()


class Space:
    """Nothing but stays about it."""

    def __init__(self, cables, radii, open_to=lambda a, b: np.ones(len(a), bool)):
        self.model = SimpleNamespace(cable_ends=cables, cable_radii=radii, clearance=1.5, extra=0.5)
        self._open_to = open_to

    def segments_free(self, a, b, *, strict, model):
        assert strict
        assert model is self.model
        return self._open_to(a, b)


def test_a_leg_takes_the_arc_only_where_a_stay_cuts_it_and_every_chord_is_free():
    cables, radii = fan(stay(40.0), LOWEST), np.full(2, RADIUS)
    space = Space(cables, radii)
    chords = past_stays(space, START, GOAL, space.model)
    arc = double_arc(START, GOAL, cables, radii, 2.0)
    np.testing.assert_array_equal(chords, arc.polyline_m)
    assert past_stays(space, START, GOAL, space.model, longest_m=LENGTH) is None
    aside = np.array([0.0, 0.0, 30.0])
    assert past_stays(space, START + aside, GOAL + aside, space.model) is None
    walled = Space(cables, radii, lambda a, b: np.arange(len(a)) != 7)
    assert past_stays(walled, START, GOAL, walled.model) is None
    bare = Space(np.zeros((0, 2, 3)), np.zeros(0))
    assert past_stays(bare, START, GOAL, bare.model) is None
