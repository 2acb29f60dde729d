import hashlib
import io
import os

import numpy as np
import pytest
import trimesh

from gcs.core.errors import InputError, NotFoundError, RefusedError, StorageError
from gcs.core.scenario import parse_scenario
from gcs.services.structure_service import StructureService
from gcs.storage.database import Database

BOX = trimesh.creation.box((2, 4, 6)).export(file_type="stl")


@pytest.fixture
def database(tmp_path):
    database = Database(tmp_path)
    yield database
    database.close()


@pytest.fixture
def structures(database, tmp_path):
    service = StructureService(database, tmp_path)
    service.open()
    return service


def files(structures):
    return [p for p in structures.folder.rglob("*") if p.is_file()]


def test_a_mesh_is_kept_placed_and_given_out(structures):
    added = structures.add(io.BytesIO(BOX), original_name="C:\\models\\My box.STL", scale=2.0, position_m=(10, 0, 6))
    assert added.info.name == "My box"
    np.testing.assert_allclose(added.structure.bounds_m, [[8, -4, 0], [12, 4, 12]])
    (file,) = files(structures)
    assert hashlib.sha256(file.read_bytes()).digest() == hashlib.sha256(BOX).digest()

    loaded = structures.get(added.info.id)
    np.testing.assert_allclose(loaded.structure.bounds_m, added.structure.bounds_m)
    drawn = trimesh.load(io.BytesIO(structures.mesh_ply(added.info.id)), file_type="ply", process=False)
    np.testing.assert_allclose(drawn.bounds, added.structure.bounds_m)
    assert [info.id for info in structures.list()] == ["gantry-crane", "container-yard", "bridge-tower", added.info.id]


def test_a_mesh_gives_a_scenario_to_start_from_that_is_valid(structures):
    added = structures.add(io.BytesIO(BOX), original_name="box.stl")
    scenario = parse_scenario(structures.starting_scenario(added.info.id))
    assert scenario.structure.meshes[0].file == f"{added.info.id}/mesh.stl"
    assert scenario.ground_m == pytest.approx(-3)
    low = added.structure.bounds_m[0]
    assert scenario.home_m[0] < low[0]
    assert scenario.home_m[1] < low[1]


@pytest.mark.parametrize("name", ["gantry-crane", "container-yard", "bridge-tower"])
def test_every_sample_is_listed_and_comes_with_a_scenario(structures, name):
    assert name in [info.id for info in structures.list()]
    assert parse_scenario(structures.starting_scenario(name)).structure.sample == name


def test_the_sample_is_there_with_its_points_and_scenario(structures):
    crane = structures.get("gantry-crane")
    assert len(crane.structure.named_points) == 18
    assert parse_scenario(structures.starting_scenario("gantry-crane")).structure.sample == "gantry-crane"
    with pytest.raises(RefusedError):
        structures.delete("gantry-crane")


@pytest.mark.parametrize(
    ("name", "content"),
    [("box.stl", b""), ("box.stl", b"this is not a mesh"), ("box.exe", BOX), ("box", BOX), ("../../box.txt", BOX)],
)
def test_what_is_not_a_mesh_is_not_kept(structures, database, name, content):
    with pytest.raises(InputError) as caught:
        structures.add(io.BytesIO(content), original_name=name)
    assert caught.value.field == "file"
    assert str(structures.folder) not in caught.value.message
    assert files(structures) == []
    assert list(structures.folder.iterdir()) == []
    assert database.structures.all() == ()


def test_a_full_disk_keeps_nothing(structures, database, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match="disk is full"):
        structures.add(io.BytesIO(BOX), original_name="box.stl")
    assert list(structures.folder.iterdir()) == []
    assert database.structures.all() == ()


def test_a_structure_is_removed_with_its_file(structures):
    added = structures.add(io.BytesIO(BOX), original_name="box.stl")
    structures.delete(added.info.id)
    assert files(structures) == []
    with pytest.raises(NotFoundError):
        structures.get(added.info.id)
