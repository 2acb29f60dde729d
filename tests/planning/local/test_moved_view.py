"""Other places for a picture: judged by hand, by brute force on circles, and by what a navigator makes of them."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gcs.core.camera import Camera
from gcs.core.plan import Viewpoint
from gcs.core.replanning import ReplanReason
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.curve_parts import joined_curves
from gcs.planning.local.evasion import standing_room
from gcs.planning.local.moved_view import GAP_M, MovedViews, moved_places, moved_viewpoint, target_of
from gcs.planning.local.navigator import MOST_MOVES, NEXT_WAIT_S, LocalNavigator, Stop
from gcs.planning.local.navigator_options import NavigatorOptions
from gcs.planning.local.surroundings import Scene
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.optimal_times import times_at_limits

SENSOR_MM, FOCAL_MM, PIXELS = 13.2, 8.8, 5472
CAMERA = {
    "sensor_width_mm": SENSOR_MM,
    "sensor_height_mm": 8.8,
    "focal_length_mm": FOCAL_MM,
    "image_width_px": PIXELS,
    "image_height_px": 3648,
}
SAFE = 1.2
LIMITS = FlightLimits(4.0, 2.5, 10.0)


def gsd(distance_m):
    return distance_m * SENSOR_MM / FOCAL_MM / PIXELS


def viewpoint(place=(10.0, 0.0, 10.0), target=(10.0, 8.0, 10.0)):
    towards = np.subtract(target, place)
    distance = float(np.linalg.norm(towards))
    yaw, pitch = math.atan2(towards[1], towards[0]), math.asin(towards[2] / distance)
    return Viewpoint(
        id=7,
        name="P",
        position_m=np.array(place, float),
        direction=towards / distance,
        up=np.array([-math.sin(pitch) * math.cos(yaw), -math.sin(pitch) * math.sin(yaw), math.cos(pitch)]),
        gsd_m=gsd(distance),
        time_s=1.0,
        yaw_rad=yaw,
        gimbal_pitch_rad=pitch,
    )


def turned_deg(view, places):
    """How far the camera is turned, roll included: yaw about the vertical and pitch about the right, by quaternions."""
    towards = target_of(view, Camera(**CAMERA)) - places
    yaws = np.arctan2(towards[:, 1], towards[:, 0])
    pitches = np.arctan2(towards[:, 2], np.hypot(towards[:, 0], towards[:, 1]))
    turned = Rotation.from_euler("ZY", np.column_stack([yaws, -pitches]))
    planned = Rotation.from_euler("ZY", [view.yaw_rad, -view.gimbal_pitch_rad])
    return np.degrees((turned * planned.inv()).magnitude())


@pytest.mark.parametrize("target", [(10.0, 8.0, 10.0), (13.0, 1.0, 8.5), (10.0, 3.0, 4.0), (10.0, 0.0, 2.0)])
@pytest.mark.parametrize("asked", [None, 1.2])
def test_the_places_are_all_those_that_hold_what_was_asked(target, asked):
    view = viewpoint(target=target)
    distance = math.dist(view.position_m, target)
    furthest = distance * (1.1 if asked is None else asked)
    places = moved_places(view, Camera(**CAMERA), None if asked is None else gsd(furthest))
    lengths, turns = np.linalg.norm(places - target, axis=1), turned_deg(view, places)
    assert np.all(places[:, 2] == 10.0)
    assert gsd(lengths.max()) <= gsd(furthest) * (1 + 1e-9) and lengths.min() >= 0.9 * distance
    assert turns.max() <= 20.0 + 1e-6 and np.all(np.diff(turns) >= -1e-5)
    assert np.linalg.norm(places - view.position_m, axis=1).min() > 0.0

    rng = np.random.default_rng(3)
    tried = view.position_m + rng.uniform(-1, 1, (20_000, 3)) * (5.0, 5.0, 0.0)
    lengths, turns = np.linalg.norm(tried - target, axis=1), turned_deg(view, tried)
    good = tried[(lengths > 0.93 * distance) & (lengths < 0.97 * furthest) & (turns < 18.0)]
    good = good[np.linalg.norm(good - view.position_m, axis=1) > 0.5]
    away = np.linalg.norm(good[:, None] - places, axis=2).min(axis=1)
    assert len(good) > 20 and away.max() < 0.3, "and none of them is far from all that were found"


def test_straight_down_no_step_aside_is_no_further_away():
    view = viewpoint(target=(10.0, 0.0, 2.0))
    assert len(moved_places(view, Camera(**CAMERA), view.gsd_m)) == 0
    assert len(moved_places(view, Camera(**CAMERA), None)) > 0


def test_the_gimbal_and_the_focus_must_allow_it():
    view = viewpoint(target=(10.0, 3.0, 4.0))
    steep = math.degrees(math.atan2(6.0, 3.0))
    able = Camera(**CAMERA, gimbal={"pitch_min_deg": -steep})
    places = moved_places(view, able, None)
    level = np.hypot(*(places - (10.0, 3.0, 4.0))[:, :2].T)
    assert len(places) and np.all(level >= 3.0 - 1e-6), "nowhere the camera would have to look steeper"
    near = Camera(**CAMERA, nearest_focus_m=math.dist(view.position_m, (10.0, 3.0, 4.0)))
    assert np.all(np.linalg.norm(moved_places(view, near, None) - (10.0, 3.0, 4.0), axis=1) >= near.nearest_focus_m)


def test_from_there_it_looks_at_the_same_target():
    camera, view = Camera(**CAMERA), viewpoint(target=(13.0, 6.0, 8.0))
    assert target_of(view, camera) == pytest.approx((13.0, 6.0, 8.0))
    place = np.array([8.5, 0.5, 10.0])
    moved = moved_viewpoint(view, place, camera)
    away = math.dist(place, (13.0, 6.0, 8.0))
    assert place + away * moved.direction == pytest.approx((13.0, 6.0, 8.0))
    assert (moved.id, moved.name, moved.gsd_m) == (7, "P", pytest.approx(gsd(away)))
    assert moved.yaw_rad == pytest.approx(math.atan2(5.5, 4.5))
    assert moved.gimbal_pitch_rad == pytest.approx(-math.asin(2.0 / away))
    assert moved.up @ moved.direction == pytest.approx(0.0)


def scene_of(circles, forbidden=None, slab=(9.5, 10.5)):
    middles = np.arange(200) * 0.2 - 10 + 0.1
    x, y = np.meshgrid(middles, middles, indexing="ij")
    blocked = np.zeros(x.shape, dtype=np.bool_)
    for cx, cy, radius in circles:
        blocked |= np.hypot(x - cx, y - cy) < radius
    seen = BinaryMap(blocked, np.array([-10.0, -10.0]), 0.2)
    scene = Scene(50.0, seen, [], np.empty((0, 3)), forbidden, slab, None)
    return scene, standing_room(scene, SAFE)


def open_places(views, *circles, **scene):
    return list(views.open_now(*scene_of(circles, **scene), SAFE))


def from_line(circle, start, end):
    """How far a circle's edge is from a straight."""
    along = np.subtract(end[:2], start[:2])
    share = np.clip(np.subtract(circle[:2], start[:2]) @ along / (along @ along), 0.0, 1.0)
    return math.dist(circle[:2], start[:2] + share * along) - circle[2]


