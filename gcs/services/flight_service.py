"""Flights: what an operator may ask, checked, commanded, proved, and followed.

The API and `gcs fly` use the same service. Nothing here is a side effect of anything but an operator's request: at the
start of the station flights that are still open are followed again, and nothing is commanded.
"""

from __future__ import annotations

import asyncio
import logging
from dataclasses import replace
from typing import TYPE_CHECKING

from gcs.core.clock import new_id, utc_now
from gcs.core.errors import ConflictError, GcsError, LinkError
from gcs.mavlink.events import ListChangedEvent, VehicleFoundEvent
from gcs.services.changed_lists import note_changed_list
from gcs.services.flight_checks import FlightChecks
from gcs.services.flight_log import FlightLogs
from gcs.services.flight_observers import FlightObservers
from gcs.services.flight_recorder import ERROR, NOTICE, FlightRecorder
from gcs.services.flight_run import IN_THE_AIR, FlightRun
from gcs.services.flight_transfers import FlightTransfers
from gcs.services.flight_types import allowed_actions
from gcs.services.led_flights import LedFlights
from gcs.services.operator_commands import OneAtATime, require_confirmation
from gcs.services.resumed_plan import plan_from_here
from gcs.storage.records import FlightPath, FlightRecord, FlightState

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from gcs.core.plan import Plan
    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.flight_types import LeaseView, OnVehicleMission, PreflightReport
    from gcs.services.live_feed import LiveFeed
    from gcs.services.plan_service import PlanService
    from gcs.services.vehicle_service import VehicleService
    from gcs.storage.database import Database
    from gcs.storage.image_store import ImageStore
    from gcs.storage.telemetry_log import TelemetryLogStore

log = logging.getLogger(__name__)

PICTURES_BEFORE_RESUME_S = 20.0
"""A hovering vehicle waits no longer for its pictures; viewpoints whose picture is not here then are flown to again."""


