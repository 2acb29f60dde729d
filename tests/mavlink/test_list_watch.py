from gcs.mavlink.list_watch import SETTLED_S, ListWatch
from gcs.mavlink.mission_protocol import MissionType

MISSION, FENCE, RALLY = MissionType
OURS, THEIRS, OLD = 11, 22, 33


def told(watch, *ids, start_s=0.0):
    """The changes that are found when MISSION_CURRENT tells these ids of the mission, one a second."""
    found = []
    for i, each in enumerate(ids):
        found += watch.take({MISSION: each, FENCE: 0, RALLY: 0}, start_s + i)
    return found


def uploaded(list_id=OURS, at_s=0.0):
    watch = ListWatch()
    watch.uploaded(MISSION, list_id, at_s)
    return watch


def test_a_change_after_the_proof_is_told_once():
    assert told(uploaded(), OURS, OURS, THEIRS, THEIRS, THEIRS, OURS, THEIRS) == [MISSION]


def test_the_old_id_just_after_an_upload_is_no_change_and_neither_is_one_that_comes_late():
    assert told(uploaded(), OLD, OLD, OURS, OLD, OURS, OURS) == []


def test_a_change_before_our_id_was_told_once_is_found_when_the_old_one_can_be_told_no_more():
    watch = uploaded()
    assert told(watch, THEIRS, THEIRS, THEIRS) == []
    assert told(watch, THEIRS, THEIRS, start_s=SETTLED_S) == [MISSION]


def test_a_list_that_is_gone_is_a_change_but_a_vehicle_without_ids_never_is():
    assert told(uploaded(), OURS, 0, 0) == [MISSION]
    assert told(uploaded(), *[0] * 20) == []
    assert told(uploaded(list_id=0), 0, THEIRS, THEIRS) == [MISSION]


def test_an_id_that_cannot_be_told_ahead_is_learned_once_the_old_one_is_gone():
    watch = uploaded(list_id=None)
    assert told(watch, OLD, OLD, OURS, OURS, OURS, OURS) == []
    assert told(watch, THEIRS, THEIRS, start_s=10.0) == [MISSION]


def test_what_was_read_is_known_by_the_next_id():
    watch = ListWatch()
    assert told(watch, OLD, THEIRS, THEIRS) == [], "nothing was proved or read"
    watch.read(MISSION, 5.0)
    assert told(watch, THEIRS, OLD, OLD, start_s=5.0) == [MISSION]
    watch.read(MISSION, 10.0)
    watch.forget(MISSION)
    assert told(watch, THEIRS, OLD, OLD, start_s=10.0) == []


def test_each_list_has_its_own_id():
    watch = ListWatch()
    watch.uploaded(FENCE, OURS, 0.0)
    watch.uploaded(RALLY, OURS, 0.0)
    found = [watch.take({MISSION: 1, FENCE: each, RALLY: OURS}, 10.0) for each in (OURS, THEIRS, THEIRS, THEIRS)]
    assert found == [[], [], [FENCE], []]
