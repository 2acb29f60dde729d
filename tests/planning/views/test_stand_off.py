"""The papers' camera models: figures that were checked by hand, substitution, and rays through a picture's corners."""

import math

import numpy as np
import pytest

from gcs.core.camera import Camera
from gcs.core.errors import InfeasibleError
from gcs.planning.views.stand_off import (
    cell_stand_off,
    footprint,
    magnification,
    printed_compensated_stand_off,
    printed_footprint,
    printed_stand_off,
    printed_working_distance,
    working_distance,
)

CRANE = Camera(
    sensor_width_mm=13.2, sensor_height_mm=8.8, focal_length_mm=8.8, image_width_px=5472, image_height_px=3648
)


def with_fields(across_deg, along_deg):
    across, along = (2 * math.tan(math.radians(a) / 2) for a in (across_deg, along_deg))
    width = round(4000 * across / along)
    return Camera(
        sensor_width_mm=10 * across,
        sensor_height_mm=10 * along,
        focal_length_mm=10,
        image_width_px=width,
        image_height_px=4000,
    )


def corners(camera, height, depression):
    """Where the picture's corner rays meet the plane, as (along, across); near ones first. None above the horizon."""
    view = np.array([math.cos(depression), 0, -math.sin(depression)])
    up = np.array([math.sin(depression), 0, math.cos(depression)])
    found = []
    for vertical in (-1, 1):
        for side in (-1, 1):
            ray = view + vertical * camera.half_height_tangent * up
            ray = ray + side * camera.half_width_tangent * np.array([0, 1, 0])
            found.append(None if ray[2] >= 0 else height / -ray[2] * ray[:2])
    return found


@pytest.mark.parametrize("depression_deg", [20, 30, 45, 60, 80, 90])
def test_the_footprint_is_where_the_corner_rays_meet_the_plane(depression_deg):
    camera, depression = with_fields(40, 30), math.radians(depression_deg)
    shown = footprint(camera, 10, depression)
    near_left, near_right, far_left, far_right = corners(camera, 10, depression)
    assert near_left[0] == pytest.approx(shown.near_m, abs=1e-9)
    assert near_right[1] - near_left[1] == pytest.approx(shown.near_width_m)
    assert far_left[0] == pytest.approx(shown.far_m)
    assert far_right[1] - far_left[1] == pytest.approx(shown.far_width_m)
    assert shown.aim_m == pytest.approx(10 / math.tan(depression), abs=1e-9)


def test_a_picture_with_the_horizon_has_no_far_edge():
    shown = footprint(with_fields(40, 30), 10, math.radians(10))
    assert shown.far_m == shown.far_width_m == math.inf
    assert shown.near_m > 0


def test_straight_down_both_forms_give_the_pinhole():
    """`2 d tan(α/2)`; as printed, with tan 90°, the paper's form is not defined."""
    camera, d = with_fields(40, 30), 7.0
    shown = footprint(camera, d, math.pi / 2)
    for value, angle in ((shown.near_width_m, 40), (shown.far_width_m, 40), (shown.even_length_m, 30)):
        assert value == pytest.approx(2 * d * math.tan(math.radians(angle / 2)))
        assert printed_footprint(d, math.pi / 2, math.radians(angle)) == pytest.approx(value)


@pytest.mark.parametrize("depression_deg", [30, 45, 60, 75])
def test_the_printed_length_is_the_even_part_of_the_footprint(depression_deg):
    camera, depression = with_fields(40, 30), math.radians(depression_deg)
    shown = footprint(camera, 10, depression)
    assert printed_footprint(10, depression, math.radians(30)) == pytest.approx(shown.even_length_m)
    assert shown.even_length_m <= shown.far_m - shown.near_m


def test_the_printed_width_is_31_percent_more_than_the_near_edge_shows():
    depression = math.radians(45)
    printed = printed_footprint(10, depression, math.radians(40))
    assert printed / footprint(with_fields(40, 30), 10, depression).near_width_m == pytest.approx(1.31, abs=0.005)


def as_printed(extent, depression, field):
    """Eqs 5 and 6 letter by letter."""
    far = math.tan(depression + field / 2)
    return extent * abs(math.tan(depression)) * far / (2 * (far - abs(math.tan(depression))))


