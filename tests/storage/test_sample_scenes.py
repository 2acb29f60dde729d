"""The sample scenes are what their data files say, are sound solids, and their scenarios can be used."""

from importlib import resources
from itertools import pairwise

import numpy as np
import pytest
import trimesh
import yaml
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from gcs.core.scenario import parse_scenario
from gcs.core.structure_source import StructureSource
from gcs.planning.scene.point_distance import SceneDistance, TriangleDistance
from gcs.planning.views.surface_samples import sample_surface
from gcs.storage.mesh_files import AVAILABLE_SAMPLES, load_structure, sample_inspection, sample_scenario
from gcs.storage.sample_bridge_tower import bridge_tower
from gcs.storage.sample_container_yard import container_yard, rail_axes_m, rail_top_m
from gcs.storage.sample_gantry_crane import gantry_crane
from gcs.storage.scenario_files import read_scenario_file

SAMPLES_FOLDER = resources.files("gcs.storage").joinpath("samples")
SCENARIO_FILES = sorted(f.name for f in SAMPLES_FOLDER.iterdir() if f.name.endswith(".scenario.yaml"))


def data_of(name):
    return yaml.safe_load(SAMPLES_FOLDER.joinpath(f"{name}.yaml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def structures(tmp_path_factory):
    base = tmp_path_factory.mktemp("samples")
    return {name: load_structure(StructureSource(sample=name), base)[0] for name in AVAILABLE_SAMPLES}


@pytest.fixture(scope="module")
def dimensions():
    return data_of("gantry-crane")


@pytest.fixture(scope="module")
def crane(structures):
    return structures["gantry-crane"]


@pytest.fixture(scope="module")
def yard(structures):
    return structures["container-yard"]


@pytest.fixture(scope="module")
def tower(structures):
    return structures["bridge-tower"]


def mesh_of(structure):
    return trimesh.Trimesh(structure.vertices_m, structure.faces, process=False)


def parts_of(structure):
    """Number of the connected part that each face belongs to, and how many parts there are."""
    f, n = structure.faces, len(structure.vertices_m)
    ends = (np.concatenate([f[:, 0], f[:, 1]]), np.concatenate([f[:, 1], f[:, 2]]))
    count, label = connected_components(coo_matrix((np.ones(2 * len(f)), ends), (n, n)), directed=False)
    return label[f[:, 0]], count


def boxes_of(structure):
    """Lowest and highest corner of each connected part, shape (P, 2, 3)."""
    part, count = parts_of(structure)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    for corner in range(3):
        np.minimum.at(low, part, structure.triangles_m[:, corner])
        np.maximum.at(high, part, structure.triangles_m[:, corner])
    return np.stack([low, high], axis=1)


@pytest.mark.parametrize("name", AVAILABLE_SAMPLES)
class TestEverySample:
    def test_every_part_is_closed_and_faces_outwards(self, structures, name):
        structure = structures[name]
        edges = structure.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        there, back = (np.unique(e, axis=0, return_counts=True) for e in (edges, edges[:, ::-1]))
        np.testing.assert_array_equal(there[0], back[0])
        np.testing.assert_array_equal(there[1], back[1])
        t = structure.triangles_m
        volume = np.einsum("ij,ij->i", t[:, 0], np.cross(t[:, 1], t[:, 2])) / 6
        part, count = parts_of(structure)
        assert (np.bincount(part, volume, count) > 1e-3).all()

    def test_from_outside_only_front_faces_are_seen(self, structures, name):
        mesh = mesh_of(structures[name])
        rng = np.random.default_rng(3)
        target = mesh.sample(3000, seed=3)
        direction = rng.normal(size=target.shape)
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        face, ray = mesh.ray.intersects_id(target - 1000 * direction, direction, multiple_hits=False)
        assert len(ray) > 2900
        assert (np.einsum("ij,ij->i", mesh.face_normals[face], direction[ray]) < 1e-3).mean() > 0.999

    def test_no_triangle_is_degenerate_or_there_twice(self, structures, name):
        t, faces = structures[name].triangles_m, structures[name].faces
        longest = np.linalg.norm(t - np.roll(t, 1, axis=1), axis=2).max(axis=1)
        double_area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
        assert (double_area / longest).min() > 1e-3
        assert len(np.unique(np.sort(faces, axis=1), axis=0)) == len(faces)
        assert len(faces) < 50_000

    def test_it_stands_on_the_ground(self, structures, name):
        assert structures[name].bounds_m[0, 2] == pytest.approx(parse_scenario(sample_scenario(name)).ground_m)

    def test_the_data_file_says_where_its_numbers_come_from(self, structures, name):
        assert "own typical" in " ".join(data_of(name)["source"].split())

    def test_without_an_inspection_its_own_is_taken(self, structures, name):
        inspection = sample_inspection(name, structures[name])
        scenario = parse_scenario(sample_scenario(name))
        assert inspection == scenario.inspection or inspection.points == structures[name].named_points != ()


@pytest.mark.parametrize("file", SCENARIO_FILES)
def test_the_column_over_home_is_clear(structures, file):
    scenario = parse_scenario(yaml.safe_load(SAMPLES_FOLDER.joinpath(file).read_text(encoding="utf-8")))
    structure = structures[scenario.structure.sample]
    column = np.asarray(scenario.home_m) + np.linspace(0, 120, 300)[:, None] * [0, 0, 1]
    distance = SceneDistance(structure, scenario.ground_m).distance(column, ground=False)
    assert (distance > scenario.centre_clearance_m + 1.5).all()


def test_every_sample_has_a_scenario_and_all_of_them_are_read_as_files():
    assert {f"{name}.scenario.yaml" for name in AVAILABLE_SAMPLES} < set(SCENARIO_FILES)
    for file in SCENARIO_FILES:
        with resources.as_file(SAMPLES_FOLDER.joinpath(file)) as path:
            assert read_scenario_file(path).structure.sample == file.split(".")[0].removesuffix("-faces")


class TestGantryCrane:
    def test_size_stays_modest(self, crane):
        assert 3000 < len(crane.faces) < 10000
        assert 45 < crane.bounds_m[1, 2] < 70

    def test_nine_points_a_side_and_the_right_mirrors_the_left(self, crane):
        points = {p.name: p for p in crane.named_points}
        assert sorted(points) == sorted([f"{s}{n}" for s in "LR" for n in range(1, 10)])
        for n in range(1, 10):
            left, right = points[f"L{n}"], points[f"R{n}"]
            assert left.normal == (0, 1, 0)
            assert right.normal == (0, -1, 0)
            np.testing.assert_allclose(np.array(left.position_m) * [1, -1, 1], right.position_m)

    def test_points_lie_on_the_outer_surface_of_their_side(self, crane):
        distance = SceneDistance(crane, None)
        at = np.array([p.position_m for p in crane.named_points])
        normal = np.array([p.normal for p in crane.named_points])
        np.testing.assert_allclose(distance.distance(at), 0, atol=1e-9)
        np.testing.assert_allclose(distance.distance(at + 0.15 * normal), 0.15)

    def test_the_pull_rods_have_their_lengths_and_end_at_the_structure(self, crane, dimensions):
        lengths = [np.linalg.norm(np.subtract(c.from_m, c.to_m)) for c in crane.cables]
        wanted = [dimensions["large_pull_rod"]["length"], dimensions["small_pull_rod"]["length"]] * 2
        np.testing.assert_allclose(lengths, wanted)
        ends = crane.cable_ends_m.reshape(-1, 3)
        assert (TriangleDistance(crane.triangles_m).distance(ends) < dimensions["pin"]["radius"] + 1e-6).all()

    def test_the_boom_is_raised_by_the_angle_of_the_data_file(self, dimensions):
        lower = gantry_crane({**dimensions, "boom": {**dimensions["boom"], "angle_deg": 70.0}})
        upper = gantry_crane(dimensions)
        ends = [{p.name: p for p in s.named_points}["L8"].position_m for s in (lower, upper)]
        hinge, length = np.array(dimensions["boom"]["hinge"]), dimensions["boom"]["length"]
        for (x, _, z), angle in zip(ends, (70.0, dimensions["boom"]["angle_deg"]), strict=True):
            raised = length * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
            np.testing.assert_allclose(np.array([x, z]), hinge + raised)


class TestContainerYard:
    def test_all_of_it_is_watertight(self, yard):
        assert mesh_of(yard).is_watertight
        assert mesh_of(yard).is_winding_consistent

    def test_the_rails_have_the_section_of_the_standard_and_the_length_of_the_data_file(self, yard):
        data = data_of("container-yard")
        boxes = boxes_of(yard)
        size = np.ptp(boxes, axis=1)
        part, count = parts_of(yard)
        t = yard.triangles_m
        volume = np.bincount(part, np.einsum("ij,ij->i", t[:, 0], np.cross(t[:, 1], t[:, 2])) / 6, count)
        rails = np.flatnonzero(np.isclose(size, [data["track"]["length"], 0.150, 0.150]).all(axis=1))
        assert sorted(boxes[rails].mean(axis=1)[:, 1].round(6)) == [-38, -8, 8, 38]
        np.testing.assert_allclose(volume[rails] / data["track"]["length"], 113.32e-4, rtol=0.02)
        half_width = np.array(data["rail"]["profile"])[:, 0]
        assert 2 * half_width[0] == pytest.approx(0.150)
        assert 2 * half_width.min() == pytest.approx(0.038)
        assert 2 * half_width[7] == pytest.approx(0.108)

    def test_rails_stand_in_plates_and_plates_in_beams(self, yard):
        data = data_of("container-yard")
        boxes = boxes_of(yard)
        length, thickness = data["track"]["plate"]["length"], data["track"]["plate"]["thickness"]
        plates = boxes[np.isclose(np.ptp(boxes, axis=1)[:, 1:], [length, thickness]).all(axis=1)]
        assert len(plates) == 4 * int(data["track"]["length"] / data["track"]["plate"]["spacing"])
        foot = rail_top_m(data) - 0.150
        assert (plates[:, 0, 2] < data["track"]["beam"]["height"] - 0.004).all()
        assert (plates[:, 1, 2] > foot + 0.004).all()

    def test_stacks_are_of_iso_containers_and_do_not_touch_each_other(self, yard):
        data = data_of("container-yard")
        c = data["containers"]
        boxes = boxes_of(yard)
        size = np.ptp(boxes, axis=1)
        stacks, size = boxes[np.isclose(size[:, 1], 2.438)], size[np.isclose(size[:, 1], 2.438)]
        assert set(size[:, 0].round(3)) == {12.192, 6.058}
        assert set((size[:, 2] / 2.591).round(6)) == {1, 2, 3, 4}
        slots = 2 * 2 * 14 * c["rows"]
        assert 0.75 * slots < len(stacks) < 1.3 * slots
        low, high = stacks[:, 0, :2], stacks[:, 1, :2]
        gap = np.maximum(low[:, None] - high[None], low[None] - high[:, None]).max(axis=2)
        np.fill_diagonal(gap, np.inf)
        assert gap.min() == pytest.approx(12.192 - 2 * 6.058)
        for y in rail_axes_m(data):
            assert np.maximum(low[:, 1] - y, y - high[:, 1]).min() > 2.0

    def test_four_masts_stand_in_the_middle_of_the_lane(self, yard):
        masts = [b for b in boxes_of(yard) if b[1, 2] == pytest.approx(30.0) and b[0, 2] < 1]
        assert len(masts) == 4
        np.testing.assert_allclose([b.mean(axis=0)[1] for b in masts], 0, atol=1e-9)

    def test_containers_follow_from_the_seed(self):
        data = data_of("container-yard")
        again = container_yard(data)
        np.testing.assert_array_equal(again.vertices_m, container_yard(data).vertices_m)
        other = container_yard({**data, "containers": {**data["containers"], "seed": 8}})
        assert len(other.faces) != len(again.faces)

    def test_more_blocks_make_a_wider_yard(self):
        data = data_of("container-yard")
        wide = {**data, "blocks": {**data["blocks"], "count": 3}}
        np.testing.assert_allclose(rail_axes_m(wide), [-61, -31, -15, 15, 31, 61])

    def test_the_scenario_asks_for_the_running_surfaces_of_all_rails(self, yard):
        data = data_of("container-yard")
        task = parse_scenario(sample_scenario("container-yard")).inspection.surface
        samples = sample_surface(yard, 4000, np.random.default_rng(1), task.regions)
        top = rail_top_m(data)
        assert (np.abs(samples.points_m[:, 2] - top) < 0.006).all()
        assert (np.abs(samples.normals[:, 2]) > 0.8).all()
        rail = np.abs(samples.points_m[:, 1, None] - rail_axes_m(data)).argmin(axis=1)
        np.testing.assert_allclose(np.bincount(rail) / len(samples), 0.25, atol=0.03)
        assert samples.points_m[:, 0].min() < 3
        assert samples.points_m[:, 0].max() > data["track"]["length"] - 3

    def test_a_tour_along_the_rails_is_about_as_long_as_the_papers(self):
        data = data_of("container-yard")
        scenario = parse_scenario(sample_scenario("container-yard"))
        way = [np.asarray(scenario.home_m)]
        over = rail_top_m(data) + scenario.camera.distance_for_gsd(scenario.inspection.surface.gsd_mm / 1000)
        for k, region in enumerate(sorted(scenario.inspection.surface.regions, key=lambda r: r.min_m[1])):
            ends = [np.array([x, (region.min_m[1] + region.max_m[1]) / 2, over]) for x in (region.min_m[0], 398)]
            way += ends if k % 2 == 0 else ends[::-1]
        length = sum(np.linalg.norm(b - a) for a, b in pairwise([*way, way[0]]))
        assert length == pytest.approx(1834.897, rel=0.05)


class TestBridgeTower:
    def test_all_of_it_is_watertight(self, tower):
        assert mesh_of(tower).is_watertight
        assert mesh_of(tower).is_winding_consistent

    def test_tower_column_and_deck_have_the_papers_dimensions(self, tower):
        assert tower.bounds_m[1, 2] == 88
        columns = mesh_of(tower).section([0, 0, 1], [0, 0, 70]).vertices
        for side in (columns[:, 0] > 0, columns[:, 0] < 0):
            np.testing.assert_allclose(np.ptp(columns[side], axis=0), [4, 3, 0], atol=1e-9)
        deck = mesh_of(tower).section([0, 1, 0], [0, 50, 0]).vertices
        assert np.ptp(deck[:, 0]) == pytest.approx(25)

    def test_the_stays_are_the_same_on_both_sides_of_both_columns(self, tower):
        assert len(tower.cables) == 2 * 2 * 12
        ends = np.sort(tower.cable_ends_m.reshape(-1, 6).round(9), axis=0)
        for mirror in ([-1, 1, 1], [1, -1, 1]):
            np.testing.assert_allclose(np.sort((tower.cable_ends_m * mirror).reshape(-1, 6), axis=0), ends, atol=1e-9)
        quarter = tower.cable_ends_m[(tower.cable_ends_m[:, 0] > 0).all(axis=1)][:, :, 1:]
        assert len(quarter) == 12
        slope = (quarter[:, 0, 1] - quarter[:, 1, 1]) / (quarter[:, 1, 0] - quarter[:, 0, 0])
        assert (np.diff(slope[np.argsort(quarter[:, 0, 1])]) < 0).all()

    def test_the_stays_end_in_concrete_and_touch_nothing_between(self, tower):
        ends = tower.cable_ends_m
        assert mesh_of(tower).contains(ends.reshape(-1, 3)).all()
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        share = np.linspace(0, 1, 400)
        points = ends[:, None, 0] + share[None, :, None] * (ends[:, 1] - ends[:, 0])[:, None]
        along = share[None] * length[:, None]
        between = points[(along > 3) & (along < length[:, None] - 1.5)]
        assert TriangleDistance(tower.triangles_m).distance(between).min() > 0.3
        for k, path in enumerate(points):
            others = np.delete(points, k, axis=0).reshape(-1, 3)
            assert np.linalg.norm(path[::20, None] - others[None], axis=2).min() > 1.0

    def test_another_number_of_stays(self):
        data = data_of("bridge-tower")
        assert len(bridge_tower({**data, "stays": {**data["stays"], "number": 5}}).cables) == 20

    def test_the_faces_of_the_data_file_are_the_columns_and_look_outwards(self, tower):
        mesh = mesh_of(tower)
        corners = {tuple(v) for v in tower.vertices_m}
        for face in data_of("bridge-tower")["faces"]:
            origin, along, up, normal = (np.array(face[k], float) for k in ("origin_m", "along_m", "up_m", "normal"))
            assert {tuple(origin + a * along + u * up) for a in (0, 1) for u in (0, 1)} <= corners
            np.testing.assert_allclose(np.cross(along, up) / 352, normal)
            middle = origin + along / 2 + up / 2
            np.testing.assert_array_equal(mesh.contains([middle + 0.1 * normal, middle - 0.1 * normal]), [False, True])

    def test_the_faces_scenario_inspects_one_of_them_on_the_papers_grid(self):
        text = SAMPLES_FOLDER.joinpath("bridge-tower-faces.scenario.yaml").read_text(encoding="utf-8")
        (face,) = yaml.safe_load(text)["inspection"]["faces"]
        assert face in data_of("bridge-tower")["faces"]
        (task,) = parse_scenario(yaml.safe_load(text)).inspection.faces
        assert (task.columns, task.rows) == (4, 88)
