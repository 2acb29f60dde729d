"""Undelivered reports over a restart, a damaged file and a full folder."""

from __future__ import annotations

import shutil
from dataclasses import replace

import pytest

from gcs.core.errors import StorageError
from gcs.core.frames import GeoPoint
from gcs.core.replanning import ReplanReason, ReplanReport, SeenObstacle, ViewpointChange, ViewpointFate
from gcs.storage.report_outbox_files import MOST_ASIDE, ReportOutboxFiles

PLACE = GeoPoint(31.3622, 121.6155, 12.25)
FULL = ReplanReport(
    boot_id=0xFFFF_FFFF,
    number=1,
    plan_hash="ab" * 32,
    plan_hash_after="cd" * 32,
    reason=ReplanReason.BACKED_OFF,
    mission_item=-1,
    left_at_s=12.5,
    rejoined_at_s=None,
    obstacle=SeenObstacle(PLACE, 0.5, (1.0, -2.0)),
    path=(PLACE, PLACE),
    viewpoints=(ViewpointChange(3, ViewpointFate.MOVED, PLACE), ViewpointChange(4, ViewpointFate.SKIPPED, None)),
)


def test_reports_come_back_in_order_as_they_were(tmp_path):
    store = ReportOutboxFiles(tmp_path / "reports")
    reports = [FULL, replace(FULL, boot_id=1, obstacle=None, rejoined_at_s=20.0), replace(FULL, number=2, path=())]
    for report in reports:
        store.keep(report)
    store.flush()
    again = ReportOutboxFiles(tmp_path / "reports")
    assert again.load() == reports
    again.remove(reports[0])
    again.keep(replace(FULL, number=3))
    again.flush()
    assert [r.number for r in ReportOutboxFiles(tmp_path / "reports").load()] == [1, 2, 3]


def test_refused_and_damaged_ones_are_moved_aside_and_only_so_many(tmp_path, caplog):
    store = ReportOutboxFiles(tmp_path)
    for number in range(1, MOST_ASIDE + 5):
        report = replace(FULL, number=number)
        store.keep(report)
        store.set_aside(report)
    store.flush()
    (tmp_path / "99999998-1-1.json").write_text('{"boot_id": 1}')
    (tmp_path / "99999999-1-2.json").write_bytes(b"\xff\x00")
    (tmp_path / "00000500-1-2.json").write_text("[]")
    again = ReportOutboxFiles(tmp_path)
    assert again.load() == []
    again.flush()
    assert sum("holds no report" in line for line in caplog.messages) == 3
    aside = sorted(f.name for f in (tmp_path / "aside").iterdir())
    assert len(aside) == MOST_ASIDE
    assert aside[-1] == "99999999-1-2.json"
    assert not list(tmp_path.glob("*.json"))


def test_what_a_killed_process_left_is_removed(tmp_path):
    (tmp_path / ".partial-1234-x.json").write_text("{")
    assert ReportOutboxFiles(tmp_path).load() == []
    assert not list(tmp_path.glob(".partial*"))


def test_removing_what_is_not_there_is_no_error(tmp_path):
    store = ReportOutboxFiles(tmp_path)
    store.remove(FULL)
    store.set_aside(FULL)
    store.flush()


def test_a_disk_that_takes_nothing_is_said_and_stops_nothing(tmp_path, caplog):
    store = ReportOutboxFiles(tmp_path / "reports")
    shutil.rmtree(tmp_path / "reports")
    store.keep(FULL)
    store.set_aside(FULL)
    store.flush()
    assert "not safe from a restart" in caplog.text


def test_a_place_that_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError):
        ReportOutboxFiles(tmp_path / "file")
