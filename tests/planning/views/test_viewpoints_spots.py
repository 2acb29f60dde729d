"""Spots of a surface: those that could be seen get a viewpoint when the surface's pictures leave them out."""

import numpy as np
import pytest

from gcs.core.inspection import Inspection, Spot, SurfaceTask
from gcs.core.progress import SilentProgress
from gcs.core.surface_coverage import Verdict
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.scene.visibility import SightLines
from gcs.planning.views.viewpoints_spots import count_spots, find_spot_viewpoints, judge_spots

QUIET = SilentProgress()
EAST = Spot(name="east", position_m=(4.0, 0.0, 12.0), normal=(1.0, 0.0, 0.0))
BESIDE = Spot(name="beside", position_m=(4.0, 0.4, 12.3), normal=(1.0, 0.0, 0.0))
WEST = Spot(name="west", position_m=(-4.0, 1.0, 9.0), normal=(-1.0, 0.0, 0.0))
INSIDE = Spot(name="inside", position_m=(4.0, 0.0, 12.0), normal=(-1.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def asked(tower_scenario):
    def asked(*spots):
        task = SurfaceTask(gsd_mm=4.0, overlap=0.0, spots=spots)
        return task, tower_scenario.model_copy(update={"inspection": Inspection(surface=task)})

    return asked


@pytest.fixture(scope="module")
def scene(asked, tower):
    return prepare_scene(asked(EAST)[1], tower, QUIET)


@pytest.fixture(scope="module")
def found(asked, tower, scene):
    def found(*spots):
        task, scenario = asked(*spots)
        reach = scenario.camera.distance_for_gsd(0.004)
        nearest = scene.space.clearance_m + 0.01
        added = find_spot_viewpoints(
            scenario, tower, task, [], scene.space, scene.distance, SightLines(tower), nearest, reach, QUIET
        )
        return added, judge_spots(scenario, tower, task, added, scene.space.model.fence, scene.distance, QUIET)

    return found


def test_every_spot_that_can_be_seen_is_seen(found, asked, scene, tower):
    added, verdicts = found(EAST, WEST, INSIDE)
    assert verdicts.tolist() == [Verdict.SEEN, Verdict.SEEN, Verdict.OCCLUDED]
    assert [pose.name for pose in added] == ["east", "west"]
    scenario = asked(EAST)[1]
    for pose, spot in zip(added, (EAST, WEST), strict=True):
        sight = np.asarray(spot.position_m) - pose.position_m
        length = np.linalg.norm(sight)
        assert 1000 * scenario.camera.gsd_at(length) <= 4.0
        assert -sight @ spot.normal / length >= np.cos(np.radians(60.0))
        assert pose.direction @ sight == pytest.approx(length, rel=1e-3)
        assert scene.space.is_reachable(pose.position_m[None])[0]


def test_one_picture_is_enough_for_two_spots_side_by_side(found):
    added, verdicts = found(EAST, BESIDE)
    assert len(added) == 1
    assert (verdicts == Verdict.SEEN).all()


def test_nothing_is_added_for_spots_that_nobody_can_see(found, asked, scene, tower):
    added, _ = found(INSIDE)
    assert added == []
    fence = scene.space.model.fence
    assert count_spots(asked(INSIDE)[1], tower, added, fence, scene.distance, QUIET) == {"occluded": 1}


def test_spots_that_are_seen_already_get_no_viewpoint(found, asked, scene, tower):
    added, _ = found(EAST, WEST)
    task, scenario = asked(EAST, WEST)
    sight, reach = SightLines(tower), scenario.camera.distance_for_gsd(0.004)
    again = find_spot_viewpoints(scenario, tower, task, added, scene.space, scene.distance, sight, 2.0, reach, QUIET)
    assert again == []
