"""Safety rule 7 against hand-made scenes and brute force."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from gcs.core.progress import SilentProgress
from gcs.core.structure import Structure
from gcs.core.trajectory import PiecewisePolynomial
from gcs.core.way_home import ReturnFlight
from gcs.planning.flights.ways_home import MARGIN_M, SPACING_M, check_ways_home, return_is_clear, trace_ways_home
from gcs.planning.scene.fence import FenceVolume
from gcs.planning.scene.point_distance import SceneDistance

KEEP_M = 0.9
HOME = np.array([-30.0, 0, 0])


def boxes(*parts):
    """Boxes given by low and high corners."""
    meshes = []
    for low, high in parts:
        box = trimesh.creation.box(extents=np.subtract(high, low))
        meshes.append(trimesh.Trimesh(box.vertices + np.add(low, high) / 2, box.faces, process=False))
    mesh = trimesh.util.concatenate(meshes)
    return SceneDistance(Structure(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64)), 0.0)


def line(*points, speed=2.0):
    pieces, durations = [], []
    for a, b in zip(np.array(points[:-1], float), np.array(points[1:], float), strict=True):
        coefficients = np.zeros((8, 3))
        coefficients[0], coefficients[1] = a, b - a
        pieces.append(coefficients)
        durations.append(np.linalg.norm(b - a) / speed)
    return PiecewisePolynomial(np.array(pieces), np.array(durations))


TOLERANCE_M = MARGIN_M + SPACING_M


def trace(curve, scene, altitude, **changes):
    flight = None if altitude is None else ReturnFlight(altitude, **changes)
    return trace_ways_home(curve, scene, HOME, flight, KEEP_M, SilentProgress())


WALL = ((-2, -20, 0), (2, 20, 25))
BEAM = ((10, -20, 15), (14, 20, 17))


def test_a_wall_between_here_and_home_needs_a_higher_return():
    curve = line(HOME, HOME + np.array([0, 0, 40]), [10, 0, 40], [10, 0, 10])
    low = trace(curve, boxes(WALL), 15.0)
    assert not low.ok
    ((start, end),) = low.blocked_s
    # On the last stretch, once it is lower than the wall and its distance.
    assert curve.value(start)[2] == pytest.approx(25 + KEEP_M, abs=TOLERANCE_M)
    assert end == pytest.approx(curve.duration_s)
    assert "nearer than 0.9 m" in low.reason
    assert 25 + KEEP_M <= low.lowest_safe_m <= 25 + KEEP_M + TOLERANCE_M + 1
    high = trace(curve, boxes(WALL), low.lowest_safe_m)
    assert (high.ok, high.reason, high.blocked_s) == (True, "", ())
    assert trace(curve, boxes(WALL), low.lowest_safe_m - 1.1).ok is False


def test_under_a_beam_only_a_low_return_helps_and_behind_a_wall_none():
    curve = line([12.0, 0, 5], [12, 5, 5])
    under = trace(curve, boxes(BEAM), 30.0)
    assert not under.ok
    assert under.lowest_safe_m <= 15 - KEEP_M
    assert trace(curve, boxes(BEAM), under.lowest_safe_m).ok
    caught = trace(curve, boxes(BEAM, WALL), 30.0)
    assert not caught.ok
    assert caught.lowest_safe_m is None


def test_landing_on_the_spot_is_blocked_over_the_structure_only():
    curve = line([-20.0, 0, 30], [20, 0, 30])
    found = trace(curve, boxes(WALL), 30.0)
    assert found.ok
    ((start, end),) = found.landing_blocked_s
    assert curve.value(start)[0] == pytest.approx(-2 - KEEP_M, abs=TOLERANCE_M)
    assert curve.value(end)[0] == pytest.approx(2 + KEEP_M, abs=TOLERANCE_M)


def test_something_over_home_blocks_every_return():
    roof = ((-32, -2, 20), (-28, 2, 21))
    found = trace(line([0.0, 0, 5], [10, 0, 5]), boxes(roof), 30.0)
    assert not found.ok
    assert found.blocked_s[0][0] == 0.0
    assert found.lowest_safe_m is not None
    assert found.lowest_safe_m < 20


def test_an_unknown_return_altitude_is_not_ok():
    found = trace(line([0.0, 0, 5], [10, 0, 5]), boxes(((50, 50, 0), (51, 51, 1))), None)
    assert not found.ok
    assert "not known" in found.reason
    assert found.lowest_safe_m is not None


def test_the_tower_flight_agrees_with_brute_force(tower_flight, tower_scenario, tower_distance):
    plan = SimpleNamespace(scenario=tower_scenario, trajectory=tower_flight.built.trajectory)
    home = np.array(tower_scenario.home_m)
    for altitude in (10.0, 40.0):
        found = check_ways_home(plan, tower_distance, ReturnFlight(altitude))
        t = np.linspace(0, plan.trajectory.duration_s, 1500)
        share = np.linspace(0, 1, 120)[:, None]
        clear = []
        for p in plan.trajectory.value(t):
            top = np.array([p[0], p[1], max(p[2], altitude)])
            over = np.array([home[0], home[1], top[2]])
            way = np.concatenate([(1 - share) * a + share * b for a, b in ((p, top), (top, over), (over, home))])
            clear.append(tower_distance.distance(way, ground=False).min())
        blocked = np.zeros(len(t), dtype=bool)
        for start, end in found.blocked_s:
            blocked |= (t >= start - 0.3) & (t <= end + 0.3)
        clear = np.array(clear)
        assert found.ok == (altitude == 40.0)
        assert clear[~blocked].min() >= KEEP_M
        if not found.ok:
            assert clear.min() < KEEP_M


def test_where_no_altitude_helps_the_rest_gets_the_lowest_that_does():
    curve = line([-20.0, 0, 30], [12, 0, 30], [12, 0, 5])
    found = trace(curve, boxes(BEAM, WALL), 40.0)
    assert not found.ok
    assert found.lowest_safe_m is None
    assert 25 + KEEP_M <= found.clearest_m <= 25 + KEEP_M + TOLERANCE_M + 1
    ((start, end),) = found.never_clear_s
    # On the way down, from where the beam is passed.
    assert curve.value(start)[2] == pytest.approx(17 + KEEP_M, abs=TOLERANCE_M)
    assert end == pytest.approx(curve.duration_s)
    assert found.blocked_s == found.never_clear_s


def test_a_cone_about_home_can_keep_a_return_too_low():
    curve = line([-26.0, 0, 5], [-26, 4, 5])
    post = ((-28.5, -20, 0), (-27.5, 20, 12))
    assert trace(curve, boxes(post), 30.0).ok
    assert not trace(curve, boxes(post), 30.0, cone_slope=1.0).ok
    assert trace(curve, boxes(post), 30.0, cone_slope=1.0, cone_reach_m=3.0).ok
    assert trace(curve, boxes(post), 30.0, cone_slope=4.0).ok
    assert trace(curve, boxes(post), 30.0, cone_slope=1.0, cone_climb_m=9.0).ok


@pytest.mark.parametrize(
    ("flight", "height", "aside", "level"),
    [
        (ReturnFlight(30.0), 10.0, 50.0, 30.0),
        (ReturnFlight(30.0), 40.0, 50.0, 40.0),
        (ReturnFlight(30.0, least_climb_m=5.0), 40.0, 50.0, 45.0),
        (ReturnFlight(30.0, cone_slope=3.0, cone_climb_m=2.5), 10.0, 6.0, 18.0),
        (ReturnFlight(30.0, cone_slope=3.0, cone_climb_m=2.5), 10.0, 2.0, 12.5),
        (ReturnFlight(30.0, cone_slope=3.0, cone_climb_m=2.5), 29.0, 2.0, 30.0),
        (ReturnFlight(30.0, cone_slope=1.0, cone_reach_m=10.0), 2.0, 9.0, 9.0),
        (ReturnFlight(30.0, cone_slope=1.0, cone_reach_m=10.0), 2.0, 11.0, 30.0),
        (ReturnFlight(30.0, cone_slope=1.0, cone_reach_m=10.0, cone_floor_m=4.0), 2.0, 3.0, 4.0),
    ],
)
def test_the_level_of_a_return(flight, height, aside, level):
    assert flight.level_m(np.array([height]), np.array([aside]))[0] == pytest.approx(level)


def test_braking_into_something_blocks_everything():
    curve = line([-12.0, 0, 5], [-6, 0, 5], speed=6.0)

    def found(deceleration):
        return trace_ways_home(
            curve, boxes(WALL), HOME, ReturnFlight(30.0), KEEP_M, SilentProgress(), deceleration_m_s2=deceleration
        )

    assert found(10.0).hold_blocked_s == ()  # 1.8 m of braking, from at most 4 m before the wall
    ((start, end),) = found(4.0).hold_blocked_s  # 4.5 m
    assert -2 - KEEP_M - 4.5 - curve.value(start)[0] == pytest.approx(0.0, abs=TOLERANCE_M)
    assert end == pytest.approx(curve.duration_s)
    assert found(4.0).landing_blocked_s[0] == pytest.approx((start, end), abs=0.05)
    assert found(4.0).blocked_s[0] == pytest.approx((start, end), abs=0.05)


def test_a_return_begins_where_the_vehicle_has_come_to_rest():
    # It passes under the beam's edge only while it brakes.
    curve = line([4.0, 0, 10], [8, 0, 10], speed=4.0)
    scene = boxes(BEAM)
    still = trace_ways_home(curve, scene, HOME, ReturnFlight(30.0), KEEP_M, SilentProgress())
    braking = trace_ways_home(curve, scene, HOME, ReturnFlight(30.0), KEEP_M, SilentProgress(), deceleration_m_s2=2.0)
    assert still.blocked_s == ()
    ((start, _),) = braking.blocked_s
    assert curve.value(start)[0] == pytest.approx(10 - KEEP_M - 4.0, abs=TOLERANCE_M)


def test_a_return_from_one_place(tower_scenario, tower_distance):
    plan = SimpleNamespace(scenario=tower_scenario)
    top = tower_scenario.home_m[2] + 200.0
    assert return_is_clear(plan, tower_distance, ReturnFlight(10.0), [0.0, 0.0, top], [0.0, 0.0, 0.0])
    assert not return_is_clear(plan, tower_distance, ReturnFlight(10.0), [0.0, 0.0, top], [0.0, 0.0, -60.0])


def test_a_return_does_not_cross_what_the_fence_leaves_out():
    curve = line([20.0, 0, 10], [20, 10, 10])
    nothing = boxes(((50, 50, 0), (51, 51, 1)))
    corners = np.array([[-10.0, -3], [0, -3], [0, 3], [-10, 3]])
    out = FenceVolume(corners, np.array([0, 4]), 0, np.inf, 0.5)

    def found(fence):
        return trace_ways_home(curve, nothing, HOME, ReturnFlight(30.0), KEEP_M, SilentProgress(), fence=fence)

    assert found(None).ok
    ((start, end),) = found(out).blocked_s
    assert start == 0.0
    # The line home from (20, y) passes (-10, 0.4 y).
    assert 0.4 * curve.value(end)[1] == pytest.approx(3 + 0.5, abs=2 * TOLERANCE_M)
    assert found(out).clearest_m is not None


def test_margins_come_from_the_scenario(tower_flight, tower_scenario, tower_distance):
    plan = SimpleNamespace(scenario=tower_scenario, trajectory=tower_flight.built.trajectory)
    wide = tower_scenario.safety.model_copy(update={"position_m": 5.6})
    careful = SimpleNamespace(scenario=tower_scenario.model_copy(update={"safety": wide}), trajectory=plan.trajectory)
    assert check_ways_home(plan, tower_distance, ReturnFlight(40.0)).ok
    assert not check_ways_home(careful, tower_distance, ReturnFlight(40.0)).ok
    assert replace(check_ways_home(plan, tower_distance, ReturnFlight(40.0)), ok=False).reason == ""
