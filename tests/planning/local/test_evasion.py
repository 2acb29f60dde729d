"""Moving obstacles: conflicts in space and time, and what is done about them, against their true motion."""

import math

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.evasion import EvasionOptions, evade
from gcs.planning.local.hover import hover
from gcs.planning.local.moving_tracks import Track
from gcs.planning.local.rest_search import search_rest
from gcs.planning.local.room import room_about
from gcs.planning.local.space_time import MovingClearance, Predictions, first_conflict_s
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.optimal_times import times_at_limits

LIMITS = FlightLimits(5.0, 2.5, 10.0)
HEIGHT = 10.0
KEEP = 1.5
OPTIONS = EvasionOptions(safe_m=KEEP, moving=MovingClearance(keep_m=KEEP))
CELL = 0.25
CLEAR = MovingClearance(keep_m=KEEP)


def flight():
    return times_at_limits(np.array([(0, 0, HEIGHT), (60, 0, HEIGHT)]), LIMITS).piecewise_polynomial()


def empty_map():
    return BinaryMap(np.zeros((280, 160), dtype=np.bool_), np.array([-5.0, -20.0]), CELL)


def walled_map(half_width):
    area = empty_map()
    y = (np.arange(160) + 0.5) * CELL - 20.0
    area.blocked[:, np.abs(y) > half_width] = True
    return area


def conflict_s(curve, begin, tracks, clearance):
    return first_conflict_s(Predictions.of(tracks, begin, clearance).margins_m(curve))


def mover(x, y, vx, vy, radius=0.8, sure=0.05):
    return Track(1, 0.0, np.array([x, y, vx, vy]), np.eye(4) * sure**2, 0.01, radius, 10, 0.0)


def least_distance(curve, track, seconds):
    """From the mover's true straight motion, by many points."""
    times = np.linspace(0.0, seconds, 4000)
    places = track.positions(track.time_s + times)
    return float(np.linalg.norm(curve.value(times)[:, :2] - places, axis=1).min()) - track.radius_m


def test_a_conflict_is_found_when_it_is_and_not_in_space_alone():
    curve = flight()
    time = 13.0
    place = curve.value(time)[:2]
    crossing = mover(place[0], -2.0 * time, 0.0, 2.0)
    clearance = MovingClearance(keep_m=KEEP, horizon_s=20.0)
    met = conflict_s(curve, 0.0, [crossing], clearance)
    assert time - 4.0 < met < time
    assert least_distance(curve, crossing, met - 0.1) > KEEP
    late = mover(place[0], -2.0 * (time + 8.0), 0.0, 2.0)
    assert conflict_s(curve, 0.0, [late], clearance) is None
    assert conflict_s(curve, 0.0, [crossing], MovingClearance(keep_m=KEEP, horizon_s=5.0)) is None
    assert conflict_s(curve, 0.0, [], clearance) is None


@pytest.mark.parametrize("seed", range(20))
def test_no_conflict_is_a_proof(seed):
    rng = np.random.default_rng(seed)
    curve = flight()
    track = mover(*rng.uniform((5, -15), (40, 15)), *rng.uniform(-3, 3, 2))
    met = conflict_s(curve, 0.0, [track], MovingClearance(keep_m=KEEP, horizon_s=8.0))
    if met is None:
        assert least_distance(curve, track, 8.0) >= KEEP
    else:
        unsure = 2.0 * track.deviations_m([8.0])[0]
        assert least_distance(curve, track, met + 0.1) <= KEEP + unsure + 0.3


def test_unsure_tracks_are_met_sooner():
    curve = flight()
    sure, unsure = mover(30.0, -20.0, 0.0, 1.3), mover(30.0, -20.0, 0.0, 1.3, sure=0.3)
    clearance = MovingClearance(keep_m=KEEP, most_unsure_m=20.0, horizon_s=20.0)
    first, second = (conflict_s(curve, 0.0, [track], clearance) for track in (unsure, sure))
    assert first < second


def assert_safe(evasion, track, area=None, clock=0.0):
    assert least_distance(evasion.curve, track.at(clock), OPTIONS.moving.horizon_s) >= KEEP
    times = np.linspace(0.0, evasion.curve.duration_s, 4000)
    for order, most in ((1, 5.0), (2, 2.5), (3, 10.0)):
        assert np.linalg.norm(evasion.curve.value(times, order), axis=1).max() <= most * (1 + 1e-6)
    if area is not None:
        near = evasion.curve.value(np.linspace(0.0, min(OPTIONS.moving.horizon_s, times[-1]), 1000))[:, :2]
        assert not any(area.is_blocked(point) for point in near)


