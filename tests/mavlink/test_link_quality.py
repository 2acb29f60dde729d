import random

import pytest

from gcs.mavlink.link_quality import WINDOW_S, RoundTripMeter, SequenceMeter


def test_nothing_heard_is_unknown():
    quality = SequenceMeter().quality(5.0)
    assert quality.loss is None
    assert quality.messages_per_s == 0.0


def test_loss_is_measured_across_the_wrap():
    rng = random.Random(1)
    meter = SequenceMeter()
    lost = 0
    for i in range(2000):
        t = i * 0.005
        if rng.random() < 0.2 and 0 < i < 1999:
            lost += 1
        else:
            meter.count(1, i % 256, t)
    quality = meter.quality(2000 * 0.005)
    assert quality.loss == pytest.approx(lost / 2000, abs=1e-9)
    assert quality.messages_per_s == pytest.approx((2000 - lost) / WINDOW_S, rel=0.01)


def test_components_count_each_for_itself():
    meter = SequenceMeter()
    for i in range(100):
        meter.count(1, (2 * i) % 256, i * 0.01)
        meter.count(100, i, i * 0.01)
    assert meter.quality(1.0).loss == pytest.approx(99 / 299)


def test_doubled_and_late_messages_are_no_loss():
    meter = SequenceMeter()
    for sequence in (0, 1, 1, 2, 1, 3, 4):
        meter.count(1, sequence, 0.1)
    assert meter.quality(0.2).loss == 0.0


def test_old_losses_are_forgotten():
    meter = SequenceMeter()
    meter.count(1, 0, 0.0)
    meter.count(1, 50, 0.1)
    for i in range(100):
        meter.count(1, (51 + i) % 256, 0.2 + i * 0.2)
    assert meter.quality(20.2).loss == 0.0


def test_the_round_trip_is_the_median_of_the_last_answers():
    meter = RoundTripMeter()
    assert meter.median_s(0.0) is None
    for i, seconds in enumerate((0.05, 0.05, 1.5, 0.06, 0.05)):
        stamp = meter.ask(float(i))
        assert meter.answered(stamp, i + seconds) == pytest.approx(seconds, abs=1e-6)
    assert meter.median_s(5.0) == pytest.approx(0.05, abs=1e-6)
    assert meter.median_s(4.05 + WINDOW_S + 0.1) is None


def test_answers_to_others_and_second_answers_are_no_round_trips():
    meter = RoundTripMeter()
    stamp = meter.ask(10.0)
    assert meter.answered(stamp - 1, 10.1) is None
    assert meter.answered(-(1 << 63), 10.1) is None
    assert meter.answered(stamp, 10.2) == pytest.approx(0.2, abs=1e-6)
    assert meter.answered(stamp, 10.3) is None
    assert meter.median_s(10.3) == pytest.approx(0.2, abs=1e-6)


def test_questions_without_an_answer_are_forgotten():
    meter = RoundTripMeter()
    first = meter.ask(0.0)
    for i in range(1, 1000):
        meter.ask(float(i))
    assert meter.answered(first, 1000.0) is None
