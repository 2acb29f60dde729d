"""A small flight round a tower, shared by the tests of what is proved about trajectories."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from gcs.core.plan import Viewpoint
from gcs.core.progress import SilentProgress
from gcs.core.scenario import parse_scenario
from gcs.core.structure import Structure


@pytest.fixture(scope="session")
def tower_scenario():
    return parse_scenario(
        {
            "structure": {"meshes": [{"file": "tower.stl"}]},
            "anchor": {"latitude_deg": 31.0, "longitude_deg": 121.0, "altitude_m": 4.0},
            "ground_m": 0.0,
            "camera": {
                "sensor_width_mm": 13.2,
                "sensor_height_mm": 8.8,
                "focal_length_mm": 8.8,
                "image_width_px": 5472,
                "image_height_px": 3648,
            },
            "inspection": {"points": [{"name": "P", "position_m": [4, 0, 12], "normal": [1, 0, 0]}]},
            "vehicle": {"max_jerk_m_s3": 12.0},
            "fence": {"include": [[[-40, -40], [40, -40], [40, 40], [-40, 40]]], "max_height_m": 60},
            "home_m": [-20, -20, 0],
        }
    )


@pytest.fixture(scope="session")
def tower():
    """A box of 8 x 8 x 24 m about the z axis."""
    box = trimesh.creation.box(extents=(8, 8, 24))
    return Structure(np.asarray(box.vertices) + np.array([0, 0, 12]), np.asarray(box.faces, dtype=np.int64))


@pytest.fixture(scope="session")
def tower_distance(tower):
    from gcs.planning.scene.point_distance import SceneDistance

    return SceneDistance(tower, 0.0)


@pytest.fixture(scope="session")
def tower_flight(tower_scenario):
    """Home, the four sides of the tower, home: everything that certificates are about."""
    from gcs.planning.trajectories.trajectory_builder import build_trajectory
    from gcs.planning.views.viewpoint_pose import camera_axes

    home = np.array(tower_scenario.home_m)
    stops = np.array([[-10.0, 0, 10], [0, -10, 14], [10, 0, 12], [0, 10, 18]])
    corners = np.array([[-10.0, -10, 12], [10, -10, 13], [10, 10, 15]])
    over_home = home + np.array([0, 0, 8])
    legs = [np.array([home, over_home, stops[0]])]
    legs += [np.array([a, c, b]) for a, c, b in zip(stops[:-1], corners, stops[1:], strict=True)]
    legs += [np.array([stops[3], [-12, 10, 16], over_home, home])]
    yaw = np.arctan2(-stops[:, 1], -stops[:, 0])
    pitch = np.radians([-10.0, 0, -30, 5])
    built = build_trajectory(legs, yaw, pitch, tower_scenario, SilentProgress())
    view, up = camera_axes(yaw, pitch)
    viewpoints = [
        Viewpoint(i, f"V{i}", stops[i], view[i], up[i], 0.002, built.exposures_s[i], yaw[i], pitch[i]) for i in range(4)
    ]
    path = np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])
    return SimpleNamespace(
        built=built, viewpoints=viewpoints, path_m=path, path_stops=np.array([0, 2, 4, 6, 8, 11]), legs=legs
    )
