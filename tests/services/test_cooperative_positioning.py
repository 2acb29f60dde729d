"""Sightings on fake time: used when they are needed, refused when they cannot be, and each thing said once."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.vehicle import Heard, Telemetry
from gcs.mavlink.sightings import ObserverFix, ObserverPlace, SightingReport
from gcs.services.cooperative_positioning import CooperativePositioning

ORIGIN = GeoPoint(31.3622, 121.6155, 4.0)
OBSERVER_M = np.array([2.0, -24.0, 9.0])
TRUE_M = np.array([1.0, 0.5, 6.0])
DEVIATIONS = (0.05, 0.005, 0.005)
BOOT_S = 50.0
"""The observer's clock runs so far ahead of the station's here."""


def place_of(position_m, at_s):
    latitude, longitude, altitude = geodetic_from_enu(position_m, ORIGIN)
    return ObserverPlace(at_s, GeoPoint(float(latitude), float(longitude), float(altitude)), np.zeros(3))


def sighted(now_s, seen_m=TRUE_M, **changes):
    way = seen_m - OBSERVER_M
    pitch = math.atan2(way[2], math.hypot(way[0], way[1]))
    report = SightingReport(now_s, 1, float(np.linalg.norm(way)), pitch, math.atan2(way[1], way[0]), DEVIATIONS)
    return replace(report, **changes)


class Scene:
    """An observer with a good fix, and what the other vehicle tells; time is the station's."""

    def __init__(self, *, fix=1):
        self.said = []
        self.now_s = 0.0
        self.positioning = CooperativePositioning("px4-2", "px4-1", 1, self.said.append)
        self.fix = fix
        self.own_m = TRUE_M
        self.tell(ObserverFix(6, 0.02, 0.03))
        self.look()

    @property
    def seen(self):
        own, fix = Heard(self.own_m, self.now_s), Heard(self.fix, self.now_s)
        return Telemetry(gps_fix=fix, origin=Heard(ORIGIN, self.now_s), local_position_m=own)

    def look(self):
        self.positioning.watch(self.seen, self.now_s)

    def tell(self, told):
        return self.positioning.take(told, self.now_s + BOOT_S, self.seen, self.now_s)

    def pass_s(self, seconds):
        self.now_s += seconds
        self.tell(place_of(OBSERVER_M, self.now_s + BOOT_S))
        self.look()

    def sight(self, **changes):
        return self.tell(sighted(self.now_s + BOOT_S, **changes))

    def position(self, ahead_s=0.0):
        return self.positioning.position(self.now_s + BOOT_S, ahead_s, ORIGIN, 7.0, 0.0)


def test_a_vehicle_with_its_own_fix_is_told_nothing():
    scene = Scene(fix=3)
    scene.pass_s(0.1)
    assert scene.sight() is None
    assert scene.sight(range_m=math.nan) is None
    assert scene.said == []
    assert scene.positioning.source is None
    with pytest.raises(InputError):
        scene.position()


def test_a_lost_fix_is_stood_in_for_until_it_is_back_and_both_vehicles_are_named():
    scene = Scene()
    scene.pass_s(0.1)
    fix = scene.sight()
    assert np.allclose(fix.position_m, TRUE_M, atol=0.01)
    told = scene.position()
    assert np.allclose(told.position_m, TRUE_M, atol=0.01)
    assert np.allclose(told.position_covariance_m2, fix.covariance_m2, rtol=1e-6)
    assert "px4-2" in scene.positioning.source
    scene.fix = 3
    scene.pass_s(0.1)
    assert scene.sight() is None
    assert scene.positioning.source is None
    assert len(scene.said) == 2
    assert all("px4-1" in text and "px4-2" in text for text in scene.said)


def test_the_covariance_is_that_of_both_sensors():
    scene = Scene()
    scene.pass_s(0.1)
    covariance = scene.sight().covariance_m2
    distance = float(np.linalg.norm(TRUE_M - OBSERVER_M))
    way = (TRUE_M - OBSERVER_M) / distance
    place = np.diag([0.02, 0.02, 0.03]) ** 2
    along = way @ covariance @ way
    assert along == pytest.approx(0.05**2 + way @ place @ way, rel=0.02)
    assert np.trace(covariance) == pytest.approx(0.05**2 + 2 * (0.005 * distance) ** 2 + np.trace(place), rel=0.02)


