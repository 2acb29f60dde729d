"""What is in a picture, by closed forms."""

import math

import numpy as np
import pytest

from gcs.core.camera import Camera
from gcs.planning.views.camera_footprint import (
    faces_camera,
    footprint_area,
    furthest_in_image,
    in_image,
    sharp_in_image,
)

CAMERA = Camera(
    sensor_width_mm=13.2, sensor_height_mm=8.8, focal_length_mm=8.8, image_width_px=5472, image_height_px=3648
)
"""At 10 m it shows 15 m x 10 m."""


def seen(points, depth=20.0, core=1.0, direction=(1, 0, 0), up=(0, 0, 1)):
    return in_image(CAMERA, (0, 0, 0), direction, up, np.array(points, dtype=float), depth, core).tolist()


def test_the_image_is_wide_across_up():
    assert seen([[10, 7.4, 0], [10, 7.6, 0], [10, -7.4, 4.9], [10, 0, 5.1]]) == [True, False, True, False]
    assert seen([[10, 0, 7.4], [10, 5.1, 0]], up=(0, 1, 0)) == [True, False]


def test_behind_the_camera_is_not_seen():
    assert seen([[-10, 0, 0]]) == [False]


def test_the_limit_is_on_the_depth_along_the_axis_not_on_the_distance():
    assert seen([[19.9, 14, 9], [20.1, 0, 0]]) == [True, False]


def test_the_core_is_a_share_of_width_and_height():
    assert seen([[10, 5.2, 0], [10, 5.3, 0], [10, 0, 3.4], [10, 0, 3.6]], core=0.7) == [True, False, True, False]


def test_incidence_and_side():
    points = np.zeros((5, 3))
    normals = np.array([[1, 0, 0]] * 5, dtype=float)
    angle = np.radians([0, 59, 61, 89, 180])
    cameras = 7 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(5)])
    assert faces_camera(cameras, points, normals, math.radians(60)).tolist() == [True, True, False, False, False]
    assert faces_camera(cameras[1], points, normals, math.radians(60)).all()


def test_furthest_point_and_area():
    assert furthest_in_image(CAMERA, 10) == pytest.approx(math.sqrt(100 + 7.5**2 + 5**2))
    assert footprint_area(CAMERA, 10) == pytest.approx(150)


def test_only_the_depth_of_field_is_sharp():
    camera = CAMERA.model_copy(update={"f_number": 2.8, "focal_length_mm": 30.0})
    nearest, furthest = camera.sharp_between_m(8.0)
    assert 5 < nearest < 8 < furthest < 20
    depths = np.array([nearest - 0.01, nearest + 0.01, 8.0, furthest - 0.01, furthest + 0.01])
    points = np.array([1, 2, 3]) + np.column_stack([depths, 0.05 * depths, np.zeros(5)])
    pose = [1, 2, 3], [1, 0, 0], [0, 0, 1]
    assert sharp_in_image(camera, *pose, points, 100.0, 8.0).tolist() == [False, True, True, True, False]
    assert sharp_in_image(camera, *pose, points, 8.5, 8.0).tolist() == [False, True, True, False, False]
    assert sharp_in_image(camera, *pose, points, 100.0, 8.0, core=0.01).sum() == 0
    assert sharp_in_image(CAMERA, *pose, points, 100.0, 8.0).all()
