"""A viewpoint on which something stands is pictured from aside, if that shows the same as well, and told as moved."""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.frames import enu_from_geodetic
from gcs.core.inspection import FaceTask, NamedPoint, SurfaceTask
from gcs.core.replanning import ReplanReason, ViewpointFate
from gcs.core.structure import Structure
from gcs.mavlink.companion_lease import LeaseState
from gcs.services.companion.moved_pictures import moved_views

SENSOR_MM, FOCAL_MM, PIXELS = 13.2, 8.8, 5472
TARGET = np.array([12.0, 3.0 / 1000 * FOCAL_MM * PIXELS / SENSOR_MM, 6.0])
"""Of the first viewpoint, which looks north from (12, 0, 6) with 3 mm a pixel."""


def mast(radius_m, place=(12.0, 0.0)):
    return {"kind": "vehicle", "radius_m": radius_m, "height_m": 20.0, "path_m": [place]}


def world_with(make_world, make_flyable, autopilot, *obstacles):
    world = make_world(autopilot, obstacles=obstacles)
    flyable = make_flyable()
    world.plans.plans[flyable.plan_hash] = replace(flyable, others=moved_views(flyable.plan, None))
    world.take_off()
    world.order()
    return world


def changes(world):
    return [(report, change) for report in world.outbox.reports for change in report.viewpoints]


def test_what_stands_on_a_viewpoint_is_looked_past(make_world, make_flyable, autopilot):
    world = world_with(make_world, make_flyable, autopilot, mast(0.5))
    world.fly_until(LeaseState.FINISHED)
    assert world.world.truth()["obstacles"]["touched"] == {}
    ((report, change),) = changes(world)
    assert (change.viewpoint, change.fate) == (0, ViewpointFate.MOVED)
    assert report.reason is ReplanReason.VIEWPOINT_BLOCKED and report.rejoined_at_s is not None
    first, second = (shot.exposure for shot in world.vehicle.camera.shots)
    plan = next(iter(world.plans.plans.values())).plan
    geo = change.place
    place = enu_from_geodetic(geo.latitude_deg, geo.longitude_deg, geo.altitude_m, plan.scenario.anchor.point)
    assert first.position_m == pytest.approx(place, abs=0.35)
    away = TARGET - place
    assert np.linalg.norm(away) * SENSOR_MM / FOCAL_MM / PIXELS <= 0.003 * 1.1, "the GSD holds"
    assert math.degrees(math.acos(away[1] / np.linalg.norm(away))) <= 20.1
    assert first.yaw_rad == pytest.approx(math.atan2(away[1], away[0]), abs=math.radians(6.0))
    assert first.pitch_rad == pytest.approx(0.0, abs=math.radians(4.0))
    assert second.position_m == pytest.approx((12.0, 8.0, 6.0), abs=0.35)
    assert second.yaw_rad == pytest.approx(math.pi / 2, abs=math.radians(6.0)), "it turns back"


def test_where_nothing_fits_it_is_skipped(make_world, make_flyable):
    world = world_with(make_world, make_flyable, "px4", mast(3.0))
    world.fly_until(LeaseState.FINISHED)
    assert [(change.viewpoint, change.fate) for _, change in changes(world)] == [(0, ViewpointFate.SKIPPED)]
    assert len(world.vehicle.camera.shots) == 1
    assert world.world.truth()["obstacles"]["touched"] == {}


def test_a_moved_picture_that_nobody_announces_is_told_as_skipped_only(make_world, make_flyable):
    world = world_with(make_world, make_flyable, "px4", mast(0.5))
    world.drop = lambda message: message.get_type().startswith("CAMERA_")
    world.fly_until(LeaseState.FINISHED)
    told = [(change.viewpoint, change.fate) for _, change in changes(world)]
    assert told == [(0, ViewpointFate.SKIPPED), (1, ViewpointFate.SKIPPED)]
    assert world.outbox.reports[-1].reason is ReplanReason.NO_PICTURE


def test_a_pilot_who_takes_over_on_the_way_there_ends_it(make_world, make_flyable):
    world = world_with(make_world, make_flyable, "px4", mast(0.5))
    assert world.run(100.0, lambda: getattr(world.core._flight._navigator, "moved_to", None) is not None)
    world.run(1.0)
    world.vehicle.set_mode_by_name("POSCTL")
    world.fly_until(LeaseState.TAKEN_OVER, timeout_s=2.0)
    told = [(change.viewpoint, change.fate) for _, change in changes(world)]
    assert told == [(0, ViewpointFate.SKIPPED), (1, ViewpointFate.SKIPPED)]


def of_task(make_flyable, name, **inspection):
    plan = make_flyable().plan
    asked = SimpleNamespace(**({"surface": None, "points": (), "faces": ()} | inspection))
    scenario = SimpleNamespace(camera=plan.scenario.camera, inspection=asked)
    viewpoint = replace(plan.viewpoints[0], name=name)
    return SimpleNamespace(scenario=scenario, viewpoints=(viewpoint, replace(viewpoint, id=1, stops=False)))


def far_away():
    """A structure that hides nothing."""
    return box((100.0, 100.0, 0.0), (101.0, 101.0, 1.0))


def box(low, high):
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    return Structure(vertices_m=corners, faces=np.array(faces), cables=())


def point(**asked):
    return NamedPoint(name="P", position_m=TARGET, normal=(0, -1, 0), **asked)


FACE = FaceTask(
    name="wall",
    origin_m=TARGET - (1.0, 0.0, 1.0),
    along_m=(2, 0, 0),
    up_m=(0, 0, 2),
    normal=(0, -1, 0),
    cell_m=2.0,
    gsd_mm=3.1,
    max_incidence_deg=10.0,
)


@pytest.mark.parametrize(
    ("name", "inspection", "coarsest", "incidence_deg"),
    [
        ("P", {"points": (point(),)}, 0.0033, 20.0),
        ("P", {"points": (point(gsd_mm=3.05),)}, 0.00305, 20.0),
        ("S0001", {"surface": SurfaceTask(gsd_mm=3.2)}, 0.0032, 20.0),
        ("wall-r01-c01", {"faces": (FACE,)}, 0.0031, 10.0),
    ],
)
def test_what_was_asked_of_the_picture_still_holds(make_flyable, name, inspection, coarsest, incidence_deg):
    found = moved_views(of_task(make_flyable, name, **inspection), far_away())
    assert list(found) == [0], "what is passed is not moved"
    places = found[0].places_m
    away = TARGET - places
    lengths = np.linalg.norm(away, axis=1)
    gsd = lengths * SENSOR_MM / FOCAL_MM / PIXELS
    assert 0.97 * coarsest < gsd.max() <= coarsest * (1 + 1e-9)
    incidence = np.degrees(np.arccos(away[:, 1] / lengths))
    assert incidence_deg - 2.0 < incidence.max() <= incidence_deg + 1e-6


def test_the_known_structure_must_not_hide_the_target(make_flyable):
    plan = of_task(make_flyable, "P", points=(point(),))
    west = box((5.0, 5.0, 0.0), (11.5, 5.5, 12.0))
    places = moved_views(plan, west)[0].places_m
    crosses_m = places[:, 0] + (5.0 - places[:, 1]) / (TARGET[1] - places[:, 1]) * (12.0 - places[:, 0])
    assert len(places) and crosses_m.min() > 11.5
    assert len(places) < len(moved_views(plan, far_away())[0].places_m)
