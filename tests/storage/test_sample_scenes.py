"""The sample gantry crane is what its data file says, and its points can be flown to."""

from importlib import resources

import numpy as np
import pytest
import yaml

from gcs.core.scenario import parse_scenario
from gcs.planning.point_distance import SceneDistance, TriangleDistance
from gcs.storage.mesh_files import sample_scenario
from gcs.storage.sample_scenes import gantry_crane


@pytest.fixture(scope="module")
def dimensions():
    return yaml.safe_load(resources.files("gcs.storage").joinpath("samples", "gantry-crane.yaml").read_text())


@pytest.fixture(scope="module")
def crane(dimensions):
    return gantry_crane(dimensions)


def test_size_stays_modest_and_it_stands_on_the_ground(crane):
    assert 3000 < len(crane.faces) < 10000
    low, high = crane.bounds_m
    assert low[2] == pytest.approx(0)
    assert 45 < high[2] < 70


def test_nine_points_a_side_and_the_right_mirrors_the_left(crane):
    points = {p.name: p for p in crane.named_points}
    assert sorted(points) == sorted([f"{s}{n}" for s in "LR" for n in range(1, 10)])
    for n in range(1, 10):
        left, right = points[f"L{n}"], points[f"R{n}"]
        assert left.normal == (0, 1, 0)
        assert right.normal == (0, -1, 0)
        np.testing.assert_allclose(np.array(left.position_m) * [1, -1, 1], right.position_m)


def test_points_lie_on_the_outer_surface_of_their_side(crane):
    distance = SceneDistance(crane, None)
    at = np.array([p.position_m for p in crane.named_points])
    normal = np.array([p.normal for p in crane.named_points])
    np.testing.assert_allclose(distance.distance(at), 0, atol=1e-9)
    np.testing.assert_allclose(distance.distance(at + 0.15 * normal), 0.15)


def test_the_pull_rods_have_their_lengths_and_end_at_the_structure(crane, dimensions):
    lengths = [np.linalg.norm(np.subtract(c.from_m, c.to_m)) for c in crane.cables]
    wanted = [dimensions["large_pull_rod"]["length"], dimensions["small_pull_rod"]["length"]] * 2
    np.testing.assert_allclose(lengths, wanted)
    ends = crane.cable_ends_m.reshape(-1, 3)
    assert (TriangleDistance(crane.triangles_m).distance(ends) < dimensions["pin"]["radius"] + 1e-6).all()


def test_the_boom_is_raised_by_the_angle_of_the_data_file(dimensions):
    lower = gantry_crane({**dimensions, "boom": {**dimensions["boom"], "angle_deg": 70.0}})
    upper = gantry_crane(dimensions)
    ends = [{p.name: p for p in s.named_points}["L8"].position_m for s in (lower, upper)]
    hinge, length = np.array(dimensions["boom"]["hinge"]), dimensions["boom"]["length"]
    for (x, _, z), angle in zip(ends, (70.0, dimensions["boom"]["angle_deg"]), strict=True):
        raised = length * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        np.testing.assert_allclose(np.array([x, z]), hinge + raised)


def test_the_column_over_home_is_clear(crane):
    scenario = parse_scenario(sample_scenario("gantry-crane"))
    column = np.asarray(scenario.home_m) + np.linspace(0, 80, 200)[:, None] * [0, 0, 1]
    assert (SceneDistance(crane, 0.0).distance(column, ground=False) > 4.0).all()


def test_the_data_file_says_where_its_numbers_come_from(dimensions):
    assert "Our own typical dimensions" in dimensions["source"]
