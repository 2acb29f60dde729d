"""Plans by their hash: from the station, kept on the disk, and got again when the disk has damaged them."""

from __future__ import annotations

import hashlib
import time
from multiprocessing import active_children
from types import SimpleNamespace

import pytest

from gcs.core.errors import GcsError, InputError, LinkError, NotFoundError
from gcs.core.progress import SilentProgress
from gcs.services.benchmarks.wall_plan import WALL_M, wall_plan
from gcs.services.companion.station_plans import NO_STATION, StationFiles, StationPlans, prepared_plan
from gcs.services.plan_writing import write_certified
from gcs.storage.kept_plans import KeptPlans
from gcs.storage.plan_files import plan_hash
from gcs.storage.solid_shapes import box, structure_of_solids

PLAN, STRUCTURE = "plan.json", "structure.ply"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A plan as `gcs plan` writes it: its hash and its two files."""
    folder = tmp_path_factory.mktemp("wall") / "plan"
    write_certified(wall_plan().plan, structure_of_solids([box(*WALL_M)]), folder, SilentProgress())
    files = {name: (folder / name).read_bytes() for name in (PLAN, STRUCTURE)}
    return SimpleNamespace(hash=plan_hash(folder), files=files)


@pytest.fixture
def station(file_station, written):
    """A station that has the plan, and whose files can be spoiled."""
    file_station.plan_hash, file_station.files = written.hash, dict(written.files)
    file_station.plans = StationFiles(file_station.url, file_station.token)
    return file_station


@pytest.fixture
def kept(tmp_path):
    return KeptPlans(tmp_path / "plans")


def nobody(port):
    return StationFiles(f"http://127.0.0.1:{port}", "token")


def until_there(plans, wanted, seconds=120.0):
    """Ask as the companion does, again and again."""
    end = time.monotonic() + seconds
    while (made := plans.get(wanted, 1.0)) is None:
        assert time.monotonic() < end
        time.sleep(0.05)
    return made


def test_it_is_got_once_beside_the_flight_and_remembered(station, kept, written):
    plans = StationPlans(kept, station.plans)
    began = time.monotonic()
    assert plans.get(written.hash, 1.0) is None
    assert time.monotonic() - began < 5.0, "nothing is waited for"
    made = until_there(plans, written.hash)
    assert made.plan_hash == written.hash
    assert made.known is not None
    assert len(made.plan.viewpoints) == 4
    assert plans.get(written.hash, 1.0) is made
    assert sorted(station.asked) == [PLAN, STRUCTURE]
    assert kept.find(written.hash) is not None


def test_what_fails_is_told_and_tried_anew(station, kept, written):
    plans = StationPlans(kept, station.plans)
    station.files[PLAN] += b" "
    with pytest.raises(InputError, match="not the plan of this hash"):
        until_there(plans, written.hash)
    station.files[PLAN] = written.files[PLAN]
    assert until_there(plans, written.hash).plan_hash == written.hash


def test_one_plan_at_a_time_is_made_ready(kept):
    before = set(active_children())
    plans, hashes = StationPlans(kept, None), ("aa" * 32, "bb" * 32)
    assert [plans.get(wanted, 1.0) for wanted in hashes] == [None, None]
    assert len(set(active_children()) - before) <= 1
    for wanted in hashes:
        with pytest.raises(NotFoundError, match=NO_STATION):
            until_there(plans, wanted)


def test_without_the_station_it_is_flown_from_the_disk(kept, written, unused_tcp_port):
    with pytest.raises(LinkError, match="does not answer"):
        prepared_plan(kept, nobody(unused_tcp_port), written.hash, 1.0)
    kept.keep(written.hash, *written.files.values())
    for station in (None, nobody(unused_tcp_port)):
        made = prepared_plan(kept, station, written.hash, 3.0)
        assert (made.plan_hash, made.stream_loss.timeout_s) == (written.hash, 3.0)


def test_a_hash_that_nobody_knows(station, kept):
    for source, words in ((station.plans, "knows no plan"), (None, "--station")):
        with pytest.raises(NotFoundError, match=words):
            prepared_plan(kept, source, "0" * 64, 1.0)


@pytest.mark.parametrize("name", [PLAN, STRUCTURE])
@pytest.mark.parametrize("damage", ["cut", "bit", "gone"])
def test_what_the_disk_has_damaged_is_got_again(station, kept, written, name, damage):
    file = kept.keep(written.hash, *written.files.values()) / name
    content = file.read_bytes()
    if damage == "gone":
        file.unlink()
    else:
        middle = len(content) // 2
        file.write_bytes(
            content[:middle] + (b"" if damage == "cut" else bytes([content[middle] ^ 1]) + content[middle + 1 :])
        )
    assert KeptPlans(file.parents[1]).find(written.hash) is None
    assert prepared_plan(kept, station.plans, written.hash, 1.0).plan_hash == written.hash
    assert file.read_bytes() == content
    assert sorted(station.asked) == [PLAN, STRUCTURE]


def test_wrong_bytes_are_neither_flown_nor_kept(station, kept, written):
    station.files[PLAN] = written.files[PLAN].replace(b"wall", b"wild")
    assert hashlib.sha256(station.files[PLAN]).hexdigest() != written.hash
    with pytest.raises(InputError, match="not the plan of this hash"):
        prepared_plan(kept, station.plans, written.hash, 1.0)
    assert kept.find(written.hash) is None
    station.files = {**written.files, STRUCTURE: b"ply\nnonsense"}
    with pytest.raises(GcsError):
        prepared_plan(kept, station.plans, written.hash, 1.0)
    station.files = written.files
    assert prepared_plan(kept, station.plans, written.hash, 1.0).plan_hash == written.hash


def test_an_answer_that_breaks_off_is_no_answer(station, kept, written):
    station.cut = 100
    with pytest.raises(LinkError, match="broke off"):
        prepared_plan(kept, station.plans, written.hash, 1.0)
    assert kept.find(written.hash) is None