@pytest.mark.parametrize("seed", range(8))
def test_places_to_go_for_are_free_and_see_the_target(seed):
    view = viewpoint()
    views = MovedViews(moved_places(view, Camera(**CAMERA), None), np.array([10.0, 8.0, 10.0]))
    rng = np.random.default_rng(seed)
    circles = [(10.0, 0.0, 0.4), *((*rng.uniform((5.0, -3.0), (15.0, 7.0)), rng.uniform(0.2, 0.8)) for _ in range(3))]
    for place in open_places(views, *circles):
        assert min(math.dist(circle[:2], place[:2]) - circle[2] for circle in circles) >= SAFE
        assert all(from_line(circle, place, (10.0, 8.0 - GAP_M)) > -0.15 for circle in circles)


def test_the_target_itself_may_stand_on_the_map_and_what_hides_it_not():
    views = MovedViews(moved_places(viewpoint(), Camera(**CAMERA), None), np.array([10.0, 8.0, 10.0]))
    wall = [(x, 9.0, 1.0) for x in np.arange(5.0, 15.0, 0.5)]
    assert open_places(views, (10.0, 0.0, 0.4), *wall)
    screen = [(x, 5.0, 0.3) for x in np.arange(5.0, 15.0, 0.4)]
    assert not open_places(views, (10.0, 0.0, 0.4), *wall, *screen)


def test_nowhere_the_map_does_not_hold_and_nowhere_that_is_forbidden():
    views = MovedViews(moved_places(viewpoint(), Camera(**CAMERA), None), np.array([10.0, 8.0, 10.0]))
    assert open_places(views)
    assert not open_places(views, slab=(10.2, 11.2))
    forbidden = np.zeros((200, 200), dtype=np.bool_)
    forbidden[:, :75] = True  # up to y = 5 m
    assert not open_places(views, forbidden=forbidden)


MAST = (10.0, 0.0, 0.4)


def flight(view, after=(20.0, -6.0, 10.0), passes=()):
    places = np.array([(0.0, 0.0, 10.0), view.position_m, after])
    legs = [times_at_limits(np.stack(ends), LIMITS).piecewise_polynomial() for ends in (places[:2], places[1:])]
    views = MovedViews(moved_places(view, Camera(**CAMERA), None), target_of(view, Camera(**CAMERA)))
    first_s = legs[0].duration_s
    stops = [Stop(share * first_s, 20 + k, dwell=False) for k, share in enumerate(passes)]
    stops += [Stop(first_s, 7, others=views), Stop(first_s + legs[1].duration_s, 8)]
    return LocalNavigator(joined_curves(*legs), stops, LIMITS, NavigatorOptions(wait_s=6.0))


