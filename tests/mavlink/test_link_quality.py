import random

import pytest

from gcs.mavlink.link_quality import WINDOW_S, SequenceMeter


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