@pytest.mark.parametrize("depression_deg", [30, 45, 60, 85, 90])
@pytest.mark.parametrize("field_deg", [20, 40, 55])
def test_the_stand_off_is_the_footprints_inverse(depression_deg, field_deg):
    depression, field = math.radians(depression_deg), math.radians(field_deg)
    extent = printed_footprint(12.5, depression, field)
    assert printed_stand_off(extent, depression, field) == pytest.approx(12.5)
    if depression_deg < 90:
        assert printed_stand_off(extent, depression, field) == pytest.approx(as_printed(extent, depression, field))


def test_the_printed_compensation_works_backwards():
    """10 m, 60°, 0.3 m: as printed the camera comes to 9.74 m, where 10.52 m keep the cell in view."""
    depression = field = math.radians(60)
    cell = printed_footprint(10, depression, field)
    assert printed_compensated_stand_off(cell, 0.3, depression, field) == pytest.approx(9.74, abs=0.005)
    sure = cell_stand_off(with_fields(60, 60), 0.1, cell, depression, length_error_m=0.3)
    assert sure.height_m == pytest.approx(10.52, abs=0.005)
    assert sure.limited_by == "length"


@pytest.mark.parametrize("depression_deg", [35, 60, 90])
@pytest.mark.parametrize(("width", "length"), [(4.0, 1.0), (1.0, 3.0)])
def test_a_cell_stays_in_the_picture_whatever_the_error(depression_deg, width, length):
    camera, depression = with_fields(50, 36), math.radians(depression_deg)
    found = cell_stand_off(camera, width, length, depression, width_error_m=0.4, length_error_m=0.25)
    position = np.array([-found.height_m / math.tan(depression), 0, found.height_m])
    assert np.linalg.norm(position) == pytest.approx(found.distance_m)
    view = np.array([math.cos(depression), 0, -math.sin(depression)])
    up = np.array([math.sin(depression), 0, math.cos(depression)])
    fullest, deepest = 0.0, 0.0
    for along in (-1, 1):
        for across in (-1, 1):
            for error_along in (-0.25, 0.25):
                for error_across in (-0.4, 0.4):
                    corner = np.array([along * length / 2, across * width / 2, 0])
                    ray = corner - position - [error_along, error_across, 0]
                    depth = ray @ view
                    shares = (
                        abs(ray[1]) / depth / camera.half_width_tangent,
                        abs(ray @ up) / depth / camera.half_height_tangent,
                    )
                    assert max(shares) <= 1 + 1e-9
                    fullest, deepest = max(fullest, *shares), max(deepest, depth)
    assert fullest == pytest.approx(1), "no further away than needed"
    assert found.gsd_m == pytest.approx(camera.gsd_at(deepest))


def test_the_gsd_must_still_hold_there():
    camera = with_fields(40, 30)
    free = cell_stand_off(camera, 3, 2, math.radians(60), width_error_m=0.3, length_error_m=0.3)
    kept = cell_stand_off(
        camera, 3, 2, math.radians(60), width_error_m=0.3, length_error_m=0.3, gsd_m=free.gsd_m * 1.001
    )
    assert kept == free
    with pytest.raises(InfeasibleError, match=f"{1000 * free.gsd_m:.2f} mm"):
        cell_stand_off(camera, 3, 2, math.radians(60), width_error_m=0.3, length_error_m=0.3, gsd_m=free.gsd_m * 0.999)


def test_the_crane_papers_working_distance():
    """f = 8.8 mm, a chip of 13.2 mm, a field of 3 m: 2 m, and 0.04 mm as printed."""
    assert magnification(13.2, 3.0) == pytest.approx(0.0044)
    assert working_distance(CRANE, 3.0, 1.0) == pytest.approx(2.0)
    assert 8.8e-3 / magnification(13.2, 3.0) == pytest.approx(2.0)
    assert working_distance(CRANE, 3.0, 2.5) == pytest.approx(2.5), "the height asks for more"
    assert printed_working_distance(8.8, 13.2, 3.0) == pytest.approx(0.04e-3, abs=0.002e-3)


@pytest.mark.parametrize("depression_deg", [0, -30, 91])
def test_a_camera_that_does_not_look_down_has_no_footprint(depression_deg):
    with pytest.raises(ValueError, match="depression angle"):
        footprint(CRANE, 10, math.radians(depression_deg))
