"""Viewpoints of named points in front of simple walls, where the right answer is known."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from gcs.core.camera import Camera, Gimbal
from gcs.core.errors import InfeasibleError
from gcs.core.inspection import NamedPoint
from gcs.core.scenario import Safety, VehicleSpec
from gcs.core.structure import Structure
from gcs.planning.scene.fence import FenceVolume, room_in_fence
from gcs.planning.scene.free_space import EVERYWHERE
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.scene.visibility import SightLines
from gcs.planning.views.picture_limits import NearestPlace, nearest_place, nearest_sharp_m
from gcs.planning.views.viewpoints_points import find_point_viewpoints, stand_off_m

SENSOR = {
    "sensor_width_mm": 13.2,
    "sensor_height_mm": 8.8,
    "focal_length_mm": 8.8,
    "image_width_px": 5472,
    "image_height_px": 3648,
}
CAMERA = Camera(**SENSOR)
WALL = ((0, 0, 20), (2, 20, 40))  # middle and size; its face towards +x is at x = 1
FACE = (1.0, 0.0, 20.0)


class Room:
    """Free space without a grid: exact distances; what lies in `closed` is free but not connected."""

    def __init__(self, structure, clearance_m, ground_m=0.0, closed=None, sky=None, fence=EVERYWHERE):
        self.clearance_m = clearance_m
        self.model = SimpleNamespace(fence=fence, tolerance=0.0)
        self._distance = SceneDistance(structure, ground_m)
        self._closed = closed or (lambda p: np.zeros(len(p), bool))
        self._sky = sky or (lambda p: np.ones(len(p), bool))

    def is_free(self, points):
        inside = room_in_fence(points, self.model.fence) >= 0.0
        return inside & (self._distance.distance(points) >= self.clearance_m - 1e-9)

    def is_reachable(self, points):
        return self.is_free(points) & ~self._closed(np.asarray(points))

    def is_open_sky(self, points):
        return self._sky(np.asarray(points))

    def largest_clearance_m(self, places, fenced=True):
        if not fenced and (self._distance.distance(places) >= self.clearance_m).any():
            return self.clearance_m
        return 0.5 if len(places) else 0.0


def boxes(*parts):
    meshes = []
    for middle, size in parts:
        mesh = trimesh.creation.box(size)
        mesh.apply_translation(middle)
        meshes.append(mesh)
    whole = trimesh.util.concatenate(meshes)
    return Structure(np.asarray(whole.vertices), np.asarray(whole.faces))


def nearest(clearance_m, camera=CAMERA, position_error_m=0.0, **vehicle):
    """From how near a point may be photographed with only these numbers."""
    scenario = SimpleNamespace(
        camera=camera, safety=Safety(position_m=position_error_m), vehicle=VehicleSpec(**vehicle)
    )
    return nearest_place(scenario, clearance_m)


def find_all(structure, point, clearance=3.0, camera=CAMERA, place=None, **room):
    return find_point_viewpoints(
        point,
        camera,
        place or nearest(clearance, camera),
        Room(structure, clearance, **room),
        SightLines(structure),
        furthest_m=40.0,
    )


def find(*args, **kwargs):
    """The best one."""
    return find_all(*args, **kwargs)[0]


def named(position=FACE, normal=(1, 0, 0), gsd_mm=None):
    return NamedPoint(name="P7", position_m=position, normal=normal, gsd_mm=gsd_mm)


def tilt_deg(pose, point):
    away = pose.position_m - np.array(point.position_m)
    return math.degrees(math.acos(away @ np.array(point.normal) / np.linalg.norm(away)))


def test_the_picture_is_three_metres_wide_where_the_clearance_allows():
    pose = find(boxes(WALL), named(), clearance=1.5)
    np.testing.assert_allclose(pose.position_m, [3, 0, 20])
    np.testing.assert_allclose(pose.direction, [-1, 0, 0], atol=1e-12)
    assert pose.gsd_m * CAMERA.image_width_px == pytest.approx(3.0)
    assert abs(pose.yaw_rad) == pytest.approx(math.pi)
    assert pose.gimbal_pitch_rad == pytest.approx(0)


def test_the_clearance_comes_first_without_a_gsd():
    np.testing.assert_allclose(find(boxes(WALL), named(), clearance=3.3).position_m, [4.3, 0, 20])


def test_a_gsd_is_had_from_as_far_as_it_can():
    pose = find(boxes(WALL), named(gsd_mm=2.0))
    np.testing.assert_allclose(pose.position_m[0] - 1, 0.002 * 8.8 * 5472 / 13.2)
    assert pose.gsd_m == pytest.approx(0.002)


def test_a_gsd_finer_than_the_clearance_allows_names_the_point_and_the_best():
    with pytest.raises(
        InfeasibleError, match=r"points\.P7: a GSD of 0\.5 mm .* best it can have is 0\.83 mm"
    ) as caught:
        stand_off_m(named(gsd_mm=0.5), CAMERA, nearest(3.0), 40.0)
    assert caught.value.exit_status == 3
    assert CAMERA.gsd_at(3.0) == pytest.approx(0.00082, abs=5e-6)


def test_the_position_error_cannot_move_a_point_out_of_the_picture():
    long_lens = Camera(**{**SENSOR, "focal_length_mm": 88.0})  # half the picture's height: 0.05 m a metre of distance
    place = nearest(2.0, long_lens, position_error_m=0.3)
    assert place.distance_m == pytest.approx(0.3 / (8.8 / (2 * 88.0)))
    pose = find(boxes(WALL), named(), clearance=2.0, camera=long_lens, place=place)
    depth = pose.position_m[0] - 1
    assert depth * long_lens.half_height_tangent >= 0.3 - 1e-9
    with pytest.raises(InfeasibleError, match=r"points\.P7: a GSD .* whatever the position error, only from 6\.00 m"):
        stand_off_m(named(gsd_mm=1000 * long_lens.gsd_at(5.9)), long_lens, place, 40.0)


def test_pictures_are_not_taken_nearer_than_the_lens_focuses():
    camera = Camera(**SENSOR, f_number=2.8, nearest_focus_m=5.0)
    near, _ = camera.sharp_between_m(5.0)
    assert nearest_sharp_m(camera, VehicleSpec(), 0.25) == pytest.approx(near + 0.25)
    assert find(boxes(WALL), named(), camera=camera).position_m[0] - 1 == pytest.approx(max(near, 3.0))
    assert nearest_sharp_m(CAMERA, VehicleSpec(), 0.25) == 0, "without optics everything is sharp"


def test_a_slow_shutter_keeps_its_distance_from_what_it_drifts_along():
    camera = Camera(**SENSOR, exposure_s=1 / 50)
    # at the nearest distance the drift during the exposure is one pixel wide
    depth = 0.1 / 50 * 5472 * 8.8 / 13.2
    assert nearest_sharp_m(camera, VehicleSpec(hover_speed_m_s=0.1), 0.0) == pytest.approx(depth)
    place = nearest(3.0, camera, hover_speed_m_s=0.1)
    assert place.distance_m == pytest.approx(depth)
    assert find(boxes(WALL), named(), camera=camera, place=place).position_m[0] - 1 == pytest.approx(depth)
    with pytest.raises(InfeasibleError, match=r"sharp only from 7\.30 m .* the best it can have is 2\.00 mm"):
        stand_off_m(named(gsd_mm=1.5), camera, place, 40.0)


def test_what_is_too_far_to_be_searched_says_so():
    with pytest.raises(InfeasibleError, match=r"points\.P7: far, and viewpoints are at most 40 m away"):
        stand_off_m(named(), CAMERA, NearestPlace(41.0, "far"), 40.0)


def test_a_gsd_is_kept_when_the_straight_place_is_blocked():
    pole = ((9, 0, 20), (0.2, 0.2, 40))
    structure = boxes(WALL, pole)
    point = named(gsd_mm=4.0)
    pose = find(structure, point)
    assert pose.gsd_m <= 0.004
    assert tilt_deg(pose, point) <= 60
    assert SceneDistance(structure, 0.0).distance(pose.position_m) >= 3.0 - 1e-6


def test_an_obstacle_in_front_is_looked_past_at_the_least_tilt():
    screen = ((2.5, 0, 20), (0.1, 1.0, 1.0))
    structure = boxes(WALL, screen)
    point = named()
    pose = find(structure, point)
    assert 0 < tilt_deg(pose, point) <= 40.01
    assert SightLines(structure).clear(pose.position_m, [point.position_m], 0.02)[0]
    np.testing.assert_allclose(np.cross(pose.direction, np.array(point.position_m) - pose.position_m), 0, atol=1e-9)


def test_open_sky_decides_between_equally_tilted_places():
    screen = ((2.5, 0, 20), (0.1, 1.0, 1.0))
    pose = find(boxes(WALL, screen), named(), sky=lambda p: p[:, 1] < -0.5)
    assert pose.position_m[1] < -0.5
    other = find(boxes(WALL, screen), named(), sky=lambda p: p[:, 1] > 0.5)
    assert other.position_m[1] > 0.5
    assert tilt_deg(pose, named()) == pytest.approx(tilt_deg(other, named()))


def test_a_normal_into_a_slim_structure_names_the_point_and_says_so():
    with pytest.raises(InfeasibleError, match=r"points\.P7: every stand-off place .* is inside the structure"):
        find(boxes(((0, 0, 20), (7, 7, 38))), named((3.5, 0, 20), (-1, 0, 0)), clearance=4.0)


def test_a_normal_into_a_hollow_structure_names_the_point_and_says_so():
    inside = {"closed": lambda p: (np.abs(p[:, :2]) < 20).all(axis=1)}
    said = r"points\.P7: .* are inside the structure or enclosed by it: .* with 0\.50 m .* it can be reached"
    with pytest.raises(InfeasibleError, match=said):
        find(boxes(((0, 0, 20), (40, 40, 38))), named((20, 0, 20), (-1, 0, 0)), **inside)


def test_a_point_that_the_structure_hides_says_so():
    hood = [((2, y, 20), (2.2, 0.1, 2)) for y in (-1, 1)] + [((2, 0, 20 + z), (2.2, 2, 0.1)) for z in (-1, 1)]
    lid = ((3.05, 0, 20), (0.1, 2.1, 2.1))
    with pytest.raises(InfeasibleError, match=r"points\.P7: the structure hides it"):
        find(boxes(WALL, *hood, lid), named())


def test_below_the_ground_nobody_can_stand():
    with pytest.raises(InfeasibleError, match=r"points\.P7: every stand-off place .* below the ground"):
        find(boxes(((0, 0, 3), (20, 20, 1))), named((0, 0, 2.5), (0, 0, -1)))


def test_a_fence_that_leaves_out_every_stand_off_place_is_named():
    west = np.array([[-50.0, -50], [0.5, -50], [0.5, 50], [-50, 50]])
    fence = FenceVolume(west, np.array([0, 4]), 1, math.inf, 0.5)
    with pytest.raises(InfeasibleError, match=r"points\.P7: the fence leaves out every stand-off place"):
        find(boxes(WALL), named(), fence=fence)
    find(boxes(WALL), named((-1.0, 0.0, 20.0), (-1, 0, 0)), fence=fence)


def test_a_fence_that_is_too_low_is_not_called_the_gimbals_fault():
    low = FenceVolume(np.zeros((0, 2)), np.zeros(1, np.int64), 0, 18.0, 0.5)
    camera = Camera(**SENSOR, gimbal=Gimbal(pitch_max_deg=20))  # from 17.5 m and at most 6 m away it looks up steeper
    with pytest.raises(InfeasibleError, match=r"points\.P7: the fence leaves out .*: raise its max_height_m"):
        find(boxes(WALL), named(), camera=camera, fence=low)
    find(boxes(WALL), named(), camera=camera, fence=low._replace(max_height_m=21.0))


def test_a_fence_is_not_blamed_for_what_would_be_the_same_without_it():
    wide = FenceVolume(np.zeros((0, 2)), np.zeros(1, np.int64), 0, 22.0, 0.5)
    with pytest.raises(InfeasibleError, match=r"points\.P7: every stand-off place .* is inside the structure"):
        find(boxes(((0, 0, 20), (7, 7, 38))), named((3.5, 0, 20), (-1, 0, 0)), clearance=4.0, fence=wide)


@pytest.mark.parametrize("gsd_mm", [None, 4.0])
def test_others_that_are_offered_keep_every_limit_and_are_well_apart(gsd_mm):
    pole, point = ((7, 3, 20), (0.2, 0.2, 40)), named(gsd_mm=gsd_mm)
    structure, camera = boxes(WALL, pole), Camera(**SENSOR, gimbal=Gimbal(pitch_min_deg=-20, pitch_max_deg=15))
    sky = {"sky": lambda p: p[:, 2] > 19.0}
    poses = find_all(structure, point, camera=camera, **sky)
    assert 4 <= len(poses) <= 6
    places = np.array([p.position_m for p in poses])
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(len(poses), 1)]
    assert apart.min() >= 0.5
    assert (SceneDistance(structure, 0.0).distance(places) >= 3.0 - 1e-6).all()
    assert SightLines(structure).clear(places, np.broadcast_to(FACE, places.shape), 0.02).all()
    assert sky["sky"](places).all()
    best = np.linalg.norm(places[0] - FACE)
    for pose in poses:
        towards = np.array(FACE) - pose.position_m
        np.testing.assert_allclose(pose.direction, towards / np.linalg.norm(towards), atol=1e-12)
        assert -20.001 <= math.degrees(pose.gimbal_pitch_rad) <= 15.001
        assert tilt_deg(pose, point) <= 30.001
        assert pose.gsd_m == pytest.approx(camera.gsd_at(np.linalg.norm(towards)))
        assert best / 1.2001 <= np.linalg.norm(towards) <= 1.2001 * best
        assert gsd_mm is None or pose.gsd_m <= gsd_mm / 1000 + 1e-12
        assert pose.name == "P7"


@pytest.mark.parametrize(("pitch_max_deg", "possible"), [(30, False), (40, True), (90, True)])
def test_the_gimbal_limits_how_an_underside_is_seen(pitch_max_deg, possible):
    deck, point = boxes(((0, 0, 30), (20, 20, 1))), named((0, 0, 29.5), (0, 0, -1))
    camera = Camera(**SENSOR, gimbal=Gimbal(pitch_max_deg=pitch_max_deg))
    if possible:
        pose = find(deck, point, camera=camera)
        assert 0 < math.degrees(pose.gimbal_pitch_rad) <= pitch_max_deg + 1e-6
        assert tilt_deg(pose, point) <= 60
    else:
        with pytest.raises(InfeasibleError, match=r"points\.P7: the gimbal cannot look at it"):
            find(deck, point, camera=camera)
