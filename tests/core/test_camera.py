"""Depth of field against a thin lens, blur and skew against a moving pinhole, and what a camera may not be."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from gcs.core.camera import Camera

FULL_FRAME = {
    "sensor_width_mm": 36.0,
    "sensor_height_mm": 24.0,
    "focal_length_mm": 50.0,
    "image_width_px": 6000,
    "image_height_px": 4000,
}


def camera(**changes):
    return Camera(**{**FULL_FRAME, **changes})


def circle_px(c, focus_m, depth_m):
    """Circle of confusion by tracing the edge of the aperture to the sensor."""
    focal = c.focal_length_mm / 1000
    sensor, image = 1 / (1 / focal - 1 / focus_m), 1 / (1 / focal - 1 / depth_m)
    diameter = focal / c.f_number * abs(sensor - image) / image
    return diameter * 1000 * c.image_width_px / c.sensor_width_mm


def test_the_textbook_hyperfocal_distance():
    """50 mm at f/16 with a circle of 0.03 mm: 5.26 m, and half of that to infinity when focused there."""
    c = camera(f_number=16, blur_circle_px=5.0)
    assert c.hyperfocal_m == pytest.approx(5.258, abs=5e-4)
    nearest, furthest = c.sharp_between_m(c.hyperfocal_m)
    assert nearest == pytest.approx(c.hyperfocal_m / 2, rel=1e-9)
    assert furthest == math.inf


@pytest.mark.parametrize("focus", [0.5, 2.0, 8.0, 29.0])
@pytest.mark.parametrize(("f_number", "focal"), [(1.8, 24.0), (5.6, 50.0), (8.0, 80.0)])
def test_the_circle_has_its_limit_at_both_ends(focus, f_number, focal):
    c = camera(f_number=f_number, focal_length_mm=focal)
    nearest, furthest = c.sharp_between_m(focus)
    assert nearest < focus < furthest
    assert circle_px(c, focus, nearest) == pytest.approx(c.blur_circle_px, rel=1e-6)
    if furthest < math.inf:
        assert circle_px(c, focus, furthest) == pytest.approx(c.blur_circle_px, rel=1e-6)
    else:
        assert circle_px(c, focus, 1e9) <= c.blur_circle_px
        assert focus >= c.hyperfocal_m


def test_everything_is_sharp_without_an_f_number():
    assert camera(nearest_focus_m=3.0).sharp_between_m(1.0) == (0.0, math.inf)
    assert camera().hyperfocal_m == 0.0


def test_the_lens_does_not_focus_nearer_than_it_can():
    c = camera(f_number=2.8, nearest_focus_m=3.0)
    assert c.sharp_between_m(1.0) == c.sharp_between_m(3.0)
    assert c.sharp_between_m(1.0)[0] > 2.8


def test_nothing_is_sharp_within_the_focal_length():
    assert camera(f_number=2.8).sharp_between_m(0.04) == (math.inf, math.inf)


def test_blur_and_skew_are_those_of_a_moving_pinhole():
    c = camera(exposure_s=1 / 400, shutter="rolling", readout_s=0.03)
    speed, depth = 1.7, 6.5
    pitch_m = c.sensor_width_mm / c.image_width_px / 1000

    def column(t):
        """Where a point straight ahead of the start is imaged at a time."""
        return -speed * t / depth * c.focal_length_mm / 1000 / pitch_m

    assert c.blur_px(speed, depth) == pytest.approx(abs(column(c.exposure_s) - column(0.0)))
    rows = np.linspace(0.0, c.readout_s, c.image_height_px)
    assert c.skew_px(speed, depth) == pytest.approx(np.ptp([column(t) for t in rows]))


@pytest.mark.parametrize(
    ("changes", "limit"),
    [
        ({"exposure_s": 1 / 500, "max_blur_px": 1.5}, "blur"),
        ({"shutter": "rolling", "readout_s": 0.03}, "skew"),
        ({"shutter": "rolling", "readout_s": 0.03, "exposure_s": 1 / 20}, "blur"),
        ({"shutter": "rolling", "readout_s": 0.03, "exposure_s": 1 / 2000}, "skew"),
    ],
)
def test_the_fastest_speed_just_meets_the_tighter_limit(changes, limit):
    c = camera(**changes)
    fastest = c.fastest_m_s(4.0)
    shares = {"blur": c.blur_px(fastest, 4.0), "skew": c.skew_px(fastest, 4.0)}
    shares = {
        k: v / most
        for (k, v), most in zip(shares.items(), (c.max_blur_px, c.max_skew_px), strict=True)
        if v is not None
    }
    assert max(shares, key=shares.get) == limit
    assert shares[limit] == pytest.approx(1.0)
    assert c.fastest_m_s(8.0) == pytest.approx(2 * fastest)


def test_any_speed_will_do_when_nothing_is_known():
    assert camera().fastest_m_s(1.0) == math.inf
    assert camera(shutter="rolling").fastest_m_s(1.0) == math.inf
    assert camera().blur_px(3.0, 1.0) is None
    assert camera().skew_px(3.0, 1.0) is None


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"readout_s": 0.03}, "say `shutter: rolling`"),
        ({"shutter": "leaf"}, "'global' or 'rolling'"),
        ({"exposure_s": 0.0}, "greater than 0"),
        ({"f_number": -2.8}, "greater than 0"),
        ({"nearest_focus_m": -1.0}, "greater than or equal to 0"),
        ({"focal_range_mm": (24.0, 48.0)}, "50 is outside the zoom range of 24 to 48 mm"),
        ({"focal_range_mm": (70.0, 60.0)}, "outside the zoom range"),
        ({"gimbal": {"pitch_min_deg": 10, "pitch_max_deg": 0}}, "pitch_min_deg must be below"),
    ],
)
def test_what_a_camera_cannot_be(changes, names):
    with pytest.raises(ValidationError) as caught:
        camera(**changes)
    assert names in str(caught.value)