def fly(navigator, sector_scan, standing, seconds=120.0, takes=True):
    """Fly among what stands at a time; pictures by viewpoint, reports, and the flown path."""
    pictures, reports, path = {}, [], []
    for clock in np.arange(0.0, seconds, 0.1):
        place = navigator.motion(clock)[0]
        path.append(place)
        navigator.see(sector_scan(place[:2], 0.0, standing(clock)), place, 0.0, clock)
        reports += navigator.decide(clock)
        viewpoint = navigator.arrived
        if viewpoint is not None:
            assert np.linalg.norm(navigator.motion(clock)[1]) < 1e-6
            assert viewpoint not in pictures
            pictures[viewpoint] = place
            navigator.go_on(viewpoint, navigator.moved_to if takes else None)
        if navigator.finished:
            break
    return SimpleNamespace(pictures=pictures, reports=reports, path=np.array(path))


def test_a_mast_on_a_viewpoint_is_looked_past(sector_scan):
    view = viewpoint()
    navigator = flight(view)
    flown = fly(navigator, sector_scan, lambda clock: [MAST])
    assert navigator.finished and not navigator.away
    assert list(flown.pictures) == [7, 8] and flown.pictures[8] == pytest.approx((20.0, -6.0, 10.0), abs=1e-3)
    (report,) = flown.reports
    assert report.reason is ReplanReason.VIEWPOINT_BLOCKED and report.rejoined_clock_s is not None
    ((moved, place),) = report.moved
    assert (moved, report.skipped) == (7, ())
    assert place == pytest.approx(flown.pictures[7], abs=1e-3)
    assert np.hypot(*(flown.path[:, :2] - MAST[:2]).T).min() >= MAST[2] + SAFE - 0.15
    assert math.dist(place[:2], MAST[:2]) >= MAST[2] + SAFE
    assert gsd(math.dist(place, (10.0, 8.0, 10.0))) <= 1.1 * view.gsd_m
    assert turned_deg(view, place[None])[0] <= 20.0
    assert from_line(MAST, place, (10.0, 8.0)) > 0
    assert np.linalg.norm(report.path_m - place, axis=1).min() < 0.1, "the way reported goes by there"


@pytest.mark.parametrize("mast", [(10.0, 0.0, 2.5), (10.0, -0.5, 3.0)])
def test_where_no_place_fits_it_is_skipped_as_ever(sector_scan, mast):
    navigator = flight(viewpoint())
    flown = fly(navigator, sector_scan, lambda clock: [mast])
    assert navigator.finished and list(flown.pictures) == [8]
    assert [(report.skipped, report.moved) for report in flown.reports] == [((7,), ())]


def test_a_picture_that_was_not_taken_is_not_told_as_moved(sector_scan):
    navigator = flight(viewpoint())
    flown = fly(navigator, sector_scan, lambda clock: [MAST], takes=False)
    assert navigator.finished and list(flown.pictures) == [7, 8]
    assert [(report.skipped, report.moved) for report in flown.reports] == [((), ())]


@pytest.mark.parametrize("posts", [1, 10])
def test_where_a_place_is_taken_before_it_is_there_another_is_gone_for_but_not_for_ever(sector_scan, posts):
    navigator = flight(viewpoint())
    taken = []

    def standing(clock):
        place = navigator.moved_to
        if place is not None and len(taken) < posts and all(place is not before for before, _ in taken):
            taken.append((place, clock))
        return [MAST, *((*place[:2], 0.4) for place, _ in taken)]

    flown = fly(navigator, sector_scan, standing)
    (report,) = flown.reports
    assert navigator.finished
    if posts == 1:
        ((_, place),) = report.moved
        assert len(taken) == 1
        assert math.dist(place[:2], taken[0][0][:2]) >= 0.4 + SAFE and report.skipped == ()
    else:
        assert 2 <= len(taken) <= MOST_MOVES
        assert list(flown.pictures) == [8] and (report.skipped, report.moved) == ((7,), ())
    for place, clock in taken:
        after = flown.path[round(clock / 0.1) :]
        assert np.hypot(*(after[:, :2] - place[:2]).T).min() > 0.4 + 0.5 * SAFE
    assert report.rejoined_clock_s - report.left_clock_s < 100.0


def test_what_would_have_been_passed_before_is_told_as_left_out(sector_scan):
    navigator = flight(viewpoint(), passes=(0.2, 0.97))
    flown = fly(navigator, sector_scan, lambda clock: [MAST])
    assert navigator.finished and list(flown.pictures) == [7, 8]
    (report,) = flown.reports
    assert report.skipped == (21,) and [viewpoint for viewpoint, _ in report.moved] == [7]


def test_a_hold_on_the_way_there_is_kept(sector_scan):
    navigator = flight(viewpoint())
    held = []

    def standing(clock):
        if navigator.moved_to is not None and not held:
            held.append(clock)
            navigator.hold()
        if held and clock > held[0] + 10.0:
            navigator.release()
        return [MAST]

    flown = fly(navigator, sector_scan, standing)
    still = flown.path[round((held[0] + 3.0) / 0.1) : round((held[0] + 9.5) / 0.1)]
    assert np.ptp(still, axis=0).max() < 1e-6
    assert list(flown.pictures) == [7, 8] and flown.reports[0].moved
    assert NEXT_WAIT_S < 10.0, "longer than a place is waited for"