class FlightControlService:
    """Implements `gcs.services.flight_types.FlightService`.

    Args:
        database: where flights are written down.
        store: where pictures are kept.
        telemetry_logs: where every packet of a flight is kept.
        feed: the dashboards.
        plans: the station's plans.
        vehicles: the station's vehicles.
    """

    def __init__(
        self,
        database: Database,
        store: ImageStore,
        telemetry_logs: TelemetryLogStore,
        feed: LiveFeed,
        plans: PlanService,
        vehicles: VehicleService,
    ) -> None:
        self._database = database
        self._store = store
        self._logs = FlightLogs(telemetry_logs)
        self._feed = feed
        self._plans = plans
        self._vehicles = vehicles
        self._runs: dict[str, FlightRun] = {}
        self._busy: set[str] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._failures: dict[str, GcsError] = {}
        self._observers = FlightObservers(vehicles)
        self._transfers = FlightTransfers(database, plans, vehicles, self._recorder, self._checks, self._spawn)
        self._led = LedFlights(database, self._spawn, self._not_begun)

    # ---- opening and closing the station ----

    async def open(self) -> None:
        """Follow the flights that are still open, as soon as their vehicles are heard; command nothing."""
        self._database.flights.mark_uploads_interrupted()
        flights = self._database.flights.open_flights()
        self._store.remove_parts(but_of={flight.id for flight in flights})
        for flight in flights:
            recorder = self._recorder(flight.id)
            if flight.state is FlightState.UPLOADING or flight.state in IN_THE_AIR:
                recorder.log("station", "the station was started again during this flight", severity=NOTICE)
                if flight.state in IN_THE_AIR:
                    recorder.enter(FlightState.UNKNOWN, "the station was started again; the vehicle is not heard yet")
        self._spawn(self._watch_for_vehicles())

    async def close(self) -> None:
        """Stop streams and following; vehicles go on under their own control."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await asyncio.gather(*(run.close() for run in self._runs.values()), return_exceptions=True)
        await self._logs.close()

    async def _watch_for_vehicles(self) -> None:
        async with self._vehicles.station.events() as heard:
            for vehicle in list(self._vehicles.station.vehicles.values()):
                self._spawn(self._take_up(vehicle))
            async for event in heard:
                vehicle_now = self._vehicles.station.vehicles.get(event.system_id)
                if isinstance(event.event, VehicleFoundEvent) and vehicle_now is not None:
                    self._spawn(self._take_up(vehicle_now))
                if isinstance(event.event, ListChangedEvent) and vehicle_now is not None:
                    for flight in self._database.flights.open_flights():
                        if flight.vehicle == vehicle_now.identity.name:
                            note_changed_list(self._recorder(flight.id), event.event.mission_type)

    async def _take_up(self, vehicle: Vehicle) -> None:
        """A vehicle is heard: say truthfully where its open flight stands."""
        for flight in self._database.flights.open_flights():
            if flight.vehicle != vehicle.identity.name or flight.id in self._runs:
                continue
            try:
                if flight.state is FlightState.UPLOADING:
                    await self._transfers.settle(flight)
                elif flight.state in IN_THE_AIR:
                    run = self._follow(flight, vehicle, airborne=True)
                    run.show_mode()
                    if flight.observer is not None:
                        self._spawn(self._observers.take_up(run, flight.observer))
                    if flight.mode is FlightPath.MISSION:
                        await self.read_back(flight.id)
                    elif flight.mode is FlightPath.COMPANION:
                        self._led.rejoin(run, flight.plan_hash)
            except GcsError as error:
                self._recorder(flight.id).log("station", str(error), severity=ERROR)

    # ---- what operators ask ----

    async def create(self, plan_id: str, vehicle: str, mode: FlightPath | None) -> FlightRecord:
        """Prepare a flight; without a mode one is chosen by the prediction. Nothing is changed on the vehicle."""
        identity = self._vehicles.vehicle(vehicle).identity
        plan, record = self._plans.read(plan_id), self._plans.get(plan_id).plan
        if plan.sorties:
            raise ConflictError(
                f"this plan is {len(plan.sorties)} sorties with a battery each; they are plans of their own: fly those",
                field="plan_id",
            )
        for other in self._database.flights.open_flights():
            if other.vehicle == identity.name and (other.state in IN_THE_AIR or other.state is FlightState.UPLOADING):
                raise ConflictError(f"{identity.name} is on flight {other.id}, which is {other.state}", field="vehicle")
            if other.vehicle == identity.name:
                self._recorder(other.id).enter(FlightState.ABORTED, "another flight of the same vehicle was prepared")
        now = utc_now()
        flight = FlightRecord(
            id=new_id("flight"),
            plan_id=plan_id,
            plan_hash=record.plan_hash or "",
            vehicle=identity.name,
            system_id=identity.system_id,
            mode=mode or FlightPath.MISSION,
            state=FlightState.CREATED,
            created_at=now,
            updated_at=now,
            viewpoints=len(plan.viewpoints),
        )
        why = ""
        if mode is None:
            found = (await self._checks(flight, plan).fitted(self._vehicles.vehicle(vehicle))).prediction
            if found is not None:
                flight = replace(flight, mode=FlightPath(found.choice))
                why = f": {found.why}, predicted with {found.basis}"
        self._database.flights.add(flight)
        self._recorder(flight.id).log("state", f"prepared for {identity.name}, {flight.mode}{why}", severity=NOTICE)
        return flight

    def lease(self, flight_id: str) -> LeaseView | None:
        """Where the lease of the companion that flies it stands; None when none was heard since the start."""
        run = self._runs.get(flight_id)
        return None if run is None or run.companion is None else run.companion.view

    async def preflight(self, flight_id: str) -> PreflightReport:
        """Read the vehicle's limits, failsafes and references, and compare them with the plan."""
        flight, vehicle, plan = self._loaded(flight_id)
        with self._transfers.reading(flight_id):
            return await self._checks(flight, plan).report(vehicle, flight.accepted_failsafes)

    async def upload(self, flight_id: str, *, confirm: str | None, accept: tuple[str, ...]) -> FlightRecord:
        """Check, then begin to put the mission on the vehicle and prove it."""
        flight, vehicle, plan = self._loaded(flight_id)
        self._demand(flight, "upload")
        if confirm is not None:
            require_confirmation(vehicle, confirm)
        recorder = self._recorder(flight_id)
        async with OneAtATime(self._busy, flight_id):
            await self._transfers.upload(flight, vehicle, plan, self._accept(recorder, flight, accept))
        return recorder.flight

    async def on_vehicle(self, flight_id: str) -> OnVehicleMission:
        """What the last upload proved; asks the vehicle nothing."""
        return self._transfers.last_proved(flight_id)

    async def read_back(self, flight_id: str) -> OnVehicleMission:
        """Read the vehicle's mission now and compare it with the plan's."""
        return await self._transfers.read_back(flight_id)

    async def cancel_transfer(self, flight_id: str) -> FlightRecord:
        """Stop what is sent to the vehicle or read from it before a start, and tell the vehicle."""
        flight = self._database.flights.get(flight_id)
        await self._transfers.cancel(flight.id)
        return self._database.flights.get(flight_id)

    async def start(
        self, flight_id: str, *, confirm: str, accept: tuple[str, ...], observer: str | None = None
    ) -> FlightRecord:
        """Check, arm, take off and fly; the confirmation names the vehicle."""
        flight, vehicle, plan = self._loaded(flight_id)
        self._demand(flight, "start")
        require_confirmation(vehicle, confirm)
        self._failures.pop(flight_id, None)
        recorder = self._recorder(flight_id)
        async with OneAtATime(self._busy, flight_id):
            accepted = self._accept(recorder, flight, accept)
            checks = self._checks(flight, plan)
            with self._transfers.reading(flight_id):
                report = await checks.before_start(vehicle, accepted)
            report.demand()
            sighted = observer and await self._observers.checked(observer, flight.vehicle, recorder)
            await self._transfers.demand_held(flight)
            if flight.mode is not FlightPath.MISSION:
                await self._transfers.upload_lists(flight_id, vehicle, plan)
            await vehicle.announce_plan(flight.plan_hash)
            run = self._follow(flight, vehicle)
            if observer and sighted:
                self._observers.begin(run, observer, sighted)
            await run.collector.remember_earlier()
            recorder.log("command", f"start confirmed for {confirm}", severity=NOTICE)
            if flight.mode is FlightPath.COMPANION:
                recorder.change(started_at=utc_now())
                self._led.lend(run, flight.plan_hash)
                return recorder.flight
            if flight.mode is FlightPath.OFFBOARD:
                warp = await checks.stream_loss_warp(vehicle)
                recorder.change(started_at=utc_now())
                self._led.stream(run, plan, warp)
                return recorder.flight
            try:
                await vehicle.start_mission()
            except GcsError:
                await self._drop(flight_id)
                raise
            recorder.change(started_at=utc_now())
            recorder.enter(FlightState.FLYING, "the vehicle is armed and flies its mission")
        return recorder.flight

    async def resume(self, flight_id: str, *, confirm: str, accept: tuple[str, ...]) -> FlightRecord:
        """Go on from where the vehicle is; the confirmation names the vehicle."""
        flight, vehicle, plan = self._loaded(flight_id)
        self._demand(flight, "resume")
        require_confirmation(vehicle, confirm)
        run, recorder = self._run(flight_id), self._recorder(flight_id)
        async with OneAtATime(self._busy, flight_id):
            accepted = self._accept(recorder, flight, accept)
            recorder.log("command", f"resume confirmed for {confirm}", severity=NOTICE)
            await self._transfers.demand_held(flight)
            if vehicle.pilot_in_control:
                vehicle.take_back(confirm)
            run.cut_short = None
            if flight.mode is FlightPath.MISSION:
                await vehicle.resume_mission()
                recorder.enter(FlightState.FLYING, "the mission goes on")
            elif run.companion is not None and run.companion.streaming:
                await run.companion.resume()
                recorder.enter(FlightState.FLYING, "the companion goes on")
            elif flight.mode is FlightPath.COMPANION:
                self._led.lend(run, flight.plan_hash)
            elif run.offboard is not None and run.offboard.streaming:
                run.offboard.resume()
                recorder.enter(FlightState.FLYING, "the stream goes on")
            else:
                account = await run.collector.so_far(PICTURES_BEFORE_RESUME_S)
                rest = await plan_from_here(plan, self._plans.directory(flight.plan_id), vehicle, account.pictured)
                recorder.log("state", f"new way from here: {rest.certificates.length_m:.0f} m", severity=NOTICE)
                checks = self._checks(flight, rest)
                (await checks.in_the_air(vehicle, accepted)).demand()
                warp = await checks.stream_loss_warp(vehicle)
                run.tracker.follow(rest.trajectory)
                self._led.stream(run, rest, warp)
        return recorder.flight

    async def pause(self, flight_id: str) -> FlightRecord:
        """Hold where it is."""
        flight, vehicle, _ = self._loaded(flight_id)
        self._demand(flight, "pause")
        run, recorder = self._run(flight_id), self._recorder(flight_id)
        recorder.log("command", "pause", severity=NOTICE)
        if run.companion is not None and run.companion.streaming and flight.state is FlightState.FLYING:
            await run.companion.pause()
        elif run.offboard is not None and run.offboard.streaming and flight.state is FlightState.FLYING:
            run.offboard.pause()
        else:
            await vehicle.pause()
        recorder.enter(FlightState.PAUSED, "on command")
        return recorder.flight

    async def return_home(self, flight_id: str) -> FlightRecord:
        """Let the vehicle fly its own return."""
        return await self._cut_short(flight_id, "return", FlightState.RETURNING)

    async def land(self, flight_id: str) -> FlightRecord:
        """Let the vehicle land where it is."""
        return await self._cut_short(flight_id, "land", FlightState.LANDING)

    async def wait(self, flight_id: str) -> FlightRecord:
        """Wait until a started flight is over; raises why it did not leave the ground."""
        if flight_id not in self._failures:
            await self._run(flight_id).over.wait()
        if flight_id in self._failures:
            raise self._failures[flight_id]
        return self._database.flights.get(flight_id)

    async def wait_for_upload(self, flight_id: str) -> FlightRecord:
        """Wait until an upload has ended; raises what it failed of."""
        await self._transfers.wait(flight_id)
        return self._database.flights.get(flight_id)

    # ---- inside ----

    async def _cut_short(self, flight_id: str, action: str, state: FlightState) -> FlightRecord:
        flight, vehicle, plan = self._loaded(flight_id)
        self._demand(flight, action)
        run, recorder = self._run(flight_id), self._recorder(flight_id)
        recorder.log("command", action, severity=NOTICE)
        run.cut_short = f"the operator asked to {action}"
        how = "on command"
        if state is FlightState.LANDING:
            await vehicle.land()
        elif await self._checks(flight, plan).return_is_clear_now(vehicle):
            await vehicle.return_home()
        else:
            await vehicle.retrace()
            how = "on command, the way it came: its own return would hit the structure from here"
        recorder.enter(state, how)
        return recorder.flight

    async def _not_begun(self, run: FlightRun, error: GcsError) -> None:
        self._failures[run.recorder.flight_id] = error
        run.recorder.enter(FlightState.ABORTED, str(error))
        run.over.set()
        await self._drop(run.recorder.flight_id)

    def _follow(self, flight: FlightRecord, vehicle: Vehicle, *, airborne: bool = False) -> FlightRun:
        run = FlightRun(self._plans.read(flight.plan_id), vehicle, self._recorder(flight.id))
        self._runs[flight.id] = run
        self._vehicles.set_flight(flight.system_id, flight.id)
        self._logs.begin(run)
        run.start(airborne=airborne)
        return run

    async def _drop(self, flight_id: str) -> None:
        """Stop following a flight that did not leave the ground."""
        run = self._runs.pop(flight_id, None)
        if run is not None:
            self._vehicles.set_flight(run.vehicle.identity.system_id, None)
            await run.close()
            await self._logs.end(flight_id)

    def _run(self, flight_id: str) -> FlightRun:
        run = self._runs.get(flight_id)
        if run is None:
            raise LinkError(
                "the vehicle of this flight has not been heard since the station was started", field=flight_id
            )
        return run

    def _recorder(self, flight_id: str) -> FlightRecorder:
        run = self._runs.get(flight_id)
        return run.recorder if run else FlightRecorder(flight_id, self._database, self._store, self._feed)

    def _loaded(self, flight_id: str) -> tuple[FlightRecord, Vehicle, Plan]:
        flight = self._database.flights.get(flight_id)
        return flight, self._vehicles.vehicle(flight.vehicle), self._plans.read(flight.plan_id)

    def _checks(self, flight: FlightRecord, plan: Plan) -> FlightChecks:
        recorder = self._recorder(flight.id)
        return FlightChecks(
            flight,
            plan,
            self._plans.directory(flight.plan_id),
            self._database.dynamics.of(flight.vehicle),
            recorder.notice,
        )

    def _accept(self, recorder: FlightRecorder, flight: FlightRecord, names: tuple[str, ...]) -> tuple[str, ...]:
        accepted = tuple(dict.fromkeys((*flight.accepted_failsafes, *names)))
        if accepted != flight.accepted_failsafes:
            recorder.change(accepted_failsafes=accepted)
            recorder.log("command", f"accepted by the operator: {', '.join(names)}", severity=NOTICE)
        return accepted

    def _demand(self, flight: FlightRecord, action: str) -> None:
        if action not in allowed_actions(flight.state, flight.mode):
            raise ConflictError(f"cannot {action} a flight that is {flight.state}", field=flight.id)

    def _spawn(self, work: Coroutine[None, None, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task
