"""A short run of the fuzzing that `python -m gcs.services.benchmarks.mavlink_fuzz PACKETS` does at length."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.framing import FrameParser
from gcs.mavlink.mutated_packets import MutatedPackets
from gcs.services.benchmarks.mavlink_fuzz import fuzz


@pytest.mark.parametrize("seed", [1, 2])
def test_mutated_packets_crash_nothing_write_nothing_and_move_nothing(seed):
    result = fuzz(15_000, seed)
    assert result.crashes == ()
    assert (result.files_outside, result.orders) == (0, 0)
    assert result.memory_growth_mb < 50.0
    assert result.heard > 10_000
    assert result.exchanges > 0


def test_most_mutated_packets_get_past_the_framing_and_every_kind_is_among_them():
    source, parser = MutatedPackets(3, 1, answers_only=False), FrameParser()
    heard = [m for _ in range(30_000) for m in parser.feed(source.next())]
    kinds = {m.get_msgId() for m in heard}
    assert len(heard) > 24_000
    assert len(kinds) == len(mavlink.mavlink_map)
    for message in heard[:3000]:
        repr(message)  # unpacks every field


def test_the_same_seed_makes_the_same_packets():
    one, two = (MutatedPackets(5, 1, answers_only=True) for _ in range(2))
    assert [one.next() for _ in range(500)] == [two.next() for _ in range(500)]
