"""Pieces of a picture on the disk: what a killed station left is told from damage, and the file stays small."""

from __future__ import annotations

import random

import pytest

from gcs.storage.image_parts import ImagePart

CONTENT = random.Random(4).randbytes(9_000)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "images" / "flight-1" / "image-1.part"


def kept(path, *offsets, size=9_000):
    part = ImagePart(path)
    part.begin(size)
    for offset in offsets:
        part.add(offset, CONTENT[offset : offset + 239])
    part.close()
    return path.read_bytes()


def test_what_was_kept_is_there_and_is_gone_on_with(path):
    kept(path, 0, 4_000)
    again = ImagePart(path)
    assert again.load() == (9_000, [(0, CONTENT[:239]), (4_000, CONTENT[4_000:4_239])])
    again.add(239, CONTENT[239:478])
    again.close()
    assert [offset for offset, _ in ImagePart(path).load()[1]] == [0, 4_000, 239]
    again.remove()
    assert not path.exists()
    assert ImagePart(path).load() is None


def test_every_way_to_tear_it_leaves_whole_pieces_only(path):
    raw = kept(path, 0, 239, 478)
    for end in range(len(raw)):
        path.write_bytes(raw[:end])
        found = ImagePart(path).load()
        if found is None:
            assert end < 19, "the header is not whole"
            continue
        assert all(CONTENT[offset : offset + 239] == data for offset, data in found[1])
        assert len(found[1]) == (end - 19) // 251


def test_a_torn_end_is_written_over(path):
    raw = kept(path, 0, 239)
    path.write_bytes(raw[:-100])
    part = ImagePart(path)
    part.load()
    part.add(478, CONTENT[478:717])
    part.close()
    assert [offset for offset, _ in ImagePart(path).load()[1]] == [0, 478]


def test_a_changed_bit_is_never_taken_for_the_picture(path):
    raw = kept(path, 0, 239, 478)
    for at in range(len(raw)):
        path.write_bytes(raw[:at] + bytes([raw[at] ^ 16]) + raw[at + 1 :])
        found = ImagePart(path).load()
        assert found is None or all(CONTENT[offset : offset + 239] == data for offset, data in found[1])


def test_another_beginning_forgets_what_was_kept(path):
    kept(path, 0, 239)
    kept(path, 239, size=700)
    assert ImagePart(path).load() == (700, [(239, CONTENT[239:478])])


def test_pieces_that_overlap_without_end_do_not_fill_the_disk(path):
    part = ImagePart(path)
    part.begin(9_000)
    for k in range(5_000):
        part.add(k, CONTENT[k : k + 239])
    part.close()
    assert path.stat().st_size <= 2 * 9_000 + 19
    part = ImagePart(path)
    part.load()
    for k in range(5_000):
        part.add(k, CONTENT[k : k + 239])
    part.close()
    assert path.stat().st_size <= 2 * 9_000 + 19


def test_a_disk_that_takes_nothing_does_not_stop_the_fetch(path):
    path.parent.parent.mkdir()
    path.parent.write_text("this is no folder")
    part = ImagePart(path)
    part.begin(9_000)
    part.add(0, CONTENT[:239])
    part.remove()
    assert part.load() is None
