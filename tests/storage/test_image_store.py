import os
import zlib

import pytest

from gcs.core.clock import utc_now
from gcs.core.errors import IncompleteError, NotFoundError, StorageError
from gcs.storage.atomic_files import remove_partials, write_file
from gcs.storage.image_store import ImageStore
from gcs.storage.records import ImageRecord, ImageState

JPEG = b"\xff\xd8\xff\xe0" + bytes(range(256)) * 20


def make_image(**changes):
    values = {
        "id": "image-1",
        "flight_id": "flight-1",
        "index": 0,
        "viewpoint_id": 0,
        "viewpoint_name": "L1",
        "state": ImageState.STORED,
        "source": "link",
        "announced_at": utc_now(),
        "vehicle_path": "../../../etc/passwd",
    }
    return ImageRecord(**{**values, **changes})


def test_a_picture_is_kept_under_a_name_of_our_own(tmp_path):
    stored = ImageStore(tmp_path).save(make_image(), JPEG, size_bytes=len(JPEG), crc32=zlib.crc32(JPEG))
    assert stored.file_name == "image-1.jpg"
    path = tmp_path / "images" / "flight-1" / "image-1.jpg"
    assert path.read_bytes() == JPEG
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == [path]


@pytest.mark.parametrize(
    "said", [{"size_bytes": len(JPEG) + 1}, {"crc32": zlib.crc32(JPEG) ^ 1}], ids=["size", "checksum"]
)
def test_a_picture_that_is_not_what_was_announced_is_not_kept(tmp_path, said):
    with pytest.raises(IncompleteError):
        ImageStore(tmp_path).save(make_image(), JPEG, **said)
    assert not any(p.is_file() for p in tmp_path.rglob("*"))


def test_parts_lie_beside_the_pictures_and_go_with_their_flight(tmp_path):
    store = ImageStore(tmp_path)
    images = [make_image(), make_image(id="image-2"), make_image(id="image-3", flight_id="flight-2")]
    for image in images:
        part = store.part(image)
        part.begin(700)
        part.close()
    stored = store.save(images[0], JPEG)
    folder = tmp_path / "images"
    assert (folder / "flight-1" / "image-1.part").exists()
    store.remove_parts(but_of={"flight-2"})
    left = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())
    assert left == [f"flight-1/{stored.file_name}", "flight-2/image-3.part"]


@pytest.mark.parametrize("name", ["../image-1", "a/b", "..", ""])
def test_a_part_never_lies_elsewhere(tmp_path, name):
    with pytest.raises(NotFoundError):
        ImageStore(tmp_path).part(make_image(id=name))


def test_an_empty_picture_is_not_kept(tmp_path):
    with pytest.raises(IncompleteError):
        ImageStore(tmp_path).save(make_image(), b"", size_bytes=0, crc32=0)


def test_a_picture_that_changed_on_the_disk_is_not_whole(tmp_path):
    store = ImageStore(tmp_path)
    stored = store.save(make_image(), JPEG)
    image = make_image(file_name=stored.file_name, size_bytes=stored.size_bytes, crc32=stored.crc32)
    assert store.is_whole(image)
    store.path(image).write_bytes(JPEG[:-1] + b"!")
    assert not store.is_whole(image)
    store.path(image).unlink()
    assert not store.is_whole(image)
    with pytest.raises(NotFoundError, match="gone"):
        store.path(image)


@pytest.mark.parametrize("name", ["../token", "a/b.jpg", "/etc/passwd", "..", ".partial-x", "", "a" * 200])
def test_names_that_are_not_ours_lead_nowhere(tmp_path, name):
    with pytest.raises(NotFoundError):
        ImageStore(tmp_path).path(make_image(file_name=name))
    with pytest.raises(NotFoundError):
        ImageStore(tmp_path).path(make_image(flight_id=name, file_name="a.jpg"))


def test_a_full_disk_keeps_nothing_half_written(tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match="disk is full") as caught:
        ImageStore(tmp_path).save(make_image(), JPEG)
    assert "image-1.jpg" in str(caught.value)
    assert not any(p.is_file() for p in tmp_path.rglob("*"))


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "a.bin"
    write_file(path, b"old")
    write_file(path, b"new")
    assert path.read_bytes() == b"new"
    real = os.fsync
    monkeypatch.setattr(os, "fsync", lambda d: (_ for _ in ()).throw(OSError(28, "full")))
    with pytest.raises(StorageError):
        write_file(path, b"newer")
    monkeypatch.setattr(os, "fsync", real)
    assert path.read_bytes() == b"new"
    assert [p.name for p in tmp_path.iterdir()] == ["a.bin"]


def test_what_a_killed_process_left_half_written_is_removed(tmp_path):
    (tmp_path / ".partial-12-a").mkdir()
    (tmp_path / ".partial-12-a" / "x").write_text("x")
    (tmp_path / ".partial-34-b").write_text("b")
    (tmp_path / "whole").write_text("kept")
    remove_partials(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["whole"]
