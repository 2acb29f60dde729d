"""The lattice of the benchmark, its fit, and a mesh of the user's own."""

import numpy as np
import pytest
import trimesh

from gcs.core.errors import InputError
from gcs.services.benchmarks.coverage import OVERLAPS, fitted_exponent, mesh_scenario, scene_scenario
from gcs.services.benchmarks.lattice import lattice_mast
from gcs.services.benchmarks.registry import run_benchmark
from gcs.storage.sample_scenes import SAMPLE_BUILDERS


@pytest.mark.parametrize("split", [1, 2, 3])
def test_a_finer_lattice_is_the_same_surface(split):
    coarse, fine = lattice_mast(), lattice_mast(split)
    assert len(coarse.faces) == 10_080
    assert len(fine.faces) == 10_080 * split**2
    area = [trimesh.triangles.area(m.triangles_m).sum() for m in (coarse, fine)]
    assert area[0] == pytest.approx(area[1])
    np.testing.assert_allclose(coarse.bounds_m, fine.bounds_m, atol=1e-9)


def test_every_beam_of_the_lattice_is_closed_and_faces_outwards():
    mast = lattice_mast()
    for beam in np.split(mast.faces, 840)[::7]:
        mesh = trimesh.Trimesh(mast.vertices_m, beam, process=True)
        assert mesh.is_watertight
        assert mesh.volume > 0


def test_the_fit_finds_the_exponent():
    n = np.array([10_000, 40_000, 250_000, 1_000_000])
    assert fitted_exponent(n, 3e-7 * n * np.log(n)) == pytest.approx(1.0)
    assert fitted_exponent(n, np.full(4, 2.0)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", list(SAMPLE_BUILDERS))
def test_every_sample_scene_has_a_surface_to_be_covered(name):
    scenario = scene_scenario(name)
    assert scenario.structure.sample == name
    assert scenario.inspection.surface is not None
    assert scenario.inspection.points == ()


def test_a_mesh_gets_a_ground_a_home_and_a_gsd_of_its_size(tmp_path):
    mesh = trimesh.creation.box((8, 8, 40))
    mesh.apply_translation((5, 5, 18))
    mesh.export(tmp_path / "tower.stl")
    scenario = mesh_scenario(tmp_path / "tower.stl")
    assert scenario.ground_m == pytest.approx(-2.0)
    assert scenario.home_m == pytest.approx((-19.0, -19.0, -2.0))
    assert scenario.inspection.surface.gsd_mm == pytest.approx(4.0)


def test_a_mesh_that_is_none_is_bad_input(tmp_path):
    (tmp_path / "none.stl").write_text("solid nothing\nendsolid nothing\n")
    with pytest.raises(InputError):
        run_benchmark("coverage", quick=True, mesh=tmp_path / "none.stl")


def test_a_mesh_of_the_users_own_is_measured_at_both_overlaps(tmp_path):
    mesh = trimesh.creation.box((6, 6, 12))
    mesh.apply_translation((0, 0, 6))
    mesh.export(tmp_path / "hut.stl")
    rows = {(r["case"], r["figure"]): r["value"] for r in run_benchmark("coverage", True, tmp_path / "hut.stl")["rows"]}
    assert {case for case, _ in rows} == {f"hut{end}" for end in OVERLAPS.values()}
    for end in OVERLAPS.values():
        case = f"hut{end}"
        assert rows[case, "coverage"] > 0.97
        # five of the six sides, each of them from outside; the gimbal does not look straight up
        assert rows[case, "coverable"] == pytest.approx(0.5 * (36 + 4 * 72) / (2 * 36 + 4 * 72), abs=0.05)
        assert 1 <= rows[case, "views_lower_bound"] <= rows[case, "views"]
        assert rows[case, "views_over_bound"] == pytest.approx(
            rows[case, "views"] / rows[case, "views_lower_bound"], rel=1e-6
        )
        assert rows[case, "segment_tests_per_s"] > 0
    assert rows["hut", "views"] <= rows["hut-overlap-0.3", "views"]
