import pytest

from gcs.core.errors import RefusedError
from gcs.core.vehicle import FlightMode, MissionProgress, MissionState
from gcs.mavlink.autopilots.ardupilot import ArduPilot
from gcs.mavlink.autopilots.px4 import Px4
from gcs.mavlink.mode_guard import COMMAND_WINDOW_S, VERDICT_S, WORD_S, ModeChange, ModeGuard, Shown

PX4, ARDUPILOT = Px4(), ArduPilot()
POSCTL = 3 << 16


def px4(mode):
    number = PX4.custom_mode(mode)
    assert number is not None
    return number


def guard_in(mode, *, armed=True, stack=PX4, now=0.0):
    """A guard whose vehicle is in a mode that the station commanded."""
    guard = ModeGuard(stack)
    number = stack.custom_mode(mode)
    guard.on_heartbeat(Shown(number + 1 if stack is ARDUPILOT else POSCTL, False, 3), now)
    guard.command_mode(number, now)
    assert guard.on_heartbeat(Shown(number, False, 3), now + 0.1) is ModeChange.COMMANDED
    if armed:
        assert guard.on_heartbeat(Shown(number, True, 4), now + 0.2) is None
    return guard


@pytest.mark.parametrize(
    "new", [POSCTL, px4(FlightMode.RETURN), px4(FlightMode.LAND), px4(FlightMode.HOLD), 7 << 16, 0]
)
def test_leaving_offboard_without_a_command_is_a_take_over(new):
    guard = guard_in(FlightMode.OFFBOARD)
    assert guard.on_heartbeat(Shown(new, True, 4), 1.0) is ModeChange.TAKEN_OVER
    with pytest.raises(RefusedError, match="OFFBOARD"):
        guard.check()
    with pytest.raises(RefusedError):
        guard.command_mode(px4(FlightMode.HOLD), 1.1)


def test_hands_off_outlasts_landing_and_going_back_and_ends_only_by_take_back():
    guard = guard_in(FlightMode.OFFBOARD)
    guard.on_heartbeat(Shown(POSCTL, True, 4), 1.0)
    guard.on_heartbeat(Shown(px4(FlightMode.OFFBOARD), True, 4), 2.0)
    guard.on_heartbeat(Shown(px4(FlightMode.OFFBOARD), False, 3), 3.0)
    guard.on_time(100.0)
    with pytest.raises(RefusedError):
        guard.check()
    guard.take_back()
    guard.check()


def test_a_commanded_change_is_the_stations():
    guard = guard_in(FlightMode.OFFBOARD)
    guard.command_mode(px4(FlightMode.HOLD), 1.0)
    assert guard.on_heartbeat(Shown(px4(FlightMode.HOLD), True, 4), 2.0) is ModeChange.COMMANDED
    guard.check()


def test_a_command_of_long_ago_or_refused_explains_no_change():
    for spoil in ("wait", "withdraw"):
        guard = guard_in(FlightMode.OFFBOARD)
        guard.command_mode(px4(FlightMode.HOLD), 1.0)
        later = 2.0
        if spoil == "wait":
            later = 1.0 + COMMAND_WINDOW_S + 0.1
        else:
            guard.withdraw(px4(FlightMode.HOLD))
        assert guard.on_heartbeat(Shown(px4(FlightMode.HOLD), True, 4), later) is ModeChange.TAKEN_OVER


def test_a_command_explains_one_change_only():
    guard = guard_in(FlightMode.HOLD)
    guard.command_mode(px4(FlightMode.OFFBOARD), 1.0)
    guard.on_heartbeat(Shown(px4(FlightMode.OFFBOARD), True, 4), 1.2)
    assert guard.on_heartbeat(Shown(px4(FlightMode.HOLD), True, 4), 1.5) is ModeChange.TAKEN_OVER


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (FlightMode.TAKEOFF, FlightMode.HOLD),
        (FlightMode.TAKEOFF, FlightMode.MISSION),
        (FlightMode.RETURN, FlightMode.LAND),
        (FlightMode.RETURN, FlightMode.HOLD),
    ],
)
def test_regular_successors_are_the_autopilots_own(old, new):
    guard = guard_in(old)
    assert guard.on_heartbeat(Shown(px4(new), True, 4), 1.0) is ModeChange.OWN
    guard.check()


@pytest.mark.parametrize("stack", [PX4, ARDUPILOT])
@pytest.mark.parametrize("new", [FlightMode.HOLD, FlightMode.RETURN, FlightMode.LAND])
def test_the_end_of_a_mission_is_regular_and_its_middle_is_not(stack, new):
    last = 5 if stack is ARDUPILOT else 4
    for current, wanted in ((last, ModeChange.OWN), (2, ModeChange.UNDECIDED)):
        guard = guard_in(FlightMode.MISSION, stack=stack)
        guard.on_mission(MissionProgress(current, 5, MissionState.ACTIVE))
        assert guard.on_heartbeat(Shown(stack.custom_mode(new), True, 4), 1.0) is wanted


def test_leaving_a_mission_in_its_middle_is_a_take_over_after_a_moment_and_nothing_is_permitted_meanwhile():
    guard = guard_in(FlightMode.MISSION)
    guard.on_mission(MissionProgress(2, 5, MissionState.ACTIVE))
    guard.on_heartbeat(Shown(px4(FlightMode.RETURN), True, 4), 1.0)
    with pytest.raises(RefusedError):
        guard.check()
    assert guard.on_time(1.0 + VERDICT_S - 0.1) is None
    assert guard.on_time(1.0 + VERDICT_S) is ModeChange.TAKEN_OVER
    assert guard.hands_off is not None


