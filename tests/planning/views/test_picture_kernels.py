"""What pictures show, by the kernels, against the plain formulas that certificates use."""

import itertools
import math

import numpy as np
import pytest

from gcs.core.camera import Camera
from gcs.planning.views.camera_footprint import faces_camera, sharp_in_image
from gcs.planning.views.picture_kernels import (
    LEAST_KEPT,
    PictureLimits,
    aim_pictures,
    facing_targets,
    pictured_targets,
    point_camera,
)
from gcs.planning.views.viewpoint_pose import pose_towards

CAMERA = Camera(
    sensor_width_mm=13.2, sensor_height_mm=8.8, focal_length_mm=24.0, image_width_px=5472, image_height_px=3648,
    f_number=4.0, nearest_focus_m=1.0,
)  # fmt: skip
FURTHEST = 20.0


def limits(**changes):
    plain = PictureLimits(
        half_width=CAMERA.half_width_tangent,
        half_height=CAMERA.half_height_tangent,
        core=1.0,
        nearest=0.0,
        furthest=FURTHEST,
        error=0.0,
        depth_error=0.0,
        focal=CAMERA.focal_length_mm / 1000,
        hyperfocal=CAMERA.hyperfocal_m,
        nearest_focus=CAMERA.nearest_focus_m,
        least_cosine=math.cos(math.radians(60)),
        pitch_low=-math.pi / 2,
        pitch_high=math.radians(30),
    )
    return plain._replace(**changes)


def axes_of(pose):
    return np.concatenate([np.cross(pose.direction, pose.up), pose.up, pose.direction])


def random_targets(rng, n):
    points = rng.uniform(-15, 15, (n, 3)).astype(np.float32)
    normals = rng.normal(size=(n, 3))
    return points, (normals / np.linalg.norm(normals, axis=1)[:, None]).astype(np.float32)


def shown_by(place, axes, focus, points, normals, limits_, tolerant=None):
    tolerant = np.zeros(len(points), bool) if tolerant is None else tolerant
    starts, which = pictured_targets(
        np.array([place], np.float32), axes[None], np.array([focus]), points, normals, tolerant, limits_
    )
    assert starts.tolist() == [0, len(which)]
    mask = np.zeros(len(points), bool)
    mask[which] = True
    return mask


@pytest.mark.parametrize("core", [1.0, 0.7])
def test_a_picture_shows_what_the_certificate_says_it_shows(core):
    rng = np.random.default_rng(0)
    points, normals = random_targets(rng, 20000)
    some = 0
    for _ in range(20):
        place, focus = rng.uniform(-15, 15, 3).astype(np.float32), rng.uniform(5, 15)
        pose = pose_towards("P", place, rng.normal(size=3) * 4 - place, 0.001)
        got = shown_by(place, axes_of(pose), focus, points, normals, limits(core=core))
        p, n = points.astype(float), normals.astype(float)
        expected = sharp_in_image(CAMERA, place, pose.direction, pose.up, p, FURTHEST, focus, core)
        expected &= faces_camera(place, p, n, math.radians(60))
        assert (got != expected).sum() <= 1  # single precision may see one at an edge either way
        some += expected.sum()
    assert some > 500


def test_cameras_point_where_poses_do_and_keep_to_their_pitch_range():
    axes = np.empty(9)
    rng = np.random.default_rng(1)
    for x, y, z in [*rng.normal(size=(20, 3)), (0, 0, -1), (0, 0, 1)]:
        point_camera(x, y, z, limits(pitch_high=math.pi / 2), axes)
        np.testing.assert_allclose(axes, axes_of(pose_towards("P", np.zeros(3), (x, y, z), 1.0)), atol=1e-12)
        point_camera(x, y, z, limits(), axes)
        assert math.asin(min(axes[8], 1.0)) <= math.radians(30) + 1e-12


def test_what_counts_is_still_shown_with_the_camera_off_by_its_error():
    rng = np.random.default_rng(2)
    points, normals = random_targets(rng, 20000)
    wide = limits(half_width=0.8, half_height=0.6, hyperfocal=0.0)
    safe, error = wide._replace(error=0.8, depth_error=0.8), 0.8
    tolerant = np.ones(len(points), bool)
    pose = pose_towards("P", (-14, 0, 0), (1, 0.2, -0.1), 0.001)
    axes = axes_of(pose)
    counted = shown_by(pose.position_m, axes, 10.0, points, normals, safe, tolerant)
    depth = (points - pose.position_m) @ pose.direction
    counted &= depth > error / (1 - LEAST_KEPT) / 0.6  # nearer than this half of the image is kept whatever the error
    assert 500 < counted.sum() < shown_by(pose.position_m, axes, 10.0, points, normals, wide).sum()
    for right, up, back in [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0.7, 0.7, 0), (0, 0, 1)]:
        off = error * (right * axes[:3] + up * axes[3:6] - back * axes[6:9])
        in_picture = shown_by(pose.position_m + off, axes, 10.0, points, normals, wide._replace(least_cosine=0.0))
        facing = ((pose.position_m + off - points) * normals).sum(axis=1) > 0
        assert in_picture[counted & facing].all()


def test_the_position_error_leaves_half_of_a_narrow_picture():
    points = np.array([[10, y, 0] for y in np.linspace(-1, 1, 401)], np.float32)
    normals = np.tile(np.array([-1, 0, 0], np.float32), (401, 1))
    narrow = limits(half_width=0.05, hyperfocal=0.0, error=3.0, depth_error=0.0)
    axes = axes_of(pose_towards("P", np.zeros(3), (1, 0, 0), 0.001))
    shown = shown_by(np.zeros(3), axes, 10.0, points, normals, narrow, np.ones(401, bool))
    assert np.abs(points[shown, 1]).max() == pytest.approx(0.25, abs=0.006)


def test_facing_targets_are_near_and_within_the_incidence():
    rng = np.random.default_rng(3)
    points, normals = random_targets(rng, 5000)
    places = rng.uniform(-10, 10, (4, 3)).astype(np.float32)
    starts, which = facing_targets(places, points, normals, 12.0, 0.5)
    for k, place in enumerate(places):
        way = place.astype(float) - points
        far = np.linalg.norm(way, axis=1)
        expected = np.flatnonzero((far <= 12) & ((way * normals).sum(axis=1) >= 0.5 * far))
        np.testing.assert_array_equal(which[starts[k] : starts[k + 1]], expected)


def test_pictures_are_aimed_at_what_counts():
    # two clusters too far apart for one picture; only the second one counts
    rng = np.random.default_rng(4)
    points = np.concatenate([rng.normal((10, -8, 0), 0.3, (50, 3)), rng.normal((10, 8, 0), 0.3, (50, 3))])
    points = points.astype(np.float32)
    weights = np.where(np.arange(100) < 50, 1e-6, 1.0).astype(np.float32)
    plain = limits(hyperfocal=0.0)
    starts, members, place, axes, focus = aim_pictures(
        np.zeros((1, 3), np.float32),
        np.array([0, 100]),
        np.arange(100, dtype=np.int32),
        points,
        np.ones(100, bool),
        weights,
        rng.random((1, 8), dtype=np.float32),
        plain,
    )
    assert 1 <= len(place) <= 8
    assert (axes[:, 7] > 0.5).all()
    assert members.min() >= 50
    assert len(members) == starts[-1]
    shown = [frozenset(members[a:b].tolist()) for a, b in itertools.pairwise(starts)]
    assert len(set(shown)) == len(shown)
    assert focus[0] == pytest.approx((points[list(shown[0])] @ axes[0, 6:9]).mean(), rel=1e-5)