def test_what_passes_in_good_time_is_let_pass():
    away = mover(30.0, 12.0, 0.0, 2.0)
    evasion = evade(flight(), 8.0, empty_map(), [away], 0.0, LIMITS, OPTIONS)
    assert evasion.kind == "fly on"
    assert evasion.detour is None
    assert evasion.curve.duration_s == pytest.approx(flight().duration_s - 8.0)


def test_slow_traffic_on_the_way_is_flown_round():
    now = 9.0
    slow = mover(flight().value(now)[0] + 15.0, 0.0, 0.3, 0.0)
    evasion = evade(flight(), now, empty_map(), [slow], 0.0, LIMITS, OPTIONS)
    assert evasion.kind == "detour"
    assert evasion.detour.leave_s > now
    assert_safe(evasion, slow)
    assert np.allclose(evasion.curve.value(0.0), flight().value(now))


def test_where_there_is_no_room_to_pass_it_waits():
    now = 8.0
    place = flight().value(now)[0]
    crossing = mover(place + 14.0, -6.0, 0.0, 1.0)
    area = walled_map(2.5)
    kinds = set()
    for step in range(8):  # so near as it can still stop, and then it stops
        time = 0.4 * step
        evasion = evade(flight(), now + time, area, [crossing], time, LIMITS, OPTIONS)
        kinds.add(evasion.kind)
        assert_safe(evasion, crossing, area, time)
        assert np.linalg.norm(evasion.curve.value(evasion.curve.duration_s, 1)) < 1e-9
        if evasion.kind == "hover":
            break
    assert kinds == {"fly on", "hover"}


def test_what_comes_towards_a_hovering_vehicle_is_backed_off_from():
    coming = mover(9.0, 0.0, -1.5, 0.0)
    evasion = evade(flight(), 0.0, empty_map(), [coming], 0.0, LIMITS, OPTIONS)
    assert evasion.kind in {"detour", "back off"}
    assert_safe(evasion, coming)
    between_walls = walled_map(4.0)
    evasion = evade(flight(), 0.0, between_walls, [mover(4.0, -1.6, -0.5, 0.0)], 0.0, LIMITS, OPTIONS)
    assert evasion.kind == "back off"
    assert_safe(evasion, mover(4.0, -1.6, -0.5, 0.0), between_walls)


def test_when_nothing_is_safe_it_is_said_and_the_least_bad_is_done():
    area, coming = walled_map(2.0), mover(8.0, 0.0, -4.0, 0.0)
    evasion = evade(flight(), 0.0, area, [coming], 0.0, LIMITS, OPTIONS)
    assert evasion.kind == "back off"
    assert evasion.margin_m < 0
    staying = Predictions.of([coming], 0.0, OPTIONS.moving).least_margin_m(hover(flight().value(0.0)))
    assert evasion.margin_m >= staying


def test_a_vehicle_that_touches_a_wall_is_told_so():
    area = walled_map(2.0)
    area.blocked[18:23, 79:81] = True  # on the vehicle itself
    with pytest.raises(InfeasibleError, match="take over by hand"):
        evade(flight(), 0.0, area, [], 0.0, LIMITS, OPTIONS)


def test_a_vehicle_nearer_than_it_should_be_moves_away():
    area = empty_map()
    area.blocked[20:40, 84:90] = True  # from y = 1 m, over the vehicle's place
    still = hover(flight().value(0.0) + np.array([3.0, 0.0, 0.0]))
    assert 0.0 < area.room_m((3.0, 0.0)) < KEEP
    evasion = evade(still, 0.0, area, [], 0.0, LIMITS, OPTIONS)
    assert evasion.kind == "back off"
    end = evasion.curve.value(evasion.curve.duration_s)[:2]
    assert not area.grown(KEEP).is_blocked(end)
    times = np.linspace(0.0, evasion.curve.duration_s, 500)
    assert not any(area.grown(evasion.kept_m).is_blocked(p) for p in evasion.curve.value(times)[:, :2])


