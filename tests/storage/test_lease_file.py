"""The last lease of a companion, on its disk."""

from __future__ import annotations

from gcs.storage.lease_file import KeptLease, LeaseFile

KEPT = KeptLease(7, 2, "ab" * 32, 12.5, (1, 4))


def test_the_file_keeps_the_last_lease_and_a_damaged_one_is_none(tmp_path, caplog):
    file = LeaseFile(tmp_path / "lease.json")
    assert file.load() is None
    file.keep(KeptLease(6, 2, "ab" * 32))
    file.keep(KEPT)
    file.flush()
    assert LeaseFile(tmp_path / "lease.json").load() == KEPT
    for damaged in ("", "[]", '{"lease": 7}', '{"lease": 7, "state": 2, "plan_hash": "xy", "plan_s": 1, "done": []}'):
        (tmp_path / "lease.json").write_text(damaged)
        assert file.load() is None
        assert "holds no lease" in caplog.text
        caplog.clear()


def test_a_disk_that_is_full_does_not_stop_the_flight(tmp_path, caplog):
    file = LeaseFile(tmp_path / "not there" / "lease.json")
    file.keep(KEPT)
    file.flush()
    assert "not safe from a restart" in caplog.text