def test_each_loss_of_the_fix_begins_anew():
    scene = Scene()
    resets = []
    for fix in (1, 3, 1, 3, 1):
        scene.fix = fix
        scene.pass_s(0.1)
        if scene.sight() is not None:
            resets.append(scene.position().resets)
    assert resets == [1, 2, 3]


def test_a_moving_vehicle_is_told_where_it_will_be_and_how_fast_it_goes():
    scene = Scene()
    velocity = np.array([1.5, -0.5, 0.3])
    for _ in range(40):
        scene.pass_s(0.1)
        scene.own_m = TRUE_M + scene.now_s * velocity
        scene.tell(sighted(scene.now_s + BOOT_S, scene.own_m))
    for ahead_s in (-0.2, 0.0, 0.05):
        told = scene.position(ahead_s)
        assert np.allclose(told.velocity_m_s, velocity, atol=0.05)
        assert np.allclose(told.position_m, scene.own_m + ahead_s * velocity, atol=0.02)
        assert told.at_vehicle_s == pytest.approx(7.0 + ahead_s)


@pytest.mark.parametrize(
    "changes",
    [
        {"range_m": 0.0},
        {"range_m": math.nan},
        {"pitch_rad": 3.0},
        {"azimuth_rad": math.nan},
        {"deviations": (0.05, 0.0, 0.005)},
        {"deviations": (math.nan, 0.005, 0.005)},
        {"seen_system": 3},
        {"at_s": BOOT_S - 5.0},
        {"at_s": BOOT_S + 60.0},
        {"range_m": 80.0},
        {"azimuth_rad": 0.0},
    ],
)
def test_what_cannot_be_is_refused_and_said_once_and_the_next_good_one_counts(changes):
    scene = Scene()
    scene.pass_s(0.1)
    before = len(scene.said)
    for _ in range(3):
        assert scene.sight(**changes) is None
        scene.pass_s(0.1)
    assert len(scene.said) == before + 1
    assert "px4-2" in scene.said[-1]
    assert scene.sight() is not None


def test_a_repeated_and_an_older_sighting_are_refused():
    scene = Scene()
    scene.pass_s(0.1)
    first = sighted(scene.now_s + BOOT_S)
    assert scene.tell(first) is not None
    scene.pass_s(0.1)
    assert scene.tell(first) is None
    assert scene.sight() is not None
    assert scene.tell(first) is None
    assert len(scene.said) == 2  # the lost fix, and the repetition


def test_an_observer_without_a_fix_or_a_place_is_no_help():
    scene = Scene()
    scene.pass_s(0.1)
    scene.tell(ObserverFix(1, None, None))
    assert scene.sight() is None
    assert "no position fix itself" in scene.said[-1]
    scene.tell(ObserverFix(3, None, None))
    scene.pass_s(0.1)
    rough = scene.sight()
    assert math.sqrt(rough.covariance_m2[2, 2]) > 2.5  # a usual receiver, since it tells nothing better
    scene.now_s += 2.0
    scene.look()
    assert scene.sight() is None
    assert "where it was then" in scene.said[-1]


def test_dead_reckoning_may_drift_further_the_longer_it_lasts():
    scene = Scene()
    scene.pass_s(0.1)
    scene.own_m = TRUE_M + np.array([8.0, 0.0, 0.0])
    assert scene.sight() is None
    for _ in range(100):
        scene.pass_s(0.1)
    assert scene.sight() is not None


def test_silence_of_the_observer_is_said_once():
    scene = Scene()
    scene.pass_s(0.1)
    scene.sight()
    for _ in range(40):
        scene.pass_s(0.1)
    assert scene.positioning.source == "dead reckoning"
    assert sum("no sighting of px4-2" in text for text in scene.said) == 1


def test_few_sightings_are_used_and_said():
    scene = Scene()
    for _ in range(6):
        scene.pass_s(0.4)
        assert scene.sight() is not None
    assert sum("times a second" in text for text in scene.said) == 1
