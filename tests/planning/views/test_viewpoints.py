"""Viewpoints for whole scenes, in the real free space, checked by means that the search does not use."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from gcs.core.errors import InfeasibleError, InputError, OperationCancelled
from gcs.core.inspection import Inspection, NamedPoint, Region, SurfaceTask
from gcs.core.progress import SilentProgress
from gcs.core.scenario import Fence
from gcs.core.structure import Structure
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.scene.visibility import SightLines
from gcs.planning.views.camera_footprint import faces_camera, in_image
from gcs.planning.views.coverage import certify_coverage
from gcs.planning.views.surface_samples import sample_surface
from gcs.planning.views.viewpoints import MOST_STAND_OFF_M, find_viewpoints, stand_off_reach

MESH = Path(__file__).resolve().parents[3] / "../shared/meshes/caric_construction_crane_1.stl"
QUIET = SilentProgress()
GSD_MM = 4.0


def asking(scenario, **inspection):
    return scenario.model_copy(update={"inspection": Inspection(**inspection), "fence": None})


@pytest.fixture(scope="module")
def tower_scene(tower_scenario, tower):
    scenario = asking(tower_scenario, surface=SurfaceTask(gsd_mm=GSD_MM, overlap=0.0))
    return prepare_scene(scenario, tower, QUIET)


def find(scenario, structure, scene, progress=QUIET):
    return find_viewpoints(scenario, structure, scene.space, scene.distance, progress).poses


def coverage_of(scenario, structure, scene, poses):
    return certify_coverage(scenario, structure, poses, scene.space.model.fence, scene.distance, QUIET)


def assert_can_be_flown(poses, scenario, scene):
    positions = np.array([p.position_m for p in poses])
    assert (scene.distance.distance(positions) >= scenario.centre_clearance_m).all()
    assert scene.space.is_reachable(positions).all()
    pitch = np.degrees([p.gimbal_pitch_rad for p in poses])
    assert pitch.min() >= scenario.camera.gimbal.pitch_min_deg - 1e-6
    assert pitch.max() <= scenario.camera.gimbal.pitch_max_deg + 1e-6
    for p in poses:
        level = np.array([np.cos(p.yaw_rad), np.sin(p.yaw_rad), np.tan(p.gimbal_pitch_rad)])
        np.testing.assert_allclose(p.direction, level / np.linalg.norm(level), atol=1e-9)
        assert abs(np.cross(p.direction, p.up)[2]) < 1e-9


def test_the_surface_of_a_tower_is_covered(tower_scenario, tower, tower_scene):
    scenario = asking(tower_scenario, surface=SurfaceTask(gsd_mm=GSD_MM, overlap=0.0))
    poses = find(scenario, tower, tower_scene)
    assert_can_be_flown(poses, scenario, tower_scene)
    assert len({p.name for p in poses}) == len(poses)
    assert all(p.gsd_m <= GSD_MM / 1000 for p in poses)
    coverage = coverage_of(scenario, tower, tower_scene, poses)
    assert coverage.share_seen >= 0.98
    # four sides and the top of one skin; at 14.6 m a picture shows 21.9 m x 14.6 m
    assert coverage.share_coverable == pytest.approx(0.5 * (1 - 64 / (2 * 64 + 4 * 192)), abs=0.02)
    assert len(poses) <= 14


def test_overlap_is_planned_as_a_smaller_picture(tower_scenario, tower, tower_scene):
    task = SurfaceTask(gsd_mm=GSD_MM, overlap=0.5)
    scenario = asking(tower_scenario, surface=task)
    poses = find(scenario, tower, tower_scene)
    targets = sample_surface(tower, 3000, np.random.default_rng(99))
    coverable = np.einsum("ij,ij->i", targets.points_m - [0, 0, 12], targets.normals) > 0
    coverable &= targets.normals[:, 2] > -0.5
    sight = SightLines(tower)
    in_core, pictures = np.zeros(len(targets), bool), np.zeros(len(targets), int)
    depth = scenario.camera.distance_for_gsd(GSD_MM / 1000)
    for p in poses:
        ok = faces_camera(p.position_m, targets.points_m, targets.normals, np.radians(60))
        ok[ok] = sight.clear(p.position_m, targets.lifted_m[ok])
        where = (scenario.camera, p.position_m, p.direction, p.up, targets.points_m, depth)
        in_core |= ok & in_image(*where, core=0.5)
        pictures += ok & in_image(*where)
    assert in_core[coverable].mean() > 0.96
    assert np.median(pictures[coverable]) >= 2
    assert len(poses) > 1.5 * len(
        find(asking(tower_scenario, surface=task.model_copy(update={"overlap": 0.0})), tower, tower_scene)
    )


def test_the_cover_is_that_of_the_viewpoints(tower_scenario, tower, tower_scene):
    scenario = asking(tower_scenario, surface=SurfaceTask(gsd_mm=GSD_MM, overlap=0.3))
    found = find_viewpoints(scenario, tower, tower_scene.space, tower_scene.distance, QUIET)
    cover = found.cover
    assert len(cover.chosen) == len(found.poses)
    shown = np.zeros(cover.targets, bool)
    for k in cover.chosen:
        shown[cover.members_of(k)] = True
    assert shown.sum() >= cover.wanted
    assert cover.wanted >= 0.99 * cover.targets
    # 100,000 points on a closed box: one side of each can be seen, but for those of its underside
    assert cover.targets == pytest.approx(1e5 * (1 - 64 / (2 * 64 + 4 * 192)), rel=0.01)


@pytest.mark.parametrize("overlap", [0.0, 0.5])
def test_a_wall_is_tiled_by_as_many_pictures_as_it_takes(tower_scenario, tower, tower_scene, overlap):
    # at 3 mm and with 0.8 m of errors a picture is taken from 10.1 m, where it shows 15.2 m x 10.1 m, of which errors
    # take 0.8 m all round: two rows of 8.5 m. Middles are 7.6 m x 5.1 m: three rows.
    region = Region(min_m=(3.999, -3, 6), max_m=(4.1, 3, 19))
    scenario = asking(tower_scenario, surface=SurfaceTask(gsd_mm=3.0, overlap=overlap, regions=(region,)))
    poses = find(scenario, tower, tower_scene)
    least = {0.0: 2, 0.5: 3}[overlap]
    assert least <= len(poses) <= least + overlap * 2
    assert coverage_of(scenario, tower, tower_scene, poses).share_seen >= 0.995


def test_the_position_error_is_allowed_for(tower_scenario, tower, tower_scene):
    scenario = asking(tower_scenario, surface=SurfaceTask(gsd_mm=GSD_MM, overlap=0.0))
    poses = find(scenario, tower, tower_scene)
    error = scenario.safety.position_m + scenario.safety.tracking_m
    targets = sample_surface(tower, 3000, np.random.default_rng(99))
    coverable = np.einsum("ij,ij->i", targets.points_m - [0, 0, 12], targets.normals) > 0
    coverable &= targets.normals[:, 2] > -0.5
    rng = np.random.default_rng(1)
    sight = SightLines(tower)
    seen = np.zeros(len(targets), bool)
    depth = scenario.camera.distance_for_gsd(GSD_MM / 1000)
    for p in poses:
        off = rng.normal(size=3)
        place = p.position_m + error * off / np.linalg.norm(off)
        ok = faces_camera(place, targets.points_m, targets.normals, np.radians(64))
        ok &= in_image(scenario.camera, place, p.direction, p.up, targets.points_m, depth)
        ok[ok] = sight.clear(place, targets.lifted_m[ok])
        seen |= ok
    assert seen[coverable].mean() >= 0.99


def test_the_same_seed_gives_the_same_viewpoints(tower_scenario, tower, tower_scene):
    region = Region(min_m=(3, -5, 20), max_m=(5, 5, 25))
    scenario = asking(tower_scenario, surface=SurfaceTask(gsd_mm=2.5, regions=(region,)))
    first, second = (find(scenario, tower, tower_scene) for _ in range(2))
    assert [p.name for p in first] == [p.name for p in second]
    assert all(np.array_equal(a.position_m, b.position_m) for a, b in zip(first, second, strict=True))
    other = scenario.model_copy(update={"planner": scenario.planner.model_copy(update={"seed": 5})})
    positions = [np.array([p.position_m for p in find(s, tower, tower_scene)]).sum() for s in (scenario, other)]
    assert positions[0] != positions[1]


def test_a_region_is_looked_at_and_nothing_else(tower_scenario, tower, tower_scene):
    region = Region(min_m=(3, -5, 14), max_m=(5, 5, 20))
    scenario = asking(tower_scenario, surface=SurfaceTask(gsd_mm=GSD_MM, overlap=0.0, regions=(region,)))
    poses = find(scenario, tower, tower_scene)
    assert 1 <= len(poses) <= 4
    coverage = coverage_of(scenario, tower, tower_scene, poses)
    assert coverage.share_seen >= 0.98
    assert (coverage.points_m[:, 0] >= 3).all()


def test_what_the_points_show_is_not_photographed_twice(tower_scenario, tower, tower_scene):
    region = Region(min_m=(3.9, -2, 10), max_m=(4.1, 2, 12))
    surface = SurfaceTask(gsd_mm=GSD_MM, overlap=0.0, regions=(region,))
    point = NamedPoint(name="P", position_m=(4, 0, 11), normal=(1, 0, 0), gsd_mm=GSD_MM)
    poses = find(asking(tower_scenario, surface=surface, points=(point,)), tower, tower_scene)
    assert [p.name for p in poses] == ["P"]


def test_a_gsd_finer_than_the_clearance_allows_says_what_can_be_had(tower_scenario, tower, tower_scene):
    with pytest.raises(InfeasibleError, match=r"inspection\.surface\.gsd_mm: a GSD of 0\.5 mm .* is 0\.\d\d mm"):
        find(asking(tower_scenario, surface=SurfaceTask(gsd_mm=0.5)), tower, tower_scene)


def test_the_sample_crane_is_photographed_from_its_sides_under_the_open_sky():
    from gcs.core.scenario import parse_scenario
    from gcs.storage.mesh_files import load_structure, sample_scenario

    scenario = parse_scenario(sample_scenario("gantry-crane"))
    crane, _ = load_structure(scenario.structure, Path())
    scene = prepare_scene(scenario, crane, QUIET)
    poses = find(scenario, crane, scene)
    assert_can_be_flown(poses, scenario, scene)
    assert [p.name for p in poses] == [p.name for p in crane.named_points]
    assert scene.space.is_open_sky(np.array([p.position_m for p in poses])).all()
    for pose, point in zip(poses, crane.named_points, strict=True):
        towards = np.array(point.position_m) - pose.position_m
        np.testing.assert_allclose(pose.direction, towards / np.linalg.norm(towards), atol=1e-9)
        assert -pose.direction @ np.array(point.normal) > 0.8
        assert pose.gsd_m < 0.0015


def square(x, y, half):
    return tuple((x + a * half, y + b * half) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)))


@pytest.mark.parametrize(
    ("fence", "said"),
    [
        (Fence(include=(square(0, 0, 60),), max_height_m=8.0), "the fence leaves out .*: raise its max_height_m"),
        (Fence(include=(square(-20, -20, 9), square(12, 0, 6))), "the fence cuts off the stand-off places"),
        (Fence(include=(square(-25, 0, 27),)), "the fence leaves out .*: widen it"),
    ],
    ids=["too-low", "in-two", "one-side"],
)
def test_a_fence_that_is_in_the_way_is_named(tower_scenario, tower, fence, said):
    scenario = tower_scenario.model_copy(update={"fence": fence})
    scene = prepare_scene(scenario, tower, QUIET)
    with pytest.raises(InfeasibleError, match=rf"points\.P: {said}"):
        find(scenario, tower, scene)


def test_what_a_surface_was_planned_around_is_not_offered_for_change(tower_scenario, tower, tower_scene):
    region = Region(min_m=(3, -5, 14), max_m=(5, 5, 20))
    points = tower_scenario.inspection.points
    scenarios = [
        asking(tower_scenario, points=points, surface=surface)
        for surface in (
            None,
            SurfaceTask(gsd_mm=GSD_MM, overlap=0.0, regions=(region,)),
        )
    ]
    offered = [find_viewpoints(s, tower, tower_scene.space, tower_scene.distance, QUIET).others for s in scenarios]
    assert list(offered[0]) == [0]
    assert_can_be_flown(offered[0][0], scenarios[0], tower_scene)
    assert offered[1] == {}


def test_nothing_to_inspect_is_said(tower_scenario, tower, tower_scene):
    with pytest.raises(InputError, match="name points or a surface"):
        find(tower_scenario.model_copy(update={"inspection": None}), tower, tower_scene)


def test_how_far_viewpoints_may_stand_off(tower_scenario, tower):
    camera = tower_scenario.camera
    surface = asking(tower_scenario, surface=SurfaceTask(gsd_mm=8.0))
    assert stand_off_reach(surface, tower, 3.0) == pytest.approx(camera.distance_for_gsd(0.008))
    coarse = asking(tower_scenario, surface=SurfaceTask(gsd_mm=80.0))
    assert stand_off_reach(coarse, tower, 3.0) == MOST_STAND_OFF_M
    assert stand_off_reach(tower_scenario, tower, 3.0) >= 3.0


def test_a_viewpoint_that_the_exact_distance_rejects_is_not_let_through(tower_scenario, tower, tower_scene):
    liar = SimpleNamespace(
        clearance_m=1.0, is_free=np.ones_like, is_reachable=lambda p: np.ones(len(p), bool), is_open_sky=None
    )
    liar.is_free = liar.is_open_sky = liar.is_reachable
    with pytest.raises(InfeasibleError, match=r"viewpoint P is 2\.00 m from a surface; 2\.40 m are kept"):
        find_viewpoints(tower_scenario, tower, liar, tower_scene.distance, QUIET)


def test_cancelling_stops_the_search(tower_scenario, tower, tower_scene):
    class Cancelling:
        calls = 0

        def report(self, stage, fraction):
            assert stage == "viewpoints"
            assert 0 <= fraction <= 1
            self.calls += 1
            if self.calls == 3:
                raise OperationCancelled("stop")

    progress = Cancelling()
    with pytest.raises(OperationCancelled):
        find(asking(tower_scenario, surface=SurfaceTask(gsd_mm=GSD_MM)), tower, tower_scene, progress)
    assert progress.calls == 3


@pytest.mark.skipif(not MESH.is_file(), reason="the public mesh is not here")
def test_a_lattice_crane_that_is_not_watertight(tower_scenario):
    mesh = trimesh.load_mesh(MESH, process=False)
    crane = Structure(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64))
    scenario = asking(tower_scenario, surface=SurfaceTask(gsd_mm=8.0, overlap=0.3))
    scenario = scenario.model_copy(update={"ground_m": -1.26, "home_m": (-20, -20, -1.26)})
    scene = prepare_scene(scenario, crane, QUIET)
    poses = find(scenario, crane, scene)
    assert_can_be_flown(poses, scenario, scene)
    assert coverage_of(scenario, crane, scene, poses).share_seen >= 0.995
    assert len(poses) < 165
