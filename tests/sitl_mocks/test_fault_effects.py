"""What each fault that can be switched on does to a station that reads and writes a mission.

The first two tables are the failure modes of QGroundControl's MockLink; the third is what real links and vehicles add.
"""

from __future__ import annotations

from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl_mocks.mission_faults import FAULTS

INVALID_SEQUENCE = mavlink.MAV_MISSION_INVALID_SEQUENCE


def answers(station, message, seconds=1.0):
    """Kind and number (sequence, result or count) of what comes back."""
    heard = [m for m in station.exchange(message, seconds) if m.get_type().startswith("MISSION_")]
    numbers = ("seq", "type", "count")
    return [(m.get_type(), next(getattr(m, name) for name in numbers if hasattr(m, name))) for m in heard]


def read_list(station):
    return answers(station, mavlink.MAVLink_mission_request_list_message(1, 1, 0))


def read_item(station, sequence):
    return answers(station, mavlink.MAVLink_mission_request_int_message(1, 1, sequence, 0), 0.1)


def written(station):
    """What an upload is answered with: numbers of requests, and results."""
    said = answers(station, mavlink.MAVLink_mission_count_message(1, 1, 5, 0), 2.0)
    return [n for kind, n in said if kind.startswith("MISSION_REQUEST")], [
        n for kind, n in said if kind == "MISSION_ACK"
    ]


COUNT, ITEM_0, ITEM_1 = ("MISSION_COUNT", 10), ("MISSION_ITEM_INT", 0), ("MISSION_ITEM_INT", 1)
REFUSED = ("MISSION_ACK", mavlink.MAV_MISSION_ERROR)
READ = {
    "read-list-silent": [[], []],
    "read-list-silent-once": [[], [COUNT]],
    "read-0-silent": [[COUNT], [], []],
    "read-1-silent": [[COUNT], [ITEM_0], [], []],
    "read-1-silent-once": [[COUNT], [ITEM_0], [], [ITEM_1]],
    "read-0-misnumbered": [[COUNT], [ITEM_1]],
    "read-1-misnumbered": [[COUNT], [ITEM_0], [("MISSION_ITEM_INT", 2)]],
    "read-0-error": [[COUNT], [REFUSED]],
    "read-1-error": [[COUNT], [ITEM_0], [REFUSED]],
}
"""What comes back of a request for the list, then for item 0, then for item 1; and of the last one sent again."""


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
@pytest.mark.parametrize("fault", READ)
def test_faults_of_reading(kind, fault, naive):
    station, expected = naive(kind, fault), READ[fault]
    again = "silent" in fault
    steps = [read_list, lambda s: read_item(s, 0), lambda s: read_item(s, 1)][: len(expected) - again]
    assert [step(station) for step in [*steps, *steps[-1:] * again]] == expected


ALL, DONE, FAILED = [0, 1, 2, 3, 4], [0], [1]
WRITE = {
    "write-count-silent": ([], [], False),
    "write-count-silent-once": ([], [], False),
    "write-0-misnumbered": ([1], [], False),
    "write-1-misnumbered": ([0, 2], [], False),
    "write-1-silent": ([0], [], False),
    "write-0-error": ([], FAILED, False),
    "write-1-error": ([0], FAILED, False),
    "ack-early": ([0], DONE, False),
    "ack-missing": (ALL, [], True),
    "ack-lost-once": (ALL, [], True),
    "ack-error": (ALL, FAILED, True),
}
"""Which items are asked for first, the results that are told, and whether the vehicle holds the plan."""


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
@pytest.mark.parametrize("fault", WRITE)
def test_faults_of_writing(kind, fault, naive):
    station, (asked, results, holds) = naive(kind, fault), WRITE[fault]
    requests, told = written(station)
    assert requests[: len(asked)] == asked
    assert bool(requests) == bool(asked)
    assert [result for result in told if result != INVALID_SEQUENCE] == results
    assert station.world.truth()["holds"] == holds
    if fault == "write-1-silent":
        assert 1 not in requests
    if fault == "write-count-silent-once":
        assert written(station) == (ALL, DONE)


def sources(station):
    return {(m.get_srcSystem(), m.get_srcComponent()) for m in messages(station)} - {(1, 1)}