def test_the_movers_own_cells_do_not_block_the_vehicle():
    area = empty_map()
    x, y = np.meshgrid(*[(np.arange(n) + 0.5) * CELL + low for n, low in ((280, -5.0), (160, -20.0))], indexing="ij")
    away = mover(3.0, 0.0, 3.0, 0.0)
    area.blocked[np.hypot(x - 3.0, y) < 0.8] = True
    assert evade(flight(), 0.0, area, [away], 0.0, LIMITS, OPTIONS).kind == "fly on"
    assert area.blocked.any()  # the map that was given is left as it was


@pytest.mark.parametrize("speed", [0.0, 0.5, 2.0, 4.9])
@pytest.mark.parametrize("turn", [0.0, 1.0, math.pi])
def test_curves_to_rest_start_as_told_end_at_rest_and_hold_the_limits(speed, turn):
    state = np.zeros((4, 3))
    state[0], state[1, 0] = (3.0, 4.0, HEIGHT), speed
    goal = state[0] + 13.0 * np.array([math.cos(turn), math.sin(turn), 0.0])
    found = search_rest(state, goal[None], LIMITS, room_about(empty_map(), None, KEEP), Predictions.of([], 0.0, CLEAR))
    curve = found.curve(0)
    for order in range(3):
        assert np.allclose(curve.value(0.0, order), state[order], atol=1e-8)
        assert np.allclose(curve.value(curve.duration_s, order), goal if order == 0 else 0.0, atol=1e-6)
    times = np.linspace(0.0, curve.duration_s, 3000)
    for order, most in ((1, 5.0), (2, 2.5), (3, 10.0)):
        assert np.linalg.norm(curve.value(times, order), axis=1).max() <= most


@pytest.mark.parametrize("seed", range(10))
def test_what_a_curve_to_rest_is_said_to_keep_it_keeps(seed):
    rng = np.random.default_rng(seed)
    area = empty_map()
    area.blocked[30:34, 70:74] = True
    state = np.zeros((3, 3))
    state[0], state[1, :2] = (0.0, 0.0, HEIGHT), rng.uniform(-3, 3, 2)
    places = np.array([1.0, 1.0, 0.0]) * rng.uniform(-5, 8, (20, 3)) + [0.0, 0.0, HEIGHT]
    crossing = mover(6.0, -4.0, *rng.uniform(-2, 2, 2))
    found = search_rest(state, places, LIMITS, room_about(area, None, KEEP), Predictions.of([crossing], 0.0, CLEAR))
    blocked = area.points_m(np.argwhere(area.blocked) + 0.5)
    checked = 0
    for k in np.flatnonzero(np.isfinite(found.durations_s)):
        curve = found.curve(k)
        points = curve.value(np.linspace(0.0, curve.duration_s, 300))[:, :2]
        off = np.abs(points[:, None] - blocked) - CELL / 2
        truly = np.linalg.norm(np.maximum(off, 0.0), axis=2).min()
        assert found.rooms_m[k] <= truly + 1e-9
        assert found.margins_m[k] <= least_distance(curve, crossing, CLEAR.horizon_s) - CLEAR.keep_m + 1e-9
        checked += 1
    assert checked >= 10


def test_it_does_not_back_off_into_what_is_forbidden_deeper_than_it_must():
    """A wall that no lidar sees stands north of the vehicle; something quick and wide comes along it from the west."""
    area = empty_map()
    forbidden = np.zeros(area.blocked.shape, dtype=np.bool_)
    north = int(np.ceil((2.0 - area.origin_m[1]) / area.cell_m))
    forbidden[:, north:] = True
    place = np.array([20.0, 1.0, 10.0])
    stay = hover(place)
    comes = mover(8.0, 0.0, 3.5, 0.0, radius=1.0)
    evasion = evade(stay, 0.0, area, [comes], 0.0, LIMITS, OPTIONS, forbidden=forbidden)
    assert evasion.kind == "back off"
    places = evasion.curve.value(np.linspace(0.0, evasion.curve.duration_s, 1000))
    assert places[:, 1].max() < 2.0 + KEEP / 2


def test_room_inside_the_forbidden_falls_with_depth():
    area = empty_map()
    forbidden = np.zeros(area.blocked.shape, dtype=np.bool_)
    forbidden[100:, :] = True
    room = room_about(area, forbidden, KEEP)
    edge = area.origin_m[0] + 100 * area.cell_m
    for depth in (1.0, 3.0, 5.0):
        assert room.at(np.array([edge + depth, 0.0])) == pytest.approx(KEEP - depth, abs=0.4)
        assert room.at(np.array([edge - depth, 0.0])) == pytest.approx(KEEP + depth, abs=0.4)
