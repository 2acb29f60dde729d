"""The navigator's own doings: stops, holding, bad scans, known structure, continuity (flights: the closed loop)."""

import itertools
import math

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.curve_parts import joined_curves
from gcs.planning.local.lidar_scan import LidarScan
from gcs.planning.local.navigator import SEARCH_EVERY_S, LocalNavigator, Stop
from gcs.planning.local.navigator_options import NavigatorOptions
from gcs.planning.local.way_back import WayBack
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.optimal_times import times_at_limits

LIMITS = FlightLimits(4.0, 2.5, 10.0)
PLACES = np.array([(0.0, 0.0, 10.0), (12.0, 0.0, 10.0), (24.0, 4.0, 14.0)])
STEP = math.radians(5.0)
PERIOD = 0.1


def flight(places=PLACES):
    legs = [times_at_limits(np.stack(ends), LIMITS).piecewise_polynomial() for ends in itertools.pairwise(places)]
    ends = np.cumsum([leg.duration_s for leg in legs])
    return joined_curves(*legs), [Stop(float(end), 7 + k) for k, end in enumerate(ends)]


def run(navigator, begin, end, scan=None):
    """Decisions on the way; the last motion."""
    for clock in np.arange(begin, end, PERIOD):
        if scan is not None:
            navigator.see(scan, navigator.motion(clock)[0], 0.0, clock)
        navigator.decide(clock)
    return navigator.motion(end)


def free_scan():
    return LidarScan(np.full(72, math.inf), 0.0, STEP, 20.0)


def test_the_plan_is_flown_stop_by_stop():
    trajectory, stops = flight()
    navigator = LocalNavigator(trajectory, stops, LIMITS)
    half = stops[0].time_s / 2
    motion = run(navigator, 50.0, 50.0 + half)
    assert np.allclose(motion, [trajectory.value(half, order) for order in range(3)], atol=1e-9)
    assert navigator.plan_time_s == pytest.approx(half)
    motion = run(navigator, 50.0 + half, 80.0)
    assert navigator.arrived == 7
    assert np.allclose(motion, [PLACES[1], np.zeros(3), np.zeros(3)], atol=1e-6)
    navigator.go_on(navigator.arrived)
    assert navigator.arrived is None
    run(navigator, 80.0, 100.0)
    assert navigator.arrived == 8
    navigator.go_on(navigator.arrived)
    run(navigator, 100.0, 102.0)
    assert navigator.finished
    assert navigator.plan_time_s == pytest.approx(trajectory.duration_s)


def test_a_stop_that_is_done_is_left_though_the_vehicle_gave_way_to_something_there(sector_scan):
    trajectory, stops = flight()
    navigator = LocalNavigator(trajectory, stops, LIMITS)
    run(navigator, 0.0, 30.0)
    assert navigator.arrived == 7
    for clock in np.arange(30.0, 40.0, PERIOD):
        place = navigator.motion(clock)[0]
        east, north = PLACES[1][:2]
        comes = (east, north + 8.0 - 1.2 * (clock - 30.0), 0.4)
        navigator.see(sector_scan(place[:2], 0.0, [comes]), place, 0.0, clock)
        navigator.decide(clock)
        if navigator.departing:
            break
    assert navigator.arrived is None
    navigator.go_on(8)
    navigator.go_on(7)
    run(navigator, clock + PERIOD, 80.0, free_scan())
    assert navigator.arrived == 8, "it does not go back to wait where nothing is left to do"


def test_stops_that_are_passed_are_not_waited_for():
    trajectory, stops = flight()
    passed = [Stop(stops[0].time_s / 2, 3, dwell=False), stops[0]]
    navigator = LocalNavigator(trajectory, passed, LIMITS)
    run(navigator, 0.0, 30.0)
    assert navigator.arrived == 7
    navigator.go_on(navigator.arrived)
    run(navigator, 30.0, 60.0)
    assert navigator.finished


def test_it_holds_and_goes_on_when_told():
    trajectory, stops = flight()
    navigator = LocalNavigator(trajectory, stops, LIMITS)
    run(navigator, 0.0, 3.0)
    before = navigator.plan_time_s
    navigator.hold()
    motion = run(navigator, 3.0, 10.0)
    assert navigator.held
    assert np.abs(motion[1:]).max() < 1e-9
    assert np.linalg.norm(motion[0] - trajectory.value(3.0)) < 7.0
    assert navigator.plan_time_s == pytest.approx(before, abs=0.2)
    navigator.release()
    run(navigator, 10.0, 40.0)
    assert navigator.arrived == 7


