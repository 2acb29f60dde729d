"""Fixtures for several rooms: a small plan whose figures are known by hand."""

from __future__ import annotations

import fcntl
import os
import sys

import numpy as np
import pytest

from gcs.core.plan import Certificates, Plan, Viewpoint
from gcs.core.scenario import parse_scenario
from gcs.core.structure import Structure
from gcs.core.structure_source import Cable
from gcs.core.surface_coverage import SurfaceCoverage
from gcs.core.trajectory import AngleProfile, PiecewisePolynomial

REST_TO_REST = np.array([0, 0, 0, 0, 35, -84, 70, -20], dtype=float)
"""Minimum snap from 0 to 1 with velocity, acceleration and jerk zero at both ends."""

STOPS = np.array([[0, 0, 0], [0, 0, 10], [8, 0, 10], [0, 0, 10], [0, 0, 0]], dtype=float)
DURATIONS = np.array([6.0, 5.0, 5.0, 6.013])


@pytest.fixture(scope="session")
def of_all_workers(tmp_path_factory):
    """A folder that the test processes of one run share."""
    own = tmp_path_factory.getbasetemp()
    shared = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "of-all-workers"
    shared.mkdir(exist_ok=True)
    return shared


@pytest.fixture(scope="session")
def made_once(of_all_workers):
    """`made_once(name, make)`: a folder that the first test process fills by `make(folder)`; to be read only."""

    def made(name, make):
        folder, done = of_all_workers / name, of_all_workers / f"{name}.done"
        with (of_all_workers / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not done.exists():
                make(folder)
                done.touch()
        return folder

    return made


@pytest.fixture(scope="session", autouse=True)
def compiled_once(of_all_workers):
    """Of the many processes only the first compiles a module, also where bytecode is not to be written."""
    with pytest.MonkeyPatch.context() as patch:
        if sys.dont_write_bytecode:
            patch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
            patch.setenv("PYTHONPYCACHEPREFIX", str(of_all_workers / "bytecode"))
        yield


@pytest.fixture
def scenario_data():
    return {
        "name": "box <1>",
        "structure": {"meshes": [{"file": "box.stl"}]},
        "anchor": {"latitude_deg": 31.3622, "longitude_deg": 121.6155, "altitude_m": 4.0},
        "ground_m": 0.0,
        "camera": {
            "sensor_width_mm": 13.2,
            "sensor_height_mm": 8.8,
            "focal_length_mm": 8.8,
            "image_width_px": 5472,
            "image_height_px": 3648,
        },
        "inspection": {"points": [{"name": "A, west", "position_m": [12, 0, 10], "normal": [-1, 0, 0]}]},
        "home_m": [0, 0, 0],
    }


@pytest.fixture(scope="session")
def box_scenario():
    """A box of 4 m x 4 m x 10 m on the ground, planned in about a second; `box.stl` beside it is the mesh."""
    return {
        "name": "box",
        "structure": {"meshes": [{"file": "box.stl"}]},
        "anchor": {"latitude_deg": 31.3622, "longitude_deg": 121.6155, "altitude_m": 4.0},
        "ground_m": 0.0,
        "camera": {
            "sensor_width_mm": 13.2,
            "sensor_height_mm": 8.8,
            "focal_length_mm": 8.8,
            "image_width_px": 5472,
            "image_height_px": 3648,
        },
        "inspection": {
            "surface": {"gsd_mm": 3.0, "overlap": 0.0},
            "points": [{"name": "W", "position_m": [-2.0, 0.0, 6.0], "normal": [-1.0, 0.0, 0.0]}],
        },
        "vehicle": {"battery": {"capacity_wh": 130.0, "reserve": 0.25}},
        "home_m": [-12.0, -12.0, 0.0],
    }


@pytest.fixture(scope="session")
def box_folder(tmp_path_factory, box_scenario):
    """A folder with `box.stl` and the scenario `box.yaml`; to be read only."""
    import trimesh
    import yaml

    folder = tmp_path_factory.mktemp("box")
    box = trimesh.creation.box(extents=(4, 4, 10))
    box.apply_translation([0, 0, 5])
    box.export(folder / "box.stl")
    (folder / "box.yaml").write_text(yaml.safe_dump(box_scenario))
    return folder


@pytest.fixture(scope="session")
def box_plan(made_once, box_folder):
    """The box, planned by the product; to be read only."""
    from gcs.services.plan_service import plan_to_directory

    return made_once("box-plan", lambda out: plan_to_directory(box_folder / "box.yaml", out))


@pytest.fixture
def small_structure():
    """A box from (12, -2, 0) to (16, 2, 20), and a stay."""
    corners = np.array([[x, y, z] for x in (12, 16) for y in (-2, 2) for z in (0, 20)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (1, 5, 7, 3), (0, 2, 6, 4)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    cable = Cable(from_m=(16, 0, 20), to_m=(30, 0, 0), radius_m=0.05)
    return Structure(vertices_m=corners, faces=faces, cables=(cable,), notes=("12 triangles",))


@pytest.fixture
def small_plan(scenario_data, small_structure):
    """Up, east, back and down, each leg from rest to rest; one picture at (8, 0, 10)."""
    start, step = STOPS[:-1], np.diff(STOPS, axis=0)
    coefficients = REST_TO_REST[None, :, None] * step[:, None, :]
    coefficients[:, 0] += start
    trajectory = PiecewisePolynomial(coefficients, DURATIONS)
    low = np.minimum(STOPS[:-1], STOPS[1:]) - 0.5
    high = np.maximum(STOPS[:-1], STOPS[1:]) + 0.5
    viewpoint = Viewpoint(
        id=0,
        name="A, west",
        position_m=np.array([8.0, 0, 10]),
        direction=np.array([1.0, 0, 0]),
        up=np.array([0.0, 0, 1]),
        gsd_m=0.0011,
        time_s=11.0,
        yaw_rad=0.0,
        gimbal_pitch_rad=0.0,
    )
    certificates = Certificates(
        length_m=36.0,
        path_length_m=36.0,
        duration_s=trajectory.duration_s,
        mean_deviation_m=0.0,
        max_deviation_m=0.0,
        min_clearance_m=3.5,
        max_speed_m_s=3.65,
        max_acceleration_m_s2=2.4,
        max_jerk_m_s3=6.0,
        corridor_violation_m=0.0,
        worst_viewpoint_miss_m=0.0,
        viewpoints=1,
        coverage=0.75,
        coverable=2 / 3,
        tour_cost=22.0,
        tour_lower_bound=22.0,
        tour_metric="time",
        energy_wh=3.1,
        open_sky=1.0,
    )
    return Plan(
        scenario=parse_scenario(scenario_data),
        cables=small_structure.cables,
        viewpoints=(viewpoint,),
        path_m=STOPS,
        path_stops=np.array([0, 2, 4]),
        corridor_m=np.stack([low, high], axis=1),
        trajectory=trajectory,
        yaw=AngleProfile(np.array([0.0, 6.0, 11.0]), np.array([0.5, 0.5, 0.0])),
        gimbal_pitch=AngleProfile(np.array([0.0, 22.0]), np.array([0.0, 0.0])),
        coverage=SurfaceCoverage(
            points_m=np.tile(np.arange(9.0).reshape(3, 3), (2, 1)),
            normals=np.repeat([[0.0, 0, 1], [0.0, 0, -1]], 3, axis=0),
            verdicts=np.array([0, 0, 0, 1, 9, 10], dtype=np.uint8),
            area_m2=600.0,
        ),
        certificates=certificates,
        stages_s={"viewpoints": 0.1, "tour": 0.2},
    )