def messages(station):
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    return [m for _, packet in station.trace for m in parser.parse_buffer(packet) or []]


def longest_silence_s(station):
    times = [at for at, _ in station.trace]
    return max((b - a for a, b in pairwise(times)), default=9.0)


def results(station):
    return [m.type for m in messages(station) if m.get_type() == "MISSION_ACK" and m.mission_type == 0]


def asked(station):
    return [m.seq for m in messages(station) if m.get_type().startswith("MISSION_REQUEST") and m.mission_type == 0]


SHOWS = {
    "stale-other-list": lambda s: {m.mission_type for m in messages(s)} == {0, 1},
    "stale-ack": lambda s: messages(s)[0].get_type() == "MISSION_ACK" and results(s)[:2] == [0, 0],
    "other-component": lambda s: sources(s) == {(1, 100)},
    "other-system": lambda s: sources(s) == {(77, 1)},
    "invalid-sequence": lambda s: results(s) == [INVALID_SEQUENCE] * 5 + DONE,
    "doubled": lambda s: all(asked(s).count(n) >= 2 for n in range(5)),
    "reordered": lambda s: not s.trace or s.trace[0][0] > 0.3,
    "request-storm": lambda s: max(asked(s).count(n) for n in range(5)) >= 50,
    "request-out-of-range": lambda s: max(asked(s)) >= 5 and results(s) == DONE,
    "reboot": lambda s: longest_silence_s(s) > 0.9 and not s.world.truth()["holds"],
    "second-station": lambda s: not s.world.truth()["holds"],
    "changed": lambda s: results(s) == DONE and not s.world.truth()["holds"],
    "cleared": lambda s: results(s) == DONE and not s.world.truth()["holds"],
    "truncated": lambda s: results(s) == DONE and not s.world.truth()["holds"],
    "mixed": lambda s: results(s) == DONE and not s.world.truth()["holds"],
    "no-space-later": lambda s: results(s) == [mavlink.MAV_MISSION_NO_SPACE] and asked(s)[0] == 0,
    "link-change": lambda s: longest_silence_s(s) > 0.4,
    "link-gone": lambda s: results(s) == [],
    "corrupt": lambda s: any(m.get_type() == "BAD_DATA" for m in messages(s)),
    "cut-frames": lambda s: len(messages(s)) < len(s.trace) or any(m.get_type() == "BAD_DATA" for m in messages(s)),
    "mavlink-1": lambda s: {packet[0] for _, packet in s.trace} == {0xFE},
    "signed-only": lambda s: s.trace == [] and not s.world.truth()["holds"],
    "home-in-item-0": lambda s: results(s) == DONE and not s.world.truth()["holds"],
    "baud-57600": lambda s: s.trace[0][0] > 0.2,
}
"""What of the other faults shows in an upload, for one of a few seeds at least."""
ON_READING = {"rounded", "home-drifts"}


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
@pytest.mark.parametrize("fault", SHOWS)
def test_other_faults_show(kind, fault, naive):
    assert not SHOWS[fault](naive(kind).upload()), "it shows without the fault"
    assert any(SHOWS[fault](naive(kind, fault, seed=seed).upload()) for seed in range(12))


def test_every_fault_has_a_test_of_its_own_effect():
    assert {*READ, *WRITE, *SHOWS, *ON_READING} == set(FAULTS)


@pytest.mark.parametrize(
    ("kind", "fault"), [("px4", "rounded"), ("ardupilot", "rounded"), ("ardupilot", "home-drifts")]
)
def test_numbers_read_back_are_other_ones(kind, fault, naive):
    def read(*faults):
        station = naive(kind, *faults).upload()
        read_list(station)
        for n in range(3):
            read_item(station, n)
        return [(m.seq, m.x, m.y, m.z) for m in messages(station) if m.get_type() == "MISSION_ITEM_INT"]

    usual, odd = read(), read(fault)
    differ = [n for (n, *a), (_, *b) in zip(usual, odd, strict=True) if a != b]
    assert differ
    assert fault != "home-drifts" or differ == [0]
    assert all(abs(a[1] - b[1]) <= 50 and abs(a[3] - b[3]) <= 0.5 for a, b in zip(usual, odd, strict=True))
