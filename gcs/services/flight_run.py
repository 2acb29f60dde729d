"""One flight being followed: what its vehicle tells is written down, up to the account at the end.

Following commands nothing. What operators ask for is in `flight_service`; it shares this object.
"""

from __future__ import annotations

import asyncio
import logging
import time
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import GcsError
from gcs.core.vehicle import FlightMode, LandedState
from gcs.mavlink import events
from gcs.services.flight_recorder import ERROR, NOTICE, WARNING
from gcs.services.flight_tracker import FlightTracker
from gcs.services.image_account import MISSING, NOT_REACHED, count_pictures_as_visits, scene_position
from gcs.services.image_collector import ImageCollector
from gcs.storage.records import FlightPath, FlightState

if TYPE_CHECKING:
    from gcs.core.plan import Plan
    from gcs.core.vehicle import Telemetry
    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.companion_flight import CompanionFlight
    from gcs.services.flight_recorder import FlightRecorder
    from gcs.services.offboard_flight import OffboardFlight
    from gcs.services.sighted_flight import SightedFlight

log = logging.getLogger(__name__)

BY_MODE = {
    FlightMode.MISSION: FlightState.FLYING,
    FlightMode.OFFBOARD: FlightState.FLYING,
    FlightMode.TAKEOFF: FlightState.FLYING,
    FlightMode.HOLD: FlightState.PAUSED,
    FlightMode.RETURN: FlightState.RETURNING,
    FlightMode.LAND: FlightState.LANDING,
}
"""What an armed vehicle's mode says of the flight, unless the station knows better."""

IN_THE_AIR = frozenset(
    {
        FlightState.ARMED,
        FlightState.FLYING,
        FlightState.PAUSED,
        FlightState.HELD,
        FlightState.RETURNING,
        FlightState.LANDING,
        FlightState.UNKNOWN,
    }
)