def test_late_news_of_the_last_item_settle_the_verdict():
    guard = guard_in(FlightMode.MISSION)
    guard.on_mission(MissionProgress(2, 5, MissionState.ACTIVE))
    guard.on_heartbeat(Shown(px4(FlightMode.HOLD), True, 4), 1.0)
    assert guard.on_mission(MissionProgress(4, 5, MissionState.COMPLETE)) is ModeChange.OWN
    assert guard.on_time(10.0) is None
    guard.check()


def test_a_mission_left_into_a_manual_mode_is_the_pilots_at_once_even_at_its_last_item():
    guard = guard_in(FlightMode.MISSION)
    guard.on_mission(MissionProgress(4, 5, MissionState.ACTIVE))
    assert guard.on_heartbeat(Shown(POSCTL, True, 4), 1.0) is ModeChange.TAKEN_OVER


def test_a_failsafe_is_named_as_such_and_not_waited_for():
    guard = guard_in(FlightMode.MISSION)
    guard.on_mission(MissionProgress(2, 5, MissionState.ACTIVE))
    assert guard.on_heartbeat(Shown(px4(FlightMode.RETURN), True, 5), 1.0) is ModeChange.TAKEN_OVER
    assert "failsafe" in (guard.hands_off or "")


def test_a_flight_the_station_never_commanded_is_watched_by_the_same_rule():
    guard = ModeGuard(PX4)
    guard.on_heartbeat(Shown(px4(FlightMode.MISSION), True, 4), 0.0)
    assert guard.on_heartbeat(Shown(POSCTL, True, 4), 1.0) is ModeChange.TAKEN_OVER


def test_first_heard_armed_in_a_manual_mode_is_the_pilots():
    guard = ModeGuard(ARDUPILOT)
    guard.on_heartbeat(Shown(0, True, 4), 0.0)
    assert "STABILIZE" in (guard.hands_off or "")


def test_on_the_ground_modes_may_change_but_not_in_the_midst_of_a_start():
    idle = ModeGuard(ARDUPILOT)
    idle.on_heartbeat(Shown(0, False, 3), 0.0)
    assert idle.on_heartbeat(Shown(5, False, 3), 1.0) is ModeChange.GROUND
    starting = guard_in(FlightMode.OFFBOARD, armed=False, stack=ARDUPILOT)
    assert starting.on_heartbeat(Shown(0, False, 3), 1.0) is ModeChange.TAKEN_OVER


def test_a_change_together_with_disarming_ends_the_flight():
    guard = guard_in(FlightMode.LAND)
    assert guard.on_heartbeat(Shown(px4(FlightMode.HOLD), False, 3), 1.0) is ModeChange.GROUND
    guard.check()


LENT = frozenset({FlightMode.OFFBOARD, FlightMode.HOLD, FlightMode.LAND})


def lent_guard(stack=PX4):
    """A companion has brought the vehicle into OFFBOARD."""
    guard = guard_in(FlightMode.HOLD, stack=stack)
    guard.lend(LENT)
    number = stack.custom_mode(FlightMode.OFFBOARD)
    assert guard.on_heartbeat(Shown(number, True, 4), 1.0) is ModeChange.COMMANDED
    return guard


@pytest.mark.parametrize("stack", [PX4, ARDUPILOT])
@pytest.mark.parametrize("mode", [FlightMode.HOLD, FlightMode.LAND])
@pytest.mark.parametrize("word_first", [False, True])
def test_by_its_word_a_companions_hold_is_its_own_and_a_pilots_is_not(stack, mode, word_first):
    for taken_over in (False, True):
        guard = lent_guard(stack)
        verdicts = []
        if word_first:
            verdicts.append(guard.let_go(taken_over=taken_over))
        verdicts.append(guard.on_heartbeat(Shown(stack.custom_mode(mode), True, 4), 2.0))
        if not word_first:
            assert verdicts == [ModeChange.UNDECIDED]
            with pytest.raises(RefusedError, match="not clear yet"):
                guard.check()
            verdicts.append(guard.let_go(taken_over=taken_over))
        verdicts += [guard.let_go(taken_over=taken_over), guard.on_time(99.0)]  # its word comes twice a second
        assert verdicts.count(ModeChange.TAKEN_OVER) == taken_over, "said once, or not at all"
        assert (guard.hands_off is not None) == taken_over


def test_without_a_word_of_the_companion_it_was_somebody_else():
    guard = lent_guard()
    assert guard.on_heartbeat(Shown(px4(FlightMode.HOLD), True, 4), 2.0) is ModeChange.UNDECIDED
    assert guard.on_time(2.0 + WORD_S - 0.1) is None
    assert guard.on_time(2.0 + WORD_S) is ModeChange.TAKEN_OVER
    assert "OFFBOARD" in guard.hands_off


def test_what_a_companion_never_commands_needs_no_word():
    guard = lent_guard()
    assert guard.on_heartbeat(Shown(POSCTL, True, 4), 2.0) is ModeChange.TAKEN_OVER
    assert guard.let_go(taken_over=True) is None


def test_an_old_word_does_not_count_for_a_new_lease():
    guard = lent_guard()
    guard.let_go(taken_over=False)
    guard.on_heartbeat(Shown(px4(FlightMode.HOLD), True, 4), 2.0)
    guard.lend(LENT)
    guard.on_heartbeat(Shown(px4(FlightMode.OFFBOARD), True, 4), 3.0)
    assert guard.on_heartbeat(Shown(px4(FlightMode.HOLD), True, 4), 4.0) is ModeChange.UNDECIDED