def test_it_joins_the_plan_from_beside_it():
    trajectory, stops = flight()
    place = np.array([1.0, 5.0, 10.0])
    navigator = LocalNavigator(trajectory, stops, LIMITS, place_m=place)
    assert np.allclose(navigator.motion(5.0), [place, np.zeros(3), np.zeros(3)])
    run(navigator, 5.0, 40.0)
    assert navigator.arrived == 7


def test_the_motion_is_continuous_whatever_is_decided(sector_scan):
    trajectory, stops = flight()
    navigator = LocalNavigator(trajectory, stops, LIMITS)
    rng = np.random.default_rng(2)
    worst = np.zeros(3)
    last = navigator.motion(0.0)
    for clock in np.arange(0.0, 40.0, PERIOD):
        mover = (6.0, -12.0 + 1.3 * clock, 0.8)
        navigator.see(sector_scan(last[0][:2], 0.3, [mover, (9.0, 0.5, 0.4)], rng), last[0], 0.3, clock)
        before = navigator.motion(clock)
        navigator.decide(clock)
        worst = np.maximum(worst, np.abs(navigator.motion(clock) - before).max(axis=1))
        last = navigator.motion(clock + PERIOD)
        assert np.linalg.norm(last[1]) <= 4.0 * (1 + 1e-6)
        assert np.linalg.norm(last[2]) <= 2.5 * (1 + 1e-6)
    assert (worst < 1e-6).all()


def test_detours_keep_out_of_the_known_structure(sector_scan):
    trajectory, stops = flight()
    blocked = np.zeros((80, 80), dtype=np.bool_)
    blocked[:, 44:] = True  # from y = 2 m on, which no lidar sees
    known = BinaryMap(blocked, np.array([-20.0, -20.0]), 0.5)
    navigator = LocalNavigator(trajectory, stops[:1], LIMITS, NavigatorOptions(known=known))
    northmost = -math.inf
    for clock in np.arange(0.0, 40.0, PERIOD):
        place = navigator.motion(clock)[0]
        northmost = max(northmost, place[1])
        navigator.see(sector_scan(place[:2], 0.0, [(6.5, -0.4, 0.5)]), place, 0.0, clock)
        navigator.decide(clock)
        if navigator.arrived is not None:
            break
    assert navigator.arrived == 7
    assert northmost < 2.0


def ring_scan(sector_scan, place, radius=2.6):
    """Posts all about a place, too near to each other to pass."""
    turns = np.linspace(0.0, 2 * math.pi, 12, endpoint=False)
    return sector_scan(place[:2], 0.0, [(place[0] + radius * math.cos(a), radius * math.sin(a), 0.3) for a in turns])


def test_walled_in_it_looks_for_a_way_now_and_then_gives_viewpoints_up_and_the_flight_last(sector_scan, monkeypatch):
    looked = []
    find = WayBack.find
    monkeypatch.setattr(WayBack, "find", lambda way, *at: looked.append(way.scene.clock_s) or find(way, *at))
    trajectory, stops = flight(PLACES * (1.0, 1.0, 0.0) + (0.0, 0.0, 10.0))
    options = NavigatorOptions(wait_s=6.0, give_up_s=15.0)
    navigator = LocalNavigator(trajectory, stops, LIMITS, options)
    skipped_at, seen = {}, ring_scan(sector_scan, PLACES[0])
    for clock in np.arange(0.0, 60.0, PERIOD):
        navigator.see(seen, PLACES[0], 0.0, clock)
        reports = navigator.decide(clock)
        for stop in stops:
            if stop not in navigator._todo:
                skipped_at.setdefault(stop.viewpoint, clock)
        if navigator.gave_up is not None:
            break
    assert np.linalg.norm(navigator.motion(clock)[0] - PLACES[0]) < 1.0
    assert min(np.diff(looked)) >= SEARCH_EVERY_S - 1e-9
    assert np.median(np.diff(looked)) < SEARCH_EVERY_S + 2 * PERIOD
    assert 6.0 <= skipped_at[7] < 12.0
    assert skipped_at[8] - skipped_at[7] == pytest.approx(5.0, abs=0.3)
    assert 15.0 <= clock - skipped_at[8] < 20.0
    assert reports[-1].skipped == (7, 8)
    assert len(reports[-1].path_m) >= 1