class FlightRun:
    """Follows one vehicle on one flight.

    Args:
        plan: what is flown.
        vehicle: who flies.
        recorder: where it is written down.
    """

    def __init__(self, plan: Plan, vehicle: Vehicle, recorder: FlightRecorder) -> None:
        self.plan = plan
        self.vehicle = vehicle
        self.recorder = recorder
        visits = {v.viewpoint_id: v.miss_m or 0.0 for v in recorder.database.flights.visits(recorder.flight_id)}
        self.tracker = FlightTracker(plan, visits)
        self.collector = ImageCollector(plan, vehicle, recorder)
        self.offboard: OffboardFlight | None = None
        self.companion: CompanionFlight | None = None
        self.cut_short: str | None = None
        """Why the plan was not flown to its end, when somebody decided so."""
        self.down = asyncio.Event()
        """Set when it was in the air and is disarmed again."""
        self.over = asyncio.Event()
        self._names = {v.id: v.name for v in plan.viewpoints}
        self._was_airborne = False
        self._tasks: list[asyncio.Task[None]] = []
        self._ending: asyncio.Task[None] | None = None

    def start(self, *, airborne: bool = False) -> None:
        """Begin to follow.

        Args:
            airborne: the flight was in the air before (a restart of the station).
        """
        self._was_airborne = airborne
        self._tasks = [
            asyncio.create_task(self._follow(), name=f"follow {self.recorder.flight_id}"),
            asyncio.create_task(self.collector.run(), name=f"images of {self.recorder.flight_id}"),
        ]

    def position_by(self, sighted: SightedFlight) -> None:
        """Tell the vehicle what another one sees of it, where it has no position fix, until it is down."""

        async def position() -> None:
            looking = asyncio.ensure_future(sighted.run())
            landed = asyncio.ensure_future(self.down.wait())
            try:
                await asyncio.wait({looking, landed}, return_when=asyncio.FIRST_COMPLETED)
                if looking.done():
                    self.recorder.problem(f"no positions are told any more: {looking.exception()}")
            finally:
                looking.cancel()
                landed.cancel()

        self._tasks.append(asyncio.create_task(position(), name=f"position of {self.vehicle.identity.name}"))

    async def close(self) -> None:
        """Stop following; the vehicle goes on under its own control."""
        tasks = [*self._tasks, *([self._ending] if self._ending else [])]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self.recorder.flush()

    def end_soon(self) -> None:
        """The vehicle is down: settle the account, once."""
        self.down.set()
        if self._ending is None:
            self._ending = asyncio.create_task(self._end(), name=f"end of {self.recorder.flight_id}")

    async def _follow(self) -> None:
        async with self.vehicle.events() as heard:
            armed = self.vehicle.telemetry.armed
            if self._was_airborne and armed is not None and not armed.value:
                self.end_soon()
            async for event in heard:
                try:
                    self._take(event)
                except GcsError:  # the record could not be written: said, and the flight is followed on
                    log.exception("flight %s: not recorded", self.recorder.flight_id)

    def _take(self, event: events.VehicleEvent) -> None:
        recorder = self.recorder
        match event:
            case events.TelemetryEvent(telemetry):
                self._take_telemetry(telemetry)
            case events.StatusTextEvent(status):
                recorder.log("message", status.text, severity=status.severity)
            case events.ModeEvent(mode, name, commanded):
                recorder.log("mode", f"{name}{'' if commanded else ' (not commanded by the station)'}", severity=NOTICE)
                self._take_mode(mode, commanded)
            case events.ArmedEvent(armed):
                recorder.log("mode", "armed" if armed else "disarmed", severity=NOTICE)
                if not armed and self._was_airborne:
                    self.end_soon()
            case events.CommandProgressEvent(command, share):
                done = "" if share is None else f", {share:.0%} done"
                recorder.log("command", f"the vehicle is at work on {command}{done}", severity=NOTICE)
            case events.ImageEvent(image):
                self.collector.take(image)
            case events.LinkLostEvent(silent_s):
                recorder.log("link", f"no heartbeat for {silent_s:.0f} s", severity=ERROR)
                if recorder.flight.state in IN_THE_AIR:
                    recorder.enter(FlightState.UNKNOWN, "the vehicle is not heard")
            case events.LinkBackEvent(silent_s):
                recorder.log("link", f"heard again after {silent_s:.0f} s", severity=NOTICE)
                self.show_mode()
            case events.PilotTookOverEvent(reason):
                self._taken_over(reason)
            case events.LeaseEvent(status) if self.companion is not None:
                self.companion.hear(status)
            case events.OffboardEndedEvent(_, end, detail):
                recorder.log("offboard", f"no more setpoints: {detail}", severity=NOTICE, end=end.name.lower())
            case _:
                pass

    def _taken_over(self, reason: str) -> None:
        recorder, mode = self.recorder, self.vehicle.telemetry.mode
        if self.companion is not None:
            self.companion.taken_over()
        recorder.log("problem", f"the station keeps its hands off: {reason}", severity=ERROR)
        if recorder.flight.state not in IN_THE_AIR:
            return
        self.cut_short = self.cut_short or reason
        if mode is None or mode.value not in {FlightMode.RETURN, FlightMode.LAND}:
            recorder.enter(FlightState.HELD, "somebody else has the vehicle")

    def show_mode(self) -> None:
        """Let the flight's state follow from what the vehicle shows now, after a gap or a restart."""
        telemetry, flight = self.vehicle.telemetry, self.recorder.flight
        if flight.state not in IN_THE_AIR or telemetry.armed is None or telemetry.mode is None:
            return
        if not telemetry.armed.value:
            self.end_soon()
            return
        mode = telemetry.mode.value
        name = telemetry.mode_name.value if telemetry.mode_name else mode.value
        streaming = any(leader is not None and leader.streaming for leader in (self.offboard, self.companion))
        if flight.mode.by_setpoints and not streaming and mode not in {FlightMode.RETURN, FlightMode.LAND}:
            self.recorder.enter(FlightState.HELD, f"no setpoints are sent; the vehicle is in {name}")
        else:
            self.recorder.enter(BY_MODE.get(mode, FlightState.HELD), f"the vehicle is in {name}")

    def _take_telemetry(self, telemetry: Telemetry) -> None:
        armed, landed, place = telemetry.armed, telemetry.landed, telemetry.position
        if armed is None or not armed.value:
            return
        if landed is not None and landed.value in {LandedState.IN_AIR, LandedState.TAKING_OFF}:
            self._was_airborne = True
        if place is None or place.age_s(time.monotonic()) > 1.0:
            return
        position = scene_position(self.plan, place.value)
        if position is None or not self._was_airborne:
            return
        seen = self.tracker.observe(np.asarray(position))
        self.recorder.track(position, seen.cross_track_m)
        for viewpoint, miss in seen.visits.items():
            self.recorder.visit(viewpoint, self._names[viewpoint], miss)

    def _take_mode(self, mode: FlightMode, commanded: bool) -> None:
        flight = self.recorder.flight
        if flight.state not in IN_THE_AIR:
            return
        by_itself = not commanded and flight.mode is not FlightPath.COMPANION  # it may be its companion's command
        if mode in {FlightMode.RETURN, FlightMode.LAND} and by_itself:
            at_end = len(self.tracker.visits) == len(self.plan.viewpoints)
            if not at_end and self.cut_short is None:
                self.cut_short = f"the vehicle went into {mode.value} by itself"
        if mode in {FlightMode.RETURN, FlightMode.LAND}:
            self.recorder.enter(BY_MODE[mode], "the vehicle says so")
        elif mode is FlightMode.MISSION and flight.mode is FlightPath.MISSION:
            self.recorder.enter(FlightState.FLYING, "the vehicle flies its mission")

    async def _end(self) -> None:
        recorder = self.recorder
        recorder.flush()
        recorder.log("state", "on the ground; bringing the remaining images", severity=NOTICE)
        try:
            account = await self.collector.finish()
        except GcsError as error:
            recorder.problem(f"the images could not be accounted for: {error}")
            recorder.enter(FlightState.INCOMPLETE, "the images could not be accounted for")
            self.over.set()
            return
        count_pictures_as_visits(account, self.plan, recorder)
        visited = {v.viewpoint_id for v in recorder.database.flights.visits(recorder.flight_id)}
        missed = [v.name for v in self.plan.viewpoints if v.id not in visited]
        if missed:
            recorder.problem(f"{len(missed)} {NOT_REACHED}: {_few(missed)}")
        if account.missing:
            recorder.problem(f"{len(account.missing)} {MISSING}: {_few(account.missing)}")
        if account.unmatched:
            text = f"{account.unmatched} pictures belong to no viewpoint; they are kept"
            recorder.log("image", text, severity=WARNING)
        track = recorder.database.flights.track(recorder.flight_id)
        recorder.change(max_cross_track_m=max((p.cross_track_m or 0.0 for p in track), default=None))
        whole = not missed and account.complete
        if whole:
            recorder.enter(FlightState.COMPLETED, f"{account.received} of {account.expected} images are here")
        elif self.cut_short is not None:
            recorder.problem(self.cut_short)
            recorder.enter(FlightState.ABORTED, self.cut_short)
        else:
            recorder.enter(FlightState.INCOMPLETE, f"{account.received} of {account.expected} images are here")
        recorder.remove_image_parts()
        self.over.set()


def _few(names: list[str] | tuple[str, ...]) -> str:
    return ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
