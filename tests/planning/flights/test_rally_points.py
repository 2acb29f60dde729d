"""Rally points: what makes one unusable is named."""

import numpy as np
import pytest
import trimesh

from gcs.core.errors import InputError
from gcs.core.progress import SilentProgress
from gcs.core.scenario import Fence
from gcs.core.structure import Structure
from gcs.core.trajectory import PiecewisePolynomial
from gcs.core.way_home import ReturnFlight
from gcs.planning.flights.rally_points import check_rally_points
from gcs.planning.flights.ways_home import trace_ways_home
from gcs.planning.scene.point_distance import SceneDistance

KEEP_M = 2.4


@pytest.fixture(scope="module")
def scene(box_structure):
    # A wall, and a roof on nothing beside it.
    return box_structure(((-2, -20, 0), (2, 20, 25)), ((20, -5, 15), (30, 5, 16)))


@pytest.fixture(scope="module")
def box_structure():
    def make(*parts):
        meshes = []
        for low, high in parts:
            box = trimesh.creation.box(extents=np.subtract(high, low))
            meshes.append(trimesh.Trimesh(box.vertices + np.add(low, high) / 2, box.faces, process=False))
        mesh = trimesh.util.concatenate(meshes)
        return SceneDistance(Structure(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64)), 0.0)

    return make


def with_rally(tower_scenario, *points, fence=None):
    return tower_scenario.model_copy(update={"rally_m": points, "ground_m": 0.0, "fence": fence})


def test_a_place_in_the_open_is_fine(tower_scenario, scene):
    check_rally_points(with_rally(tower_scenario, (10.0, 0.0, 0.0), (-30.0, 5.0, 0.05)), scene)


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ((10.0, 0.0, 3.0), "+3.00 m off the ground"),
        ((10.0, 0.0, -0.5), "-0.50 m off the ground"),
        ((4.0, 0.0, 0.0), "is 2.00 m from the structure"),
        ((25.0, 0.0, 0.0), "something is above it"),
        ((40.0, 0.0, 0.0), "outside the fence"),
        ((34.5, 0.0, 0.0), "nearer to its edge"),
    ],
)
def test_a_place_that_cannot_be_used_is_named(tower_scenario, scene, place, said):
    fence = Fence(include=(((-35, -30), (35, -30), (35, 30), (-35, 30)),))
    scenario = with_rally(tower_scenario, (10.0, 10.0, 0.0), place, fence=fence)
    with pytest.raises(InputError) as error:
        check_rally_points(scenario, scene)
    assert error.value.field == "rally_m.1"
    assert said in error.value.message


def test_a_rally_point_on_this_side_of_a_wall_clears_a_low_return(line, scene):
    home = np.array([-30.0, 0.0, 0.0])
    curve = line([12.0, -10, 10], [12, 10, 10])

    def found(*rally):
        return trace_ways_home(curve, scene, home, ReturnFlight(15.0), 0.9, SilentProgress(), rally_m=rally)

    assert not found().ok
    assert found((14.0, 0.0, 0.0)).ok
    assert not found((-60.0, 0.0, 0.0)).ok, "home is nearer"
    assert not found((25.0, 0.0, 0.0)).ok, "under the roof"


@pytest.fixture
def line():
    def make(a, b, speed=2.0):
        a, b = np.array(a, float), np.array(b, float)
        coefficients = np.zeros((1, 8, 3))
        coefficients[0, 0], coefficients[0, 1] = a, b - a
        return PiecewisePolynomial(coefficients, np.array([np.linalg.norm(b - a) / speed]))

    return make
