"""Simulated vehicles stand at home of the scene and see its structure."""

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.core.frames import enu_from_geodetic
from gcs.services.simulation import SimulatorOptions
from gcs.services.simulation_scene import scene_options
from gcs.storage.plan_files import read_plan
from gcs.storage.ply_files import read_ply


def place(options):
    home = options.home
    return enu_from_geodetic(home.latitude_deg, home.longitude_deg, home.altitude_m, options.anchor)


def test_the_scene_of_a_plan(box_plan):
    asked = SimulatorOptions(autopilot="ardupilot", port=14999, extra=("--seed", "3"))
    with scene_options(asked, box_plan) as options:
        assert (options.autopilot, options.port, options.extra) == ("ardupilot", 14999, ("--seed", "3"))
        assert options.structure == box_plan / "structure.ply"
        assert options.anchor == read_plan(box_plan).scenario.anchor.point
        np.testing.assert_allclose(place(options), [-12, -12, 0], atol=1e-3)
    assert (box_plan / "structure.ply").exists()


def test_the_sample_crane_by_default():
    with scene_options(SimulatorOptions(), None) as options:
        vertices, faces = read_ply(options.structure)
        assert len(faces) > 100
        assert vertices[:, 2].max() > 30.0
        np.testing.assert_allclose(place(options), [-20, -20, 0], atol=1e-3)
    assert not options.structure.exists()
    assert not options.structure.parent.exists()


def test_a_folder_without_a_plan(tmp_path):
    with pytest.raises(InputError, match="no such plan"), scene_options(SimulatorOptions(), tmp_path):
        pass