def test_a_skipped_viewpoint_beside_the_known_structure_is_no_trap(sector_scan):
    """The plan runs where the coarse known map is blocked; what is parked on it is left out, and the flight goes on."""
    places = np.array([(0.0, 0.0, 10.0), (10.0, 0.0, 10.0), (20.0, 0.0, 10.0), (20.0, -9.0, 10.0)])
    trajectory, stops = flight(places)
    blocked = np.zeros((100, 100, 60), dtype=np.bool_)
    blocked[:, 49:, :] = True  # from y = -0.5 m on, with the plan in it
    known = BinaryMap(blocked, np.array([-25.0, -25.0, 0.0]), 0.5)
    options = NavigatorOptions(known=known, slab_half_m=0.5, wait_s=5.0)
    navigator = LocalNavigator(trajectory, stops, LIMITS, options)
    photos, skipped = [], []
    for clock in np.arange(0.0, 120.0, PERIOD):
        place = navigator.motion(clock)[0]
        assert place[1] < 1.2  # not through the wall
        navigator.see(sector_scan(place[:2], 0.0, [(11.0, 0.3, 0.8)]), place, 0.0, clock)
        skipped += [viewpoint for report in navigator.decide(clock) for viewpoint in report.skipped]
        if navigator.arrived is not None:
            photos.append(navigator.arrived)
            navigator.go_on(navigator.arrived)
        if navigator.finished:
            break
    assert navigator.finished
    assert (photos, skipped) == ([8, 9], [7])


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: LidarScan(np.zeros(72), 0.0, STEP, 20.0), "ranges_m"),
        (lambda: LidarScan(np.full(72, math.nan), 0.0, STEP, 20.0), "ranges_m"),
        (lambda: LidarScan(np.full(72, 5.0), 0.0, 2 * STEP, 20.0), "step_rad"),
        (lambda: LidarScan(np.full(72, 5.0), 0.0, 0.0, 20.0), "step_rad"),
    ],
)
def test_scans_that_cannot_be_are_refused_by_name(make, field):
    with pytest.raises(InputError) as error:
        make()
    assert error.value.field == field


def test_a_bad_pose_or_an_old_scan_changes_nothing():
    trajectory, stops = flight()
    navigators = [LocalNavigator(trajectory, stops, LIMITS) for _ in range(2)]
    for navigator in navigators:
        run(navigator, 0.0, 2.0, free_scan())
    wall = LidarScan(np.full(72, 3.0), 0.0, STEP, 20.0)
    for position, heading, clock in (
        (np.array([math.nan, 0.0, 0.0]), 0.0, 2.0),
        (np.zeros(2), 0.0, 2.0),
        (np.zeros(3), math.inf, 2.0),
        (np.zeros(3), 0.0, math.nan),
        (np.zeros(3), 0.0, 1.0),
    ):
        with pytest.raises(InputError):
            navigators[1].see(wall, position, heading, clock)
    one, other = (run(navigator, 2.0, 4.0, free_scan()) for navigator in navigators)
    assert (one == other).all()


def test_something_on_the_vehicle_itself_does_not_stop_it_from_thinking():
    trajectory, stops = flight()
    navigator = LocalNavigator(trajectory, stops, LIMITS)
    ranges = np.full(72, math.inf)
    ranges[:20] = 0.0
    motion = run(navigator, 0.0, 20.0, LidarScan(ranges, 0.0, STEP, 20.0))
    assert np.isfinite(motion).all()
    assert np.linalg.norm(motion[1]) <= 4.0
    assert motion[0, 0] < 0.5  # it goes no nearer, but away from what covers its front


def test_plans_that_cannot_be_flown_are_refused_by_name():
    trajectory, stops = flight()
    for bad, field in (
        ([Stop(2.0, 5)], "viewpoint 5"),  # it moves there
        ([stops[1], stops[0]], "viewpoint 7"),
        ([Stop(1e3, 1)], "viewpoint 1"),
    ):
        with pytest.raises(InputError) as error:
            LocalNavigator(trajectory, bad, LIMITS)
        assert error.value.field == field
    with pytest.raises(InputError) as error:
        LocalNavigator(trajectory, stops, LIMITS, start_s=-1.0)
    assert error.value.field == "start_s"
