"""Reports from the vehicle's outbox to the station's assembler over a bad link, on fake time."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.mavlink.replan_messages import hash_after
from gcs.mavlink.report_assembler import ReportAssembler, ReportStatus, report_ack
from gcs.mavlink.report_outbox import MOST_PENDING, ReportOutbox
from gcs.services.benchmarks.report_world import PLAN_HASH, ReportsInMemory, ReportWorld, sample_report


class BadWorld(ReportWorld):
    """Its link also doubles messages and changes their order."""

    def carry(self, take, message):
        one_way_s = self.one_way_s
        for _ in range(1 + (self.rng.random() < 0.1)):
            self.one_way_s = one_way_s + 0.03 * self.rng.random()
            super().carry(take, message)
        self.one_way_s = one_way_s


def numbers(world):
    return [(report.boot_id, report.number) for _, report in world.stored]


def test_reports_are_at_the_station_within_a_second_when_one_message_in_ten_is_lost_each_way():
    delays = []
    for seed in range(1000):
        world = ReportWorld(seed, loss=0.1)
        world.outbox.add(sample_report())
        world.run(20.0)
        assert len(world.stored) == 1
        assert world.outbox.pending == 0
        delays.append(world.stored[0][0])
    p50, p95, p99 = np.percentile(delays, [50, 95, 99])
    print(f"p50 {p50:.3f} s, p95 {p95:.3f} s, p99 {p99:.3f} s, max {max(delays):.3f} s")
    assert p99 < 0.7
    assert p50 < 0.2


def test_after_a_break_of_two_minutes_all_of_them_in_order_and_each_once():
    store = ReportsInMemory()
    world = BadWorld(5, loss=0.1, store=store)
    world.outbox.add(sample_report())
    world.run(3.0)
    world.broken = True
    for k in range(40):
        world.outbox.add(sample_report(points=k, viewpoints=k % 5))
        world.run(3.0)
    assert len(world.stored) == 1
    assert world.outbox.pending == 40
    sent = world.sent
    world.broken = False
    world.run(30.0)
    assert numbers(world) == [(5, k) for k in range(1, 42)]
    assert world.outbox.pending == 0
    assert store.kept == []
    assert sent < 1000
    quiet = world.sent
    world.run(60.0)
    assert world.sent == quiet


def test_hashes_are_a_chain_that_starts_with_each_plan():
    world = ReportWorld(1)
    for plan in (PLAN_HASH, PLAN_HASH, "cd" * 32, PLAN_HASH):
        world.outbox.add(sample_report(plan_hash=plan))
    world.run(5.0)
    a, b, c, d = reports = [report for _, report in world.stored]
    assert (a.plan_hash, b.plan_hash, c.plan_hash, d.plan_hash) == (PLAN_HASH, a.plan_hash_after, "cd" * 32, PLAN_HASH)
    assert all(r.plan_hash_after == hash_after(r.plan_hash, r.path, r.viewpoints) for r in reports)


def test_a_restart_of_the_companion_loses_nothing_and_its_own_reports_come_after():
    store = ReportsInMemory()
    world = ReportWorld(7, store=store)
    world.broken = True
    for _ in range(3):
        world.outbox.add(sample_report())
    world.run(5.0)
    world.start_companion(boot_id=8)
    world.broken = False
    world.outbox.add(sample_report())
    world.run(5.0)
    assert numbers(world) == [(7, 1), (7, 2), (7, 3), (8, 1)]
    assert store.kept == []


def test_a_station_that_was_started_again_gets_a_report_that_was_not_acknowledged_whole():
    world = ReportWorld(2, loss=0.5)
    world.outbox.add(sample_report(points=100))
    world.run(0.3)
    world.assembler = ReportAssembler()
    world.run(20.0)
    assert numbers(world) == [(2, 1)]


def test_a_lost_acknowledgement_is_sent_again_at_once_and_the_report_not_given_out_again():
    world = ReportWorld(1)
    acknowledge, world.acknowledge = world.acknowledge, world.assembler.answered
    world.outbox.add(sample_report())
    world.run(1.0)
    world.acknowledge = acknowledge
    world.run(2.0)
    assert numbers(world) == [(1, 1)]
    assert world.outbox.pending == 0


def test_a_refused_report_is_set_aside_and_the_next_goes_on(monkeypatch, caplog):
    store = ReportsInMemory()
    world = ReportWorld(1, store=store)
    monkeypatch.setattr("gcs.mavlink.report_outbox.hash_after", lambda *_: "00" * 32)
    world.outbox.add(sample_report())
    monkeypatch.undo()
    world.outbox.add(sample_report(plan_hash="cd" * 32))
    world.run(5.0)
    assert world.refused == [(1, 1)]
    assert numbers(world) == [(1, 2)]
    assert [r.number for r in store.aside] == [1]
    assert sum("refused" in line for line in caplog.messages) == 1


def test_other_acknowledgements_do_not_count():
    world = ReportWorld(1)
    world.broken = True
    world.outbox.add(sample_report())
    for key in ((2, 1), (1, 2)):
        world.outbox.handle(report_ack(*key, ReportStatus.STORED, 1))
    world.outbox.handle(report_ack(1, 1, 7, 1))
    assert world.outbox.pending == 1


def test_a_long_report_goes_out_as_a_radio_can_take_it():
    world = ReportWorld(3, loss=0.1)
    world.outbox.add(sample_report(points=400, viewpoints=60))
    assert world.sent == 12
    world.run(1.0)
    assert world.sent == 52
    world.run(19.0)
    assert len(world.stored[0][1].path) == 400


def test_without_an_answer_no_report_makes_the_radio_carry_more_than_it_can():
    world = ReportWorld(3)
    world.broken = True
    for _ in range(30):
        world.outbox.add(sample_report(points=48, viewpoints=8))
        before = world.sent
        world.run(0.5)
        assert world.sent - before <= 20
    assert world.sent <= 12 + 40 * 15


def test_where_answers_come_quickly_the_next_report_follows_at_once():
    world = ReportWorld(3)
    for _ in range(10):
        world.outbox.add(sample_report(points=48, viewpoints=8))
    world.run(10 * 2 * world.one_way_s)
    assert len(world.stored) == 10


def test_the_largest_report_of_a_departure_is_there_within_a_second_as_well():
    delays = []
    for seed in range(1000):
        world = ReportWorld(seed, loss=0.1)
        world.outbox.add(sample_report(points=48, viewpoints=8))
        world.run(20.0)
        delays.append(world.stored[0][0])
    assert np.percentile(delays, 99) < 0.7
    assert np.percentile(delays, 50) < 0.3


def test_what_does_not_fit():
    world = ReportWorld(1)
    with pytest.raises(InputError, match="2000 viewpoints"):
        world.outbox.add(sample_report(viewpoints=2001))
    world.outbox.add(sample_report(points=1000))
    world.run(5.0)
    assert numbers(world) == [(1, 1)]
    assert len(world.stored[0][1].path) == 400


def test_too_many_are_said_and_the_gap_shows(caplog):
    store = ReportsInMemory()
    world = ReportWorld(1, store=store)
    world.broken = True
    for _ in range(MOST_PENDING + 1):
        world.outbox.add(sample_report(points=0, viewpoints=0))
    assert world.outbox.pending == len(store.kept) == MOST_PENDING
    assert "is lost" in caplog.text


def test_boots_have_ids_of_their_own():
    ids = {ReportOutbox(ReportsInMemory(), lambda m: None, lambda: 0.0).boot_id for _ in range(20)}
    assert len(ids) > 15
