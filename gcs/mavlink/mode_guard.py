"""The pilot comes first: which mode changes are the station's, which the autopilot's, and which are neither.

The rule, for every heartbeat of the autopilot whose mode number differs from the one before:

1. It is the mode of a command that this station sent within `COMMAND_WINDOW_S`, or in answer to which the autopilot
   is known to change to it, and the command has neither been fulfilled nor refused before: *commanded*.
2. The vehicle is disarmed, and the station has not put it into its mode within the last `CLAIM_S`: nobody flies; just
   a change.
3. The vehicle disarmed together with the change: the flight is over; just a change.
4. The flight stack names it as a regular successor (`FlightStack.own_successors`: take-off ends in hold or mission,
   return in hold or landing, a mission *at its last item* in hold, return or landing): the autopilot's *own*.
5. MISSION to HOLD, RETURN or LAND, while the last item was not heard to be current: the news of the item may be late
   or lost, so the verdict waits `VERDICT_S` for it. Until then no command is permitted. Nothing is streamed in MISSION.
6. The vehicle is lent to its companion, and the mode is one that the companion commands: *commanded*, by it. Where the
   vehicle leaves OFFBOARD for such a mode, the pilot may have chosen it too: the verdict waits `WORD_S` for the word of
   the companion, and without any it was somebody else.
7. Anything else: somebody took over, be it the pilot's switch or sticks or the vehicle's own failsafe, which cannot
   be told apart for sure. `hands_off` is then set, and stays set through landing, reconnects and new flights, until an
   operator takes the vehicle back by its name.

A vehicle that is armed in a manual mode when it is first heard is the pilot's as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from gcs.core.errors import RefusedError
from gcs.core.vehicle import FlightMode, MissionProgress
from gcs.mavlink.autopilots.base import FlightStack

COMMAND_WINDOW_S = 6.0
CLAIM_S = 30.0
VERDICT_S = 2.0
WORD_S = 4.0
"""A companion tells its state twice a second: several of them may be lost."""
_MISSION_ENDS = frozenset({FlightMode.HOLD, FlightMode.RETURN, FlightMode.LAND})
_CRITICAL = 5


class ModeChange(Enum):
    """What a change of mode is taken for."""

    COMMANDED = auto()
    OWN = auto()
    GROUND = auto()
    UNDECIDED = auto()
    TAKEN_OVER = auto()


@dataclass(frozen=True)
class Shown:
    """What a heartbeat shows."""

    custom_mode: int
    armed: bool
    system_status: int


class ModeGuard:
    """Watches heartbeats and commands of one vehicle.

    Attributes:
        hands_off: why the station keeps its hands off; None while it may command.
    """

    def __init__(self, stack: FlightStack) -> None:
        self._stack = stack
        self._shown: Shown | None = None
        self._commanded: dict[int, float] = {}
        self._claimed_until = float("-inf")
        self._mission: MissionProgress | None = None
        self._undecided: tuple[float, str] | None = None
        self._lent: frozenset[FlightMode] = frozenset()
        self._let_go = False
        self.hands_off: str | None = None

    def lend(self, modes: frozenset[FlightMode]) -> None:
        """From now on a companion commands these modes; none takes the vehicle back from it."""
        self._lent, self._let_go = modes, False

    def let_go(self, *, taken_over: bool) -> ModeChange | None:
        """The companion says that it leads no more; it may settle an open verdict.

        Args:
            taken_over: by its word somebody else has the vehicle; else it commanded the mode that it leaves it in.
        """
        if not self._lent or self._let_go:
            return None
        if not taken_over:
            self._let_go, self._undecided = True, None
            return None
        self._lent = frozenset()
        return self._settle()

    def command_mode(self, custom_mode: int, now_s: float) -> None:
        """The station is about to ask for a mode, or for something that brings it.

        Raises:
            RefusedError: the vehicle is not the station's to command.
        """
        self.check()
        self._commanded[custom_mode] = now_s + COMMAND_WINDOW_S
        if self._shown is not None and self._shown.custom_mode == custom_mode:
            self._claimed_until = now_s + CLAIM_S

    def check(self) -> None:
        """Refuse to command while somebody else has the vehicle.

        Raises:
            RefusedError: the vehicle is not the station's to command.
        """
        if self.hands_off is not None:
            raise RefusedError(f"{self.hands_off}; take the vehicle back by its name before commanding it")
        if self._undecided is not None:
            raise RefusedError(f"{self._undecided[1]}, and it is not clear yet why; try again in two seconds")

    def take_back(self) -> None:
        """An operator explicitly has the station command the vehicle again."""
        self.hands_off = None
        self._undecided = None
        self._claimed_until = float("-inf")

    def withdraw(self, custom_mode: int) -> None:
        """A mode command has been fulfilled or refused: a later change to that mode is not ours."""
        self._commanded.pop(custom_mode, None)

    def on_heartbeat(self, shown: Shown, now_s: float) -> ModeChange | None:
        """Take what a heartbeat shows; None when the mode is the same as before."""
        before, self._shown = self._shown, shown
        self._commanded = {mode: until for mode, until in self._commanded.items() if until > now_s}
        if before is None:
            mode, name = self._stack.flight_mode(shown.custom_mode)
            if shown.armed and mode is FlightMode.MANUAL:
                self.hands_off = f"a pilot flies the vehicle in {name}"
            return None
        if before.armed and not shown.armed:
            self._claimed_until = float("-inf")
        if shown.custom_mode == before.custom_mode:
            return None
        change = self._judge(before, shown, now_s)
        if change is ModeChange.COMMANDED:
            self._commanded.pop(shown.custom_mode, None)
            self._claimed_until, self._undecided = now_s + CLAIM_S, None
        return change

    def on_mission(self, mission: MissionProgress) -> ModeChange | None:
        """Take MISSION_CURRENT; it may settle an open verdict."""
        self._mission = mission
        if self._undecided is not None and self._stack.at_last_item(mission):
            self._undecided = None
            return ModeChange.OWN
        return None

    def on_time(self, now_s: float) -> ModeChange | None:
        """Settle an open verdict whose time is over."""
        return self._settle() if self._undecided is not None and now_s >= self._undecided[0] else None

    def _settle(self) -> ModeChange | None:
        """It was somebody else."""
        if self._undecided is None:
            return None
        self.hands_off, self._undecided = self._undecided[1], None
        return ModeChange.TAKEN_OVER

    def _judge(self, before: Shown, shown: Shown, now_s: float) -> ModeChange:
        if shown.custom_mode in self._commanded:
            return ModeChange.COMMANDED
        if not shown.armed and (before.armed or now_s > self._claimed_until):
            return ModeChange.GROUND
        old, old_name = self._stack.flight_mode(before.custom_mode)
        new, new_name = self._stack.flight_mode(shown.custom_mode)
        asks_companion = old is FlightMode.OFFBOARD and not self._let_go
        if new in self._lent and not asks_companion:
            return ModeChange.COMMANDED
        if new in self._stack.own_successors(old, self._mission):
            return ModeChange.OWN
        who = "the pilot, or the vehicle itself,"
        if shown.system_status >= _CRITICAL:
            who = "the vehicle's failsafe, or the pilot,"
        reason = f"{who} changed the mode from {old_name} to {new_name}"
        if new in self._lent:
            self._undecided = (now_s + WORD_S, reason)
            return ModeChange.UNDECIDED
        if old is FlightMode.MISSION and new in _MISSION_ENDS and shown.system_status < _CRITICAL:
            self._undecided = (now_s + VERDICT_S, reason)
            return ModeChange.UNDECIDED
        self.hands_off, self._undecided = reason, None
        return ModeChange.TAKEN_OVER
