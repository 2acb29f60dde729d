"""What a flight puts on its vehicle and reads from it: with proof, written down, and stopped on request in any step."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from gcs.core.clock import utc_now
from gcs.core.errors import GcsError, OperationCancelled, RefusedError
from gcs.mavlink.canonical_form import compare
from gcs.mavlink.mission_upload import UNKNOWN
from gcs.services.fence_rally import upload_lists
from gcs.services.fitted_upload import STOPPED_UPLOAD, remember_sampling, upload_fitted
from gcs.services.flight_recorder import NOTICE
from gcs.services.flight_run import IN_THE_AIR
from gcs.services.flight_types import OnVehicleMission
from gcs.services.mission_fitting import USUAL_SAMPLING, sampled_mission, sampling_of
from gcs.services.stoppable_work import StoppableWork
from gcs.storage.records import FlightPath, FlightState, UploadState

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine
    from contextlib import AbstractContextManager

    from gcs.core.mission import Mission
    from gcs.core.plan import Plan
    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.flight_checks import FlightChecks
    from gcs.services.flight_recorder import FlightRecorder
    from gcs.services.mission_fitting import FittedMission
    from gcs.services.plan_service import PlanService
    from gcs.services.vehicle_service import VehicleService
    from gcs.storage.database import Database
    from gcs.storage.records import FlightRecord

STOPPED_BEFORE = "the upload was cancelled before anything of the mission was sent"
STOPPED_LISTS = (
    "the upload of fence and rally points was cancelled; which of them the vehicle holds now is unknown: upload again"
)
STOPPED_READING = "reading from the vehicle was cancelled; its mission, fence and rally points are as they were"


class FlightTransfers:
    """Uploads and read-backs of all flights.

    Args:
        database: where uploads are written down.
        plans: the station's plans.
        vehicles: the station's vehicles.
        recorder: gives the pen of a flight.
        checks: makes the checks of a flight of a plan.
        spawn: runs work in the background until the station ends.
    """

    def __init__(
        self,
        database: Database,
        plans: PlanService,
        vehicles: VehicleService,
        recorder: Callable[[str], FlightRecorder],
        checks: Callable[[FlightRecord, Plan], FlightChecks],
        spawn: Callable[[Coroutine[None, None, None]], asyncio.Task[None]],
    ) -> None:
        self._database = database
        self._plans = plans
        self._vehicles = vehicles
        self._recorder = recorder
        self._checks = checks
        self._spawn = spawn
        self._work = StoppableWork()
        self._uploads: dict[str, asyncio.Task[None]] = {}
        self._failures: dict[str, GcsError] = {}

    async def upload(self, flight: FlightRecord, vehicle: Vehicle, plan: Plan, accepted: tuple[str, ...]) -> None:
        """Check, then begin to put the mission on the vehicle and prove it.

        Raises:
            RefusedError: a check failed.
            OperationCancelled: stopped during the checks.
        """
        recorder = self._recorder(flight.id)
        with self._work.of(flight.id, STOPPED_BEFORE):
            checks = self._checks(flight, plan)
            fitted = await checks.fitted(vehicle)
            (await checks.before_upload(vehicle, fitted, accepted)).demand()
        recorder.change(proved=False)
        recorder.enter(FlightState.UPLOADING, f"sending the mission, {fitted.sampling.words}")
        self._uploads[flight.id] = self._spawn(self._upload(recorder, vehicle, plan, fitted))

    async def wait(self, flight_id: str) -> None:
        """Wait until an upload has ended; raises what it failed of."""
        if flight_id in self._uploads:
            await asyncio.wait({self._uploads[flight_id]})
        if flight_id in self._failures:
            raise self._failures[flight_id]

    async def upload_lists(self, flight_id: str, vehicle: Vehicle, plan: Plan) -> None:
        """Put the scenario's fence and rally points alone on the vehicle, for a flight that needs no mission.

        Raises:
            OperationCancelled: stopped.
        """
        with self._work.of(flight_id, STOPPED_LISTS):
            entries = await upload_lists(plan, vehicle)
        for entry in entries:
            self._recorder(flight_id).notice(f"{entry.name}: {entry.how}")

    def reading(self, flight_id: str) -> AbstractContextManager[None]:
        """What is only read from the vehicle inside this block can be stopped like any transfer."""
        return self._work.of(flight_id, STOPPED_READING)

    async def cancel(self, flight_id: str) -> None:
        """Stop what is sent or read for a flight and tell the vehicle; returns when that is done and recorded.

        Raises:
            ConflictError: nothing is.
        """
        await self._work.stop(flight_id)
        self._recorder(flight_id).notice("the transfer was cancelled by the operator")

    def last_proved(self, flight_id: str) -> OnVehicleMission:
        """What the last upload proved; asks the vehicle nothing."""
        flight = self._database.flights.get(flight_id)
        upload = self._database.flights.latest_upload(flight_id)
        items = {} if upload is None else self._mission(flight).viewpoint_items
        return OnVehicleMission.last_proved(flight, upload, items)

    async def read_back(self, flight_id: str) -> OnVehicleMission:
        """Read the vehicle's mission now and compare it with the plan's.

        Raises:
            OperationCancelled: stopped.
        """
        flight = self._database.flights.get(flight_id)
        vehicle, mission = self._vehicles.vehicle(flight.vehicle), self._mission(flight)
        with self.reading(flight_id):
            items = await vehicle.download_mission()
        comparison = compare(mission.items, items, vehicle.identity.autopilot)
        recorder = self._recorder(flight_id)
        text = "equals the plan's mission" if comparison.equal else f"is not the plan's mission: {comparison.summary}"
        recorder.log("upload", f"read back: what the vehicle holds {text}", severity=NOTICE)
        upload = self._database.flights.latest_upload(flight_id)
        if upload is not None and flight.proved != comparison.equal:
            recorder.change(proved=comparison.equal)
        return OnVehicleMission(
            flight_id=flight_id,
            state="none" if upload is None else upload.state,
            read_at=utc_now(),
            how="read back item by item",
            equal=comparison.equal,
            differences=comparison.differences,
            canonical_crc32=comparison.canonical_crc32,
            items=items,
            viewpoint_items=mission.viewpoint_items,
        )

    async def demand_held(self, flight: FlightRecord) -> None:
        """Where the vehicle flies its mission, read it: only the plan's is started or gone on with.

        Raises:
            RefusedError: it holds another one.
        """
        if flight.mode is FlightPath.MISSION and not (await self.read_back(flight.id)).equal:
            if flight.state not in IN_THE_AIR:
                self._recorder(flight.id).enter(FlightState.UPLOAD_FAILED, "its mission changed after the upload")
            raise RefusedError(
                "it no longer holds the plan's mission: upload again on the ground", field=flight.vehicle
            )

    async def settle(self, flight: FlightRecord) -> None:
        """Find out what came of an upload during which the station ended."""
        recorder = self._recorder(flight.id)
        try:
            held = await self.read_back(flight.id)
        except GcsError as error:
            recorder.enter(FlightState.UPLOAD_FAILED, f"the station ended in mid-upload, and then {error}; {UNKNOWN}")
            return
        if held.equal:
            recorder.change(proved=True)
            recorder.enter(FlightState.UPLOADED, "the vehicle holds the whole mission, read back after the restart")
        else:
            why = "; ".join(held.differences[:3]) or held.problem or "it is another one"
            recorder.enter(FlightState.UPLOAD_FAILED, f"the vehicle does not hold the plan's mission: {why}")

    async def _upload(self, recorder: FlightRecorder, vehicle: Vehicle, plan: Plan, fitted: FittedMission) -> None:
        flight_id = recorder.flight_id
        upload = self._database.flights.begin_upload(flight_id, len(fitted.mission.items))
        remember_sampling(recorder, fitted)
        self._failures.pop(flight_id, None)

        class Told:
            def report(self, stage: str, fraction: float) -> None:
                recorder.upload_progress(stage, fraction)

        async def refit(most_items: int) -> FittedMission:
            coarser = await self._checks(recorder.flight, plan).fitted(vehicle, most_items)
            remember_sampling(recorder, coarser)
            return coarser

        def failed(why: str) -> None:
            self._database.flights.end_upload(upload.id, UploadState.FAILED, problem=why)
            recorder.enter(FlightState.UPLOAD_FAILED, why)

        try:
            with self._work.of(flight_id, STOPPED_UPLOAD):
                proof, _ = await upload_fitted(vehicle, fitted, refit, recorder.notice, Told())
            with self._work.of(flight_id, STOPPED_LISTS):
                lists = await upload_lists(plan, vehicle, Told())
        except GcsError as error:
            self._failures[flight_id] = error
            if not isinstance(error, OperationCancelled):  # that was wanted
                recorder.problem(f"upload failed: {error}")
            failed(str(error))
            return
        except asyncio.CancelledError:
            failed(f"the station was ended; {UNKNOWN}")
            raise
        how = "; ".join([proof.how, *(f"{entry.name}: {entry.how}" for entry in lists)])
        self._database.flights.end_upload(
            upload.id,
            UploadState.PROVED,
            items_read=proof.items_read,
            how=how,
            canonical_crc32=proof.canonical_crc32,
            items=proof.items,
        )
        recorder.change(proved=True)
        recorder.enter(FlightState.UPLOADED, f"proved: {how}")

    def _mission(self, flight: FlightRecord) -> Mission:
        autopilot = self._vehicles.vehicle(flight.vehicle).identity.autopilot
        return sampled_mission(self._plans.read(flight.plan_id), autopilot, sampling_of(flight) or USUAL_SAMPLING)
