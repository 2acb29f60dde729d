"""Where simulated vehicles stand and what their cameras see: the scene of a plan, or the sample crane."""

from __future__ import annotations

import tempfile
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.scenario import parse_scenario
from gcs.storage.mesh_files import load_structure, sample_scenario
from gcs.storage.plan_files import read_plan
from gcs.storage.ply_files import ply_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gcs.core.scenario import Scenario
    from gcs.services.simulation import SimulatorOptions

SAMPLE = "gantry-crane"


@contextmanager
def scene_options(options: SimulatorOptions, plan_directory: Path | None) -> Iterator[SimulatorOptions]:
    """Options that put the vehicles at home of a scene and its structure before their cameras.

    Args:
        options: as the user gave them.
        plan_directory: a plan's folder; None for the sample crane.

    Raises:
        InputError: the folder holds no plan.
    """
    if plan_directory is not None:
        scenario = read_plan(plan_directory).scenario
        yield _placed(options, scenario, plan_directory / "structure.ply")
        return
    scenario = parse_scenario(sample_scenario(SAMPLE))
    with tempfile.TemporaryDirectory(prefix="gcs-scene-") as folder:
        structure, _ = load_structure(scenario.structure, Path(folder))
        mesh = Path(folder) / "structure.ply"
        mesh.write_bytes(ply_bytes(structure.vertices_m, structure.faces))
        yield _placed(options, scenario, mesh)


def _placed(options: SimulatorOptions, scenario: Scenario, mesh: Path) -> SimulatorOptions:
    latitude, longitude, altitude = geodetic_from_enu(scenario.home_m, scenario.anchor.point)
    home = GeoPoint(float(latitude), float(longitude), float(altitude))
    return replace(options, home=home, anchor=scenario.anchor.point, structure=mesh)
