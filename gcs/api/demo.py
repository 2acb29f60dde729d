"""`gcs demo`: the main job from nothing, on the sample crane, with a simulated vehicle of its own.

It listens only to the vehicle that it started itself: on a port that it takes anew, to one system id, and it flies
nothing that does not report the hardware id it gave (safety rule 2).
"""

from __future__ import annotations

import asyncio
import secrets
import time
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

from gcs.api.server import run_station
from gcs.api.settings import StationSettings
from gcs.core.errors import GcsError, IncompleteError, InfeasibleError, LinkError, RefusedError
from gcs.mavlink.station import MavlinkStation
from gcs.services.simulation import Simulator, SimulatorOptions
from gcs.services.simulation_scene import SAMPLE, scene_options
from gcs.services.station import StationServices
from gcs.storage.data_directory import default_data_directory
from gcs.storage.mesh_files import sample_scenario
from gcs.storage.records import FlightPath, FlightState, PlanState

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from gcs.mavlink.vehicle import Vehicle
    from gcs.storage.records import FlightRecord

SYSTEM_ID = 201
VEHICLE_TIMEOUT_S = 30.0


class Demo:
    """One run of the main job.

    Args:
        speedup: how much faster than real time the simulated vehicle flies.
        autopilot: whose behaviour it shows.
        link: URL to listen on for it; port 0 takes any free one.
        say: takes lines for the person at the terminal.
    """

    def __init__(
        self, *, speedup: float, autopilot: str, say: Callable[[str], None], link: str = "udpin:127.0.0.1:0"
    ) -> None:
        self._speedup = speedup
        self._autopilot = autopilot
        self._say = say
        self._link = link
        self._started = time.monotonic()
        self.done = False
        """Whether every stage worked."""

    async def run(self, services: StationServices, url: str) -> None:
        """Plan, upload, fly and account for the images.

        Args:
            services: of the running station.
            url: of its dashboard.

        Raises:
            GcsError: a stage did not work; which and why.
        """
        self._tell(f"the station is up: {url}")
        plan_id = await self._plan(services)
        directory = services.plans.directory(plan_id)
        bound = await services.vehicles.station.open(self._link)
        options = SimulatorOptions(
            autopilot=self._autopilot,
            speedup=self._speedup,
            port=int(bound.rsplit(":", 1)[1]),
            uid=secrets.token_hex(7) + "01",  # an id is padded with zeros on its way, which cannot be told from its own
            extra=("--first-system-id", str(SYSTEM_ID), "--tcp-base", "none"),
        )
        with ExitStack() as stack:
            placed = stack.enter_context(scene_options(options, directory))
            await asyncio.to_thread(stack.enter_context, Simulator(placed))
            vehicle = await self._own_vehicle(services, options)
            flight = await self._fly(services, plan_id, vehicle)
            self._account(services, flight)
        self.done = True

    async def _plan(self, services: StationServices) -> str:
        self._tell("planning the sample gantry crane")
        plan_id = (await services.plans.submit(sample_scenario(SAMPLE))).plan.id
        view = await services.plans.wait(plan_id)
        if view.plan.state is not PlanState.READY or view.plan.report is None:
            why = view.plan.failure.message if view.plan.failure else view.plan.state
            raise InfeasibleError(f"the sample could not be planned: {why}")
        r = view.plan.report
        self._tell(
            f"planned: {r['viewpoints']} viewpoints, {r['length_m']:.0f} m in {r['duration_s']:.0f} s, "
            f"hull clearance {r['min_clearance_m']:.2f} m, {r['energy_wh']:.0f} Wh"
        )
        return plan_id

    async def _own_vehicle(self, services: StationServices, options: SimulatorOptions) -> Vehicle:
        """The vehicle that this demo started, and no other."""
        station = services.vehicles.station
        vehicle = await station.wait_for_vehicle(VEHICLE_TIMEOUT_S, SYSTEM_ID)
        station.keep_to(vehicle)
        await vehicle.until(lambda: vehicle.uid is not None, VEHICLE_TIMEOUT_S, "its hardware id")
        if options.uid is None or options.uid not in str(vehicle.uid):
            raise RefusedError(
                "this is not the simulated vehicle of the demo: it is left alone; keep it off this machine's ports",
                field=vehicle.identity.name,
            )
        with suppress(GcsError):  # what is missing is said by the checks before the flight
            await vehicle.request_position_references(VEHICLE_TIMEOUT_S)
        self._tell(f"simulated vehicle {vehicle.identity.name} answers, flying {self._speedup:g} times as fast as time")
        return vehicle

    async def _fly(self, services: StationServices, plan_id: str, vehicle: Vehicle) -> FlightRecord:
        flights, name = services.flights, vehicle.identity.name
        flight = await flights.create(plan_id, name, FlightPath.MISSION)
        await flights.upload(flight.id, confirm=None, accept=())
        flight = await flights.wait_for_upload(flight.id)
        if not flight.proved:
            raise RefusedError(f"the upload was not proved: {'; '.join(flight.problems)}", field=name)
        items = len((await flights.on_vehicle(flight.id)).items)
        self._tell(f"uploaded and proved: {items} items read back from the vehicle, equal to the plan's")
        await flights.start(flight.id, confirm=name, accept=())
        self._tell("flying")
        telling = asyncio.create_task(self._tell_progress(services, flight.id))
        try:
            return await flights.wait(flight.id)
        finally:
            telling.cancel()

    async def _tell_progress(self, services: StationServices, flight_id: str) -> None:
        last = (0, 0)
        while True:
            summary = services.database.flights.summary(flight_id)
            now = (summary.viewpoints_reached, summary.images_received)
            if now != last:
                last, total = now, summary.flight.viewpoints
                self._tell(f"  {now[0]} of {total} viewpoints reached, {now[1]} of {total} images here")
            await asyncio.sleep(1.0)

    def _account(self, services: StationServices, flight: FlightRecord) -> None:
        summary = services.database.flights.summary(flight.id)
        if flight.state is not FlightState.COMPLETED or flight.problems:
            raise IncompleteError("; ".join(flight.problems) or f"the flight ended {flight.state}")
        self._tell(
            f"done: {summary.viewpoints_reached} of {flight.viewpoints} viewpoints, {summary.images_received} of "
            f"{flight.viewpoints} images in {services.data_dir / 'images' / flight.id}"
        )

    def _tell(self, line: str) -> None:
        self._say(f"[{time.monotonic() - self._started:5.1f} s] {line}")


def run_demo(
    *,
    stay: bool,
    speedup: float,
    autopilot: str,
    port: int,
    data_dir: Path | None,
    say: Callable[[str], None],
    link: str = "udpin:127.0.0.1:0",
) -> None:
    """Run the main job.

    Args:
        stay: keep serving the dashboard afterwards, until interrupted.
        speedup: of the simulated vehicle.
        autopilot: `px4` or `ardupilot`.
        port: of the dashboard; 0 takes any free one.
        data_dir: where everything is kept; the folder `demo` of the default data directory when not given.
        say: takes lines for the person at the terminal.
        link: where the simulated vehicle is listened for.

    Raises:
        GcsError: a stage did not work.
        KeyboardInterrupt: interrupted before all of it worked.
    """
    demo = Demo(speedup=speedup, autopilot=autopilot, say=say, link=link)
    settings = StationSettings(data_dir=data_dir or default_data_directory() / "demo", port=port)
    try:
        asyncio.run(_run(demo, settings, stay, say))
    except KeyboardInterrupt:
        if not demo.done:
            raise


async def _run(demo: Demo, settings: StationSettings, stay: bool, say: Callable[[str], None]) -> None:
    services = StationServices(
        settings.data_dir, stored_links=False, make_mavlink=lambda: MavlinkStation(only_system=SYSTEM_ID)
    )
    stop = asyncio.Event()
    up, urls = asyncio.Event(), []

    def ready(real: StationSettings) -> None:
        urls.append(real.url)
        up.set()

    station = asyncio.create_task(run_station(settings, ready=ready, stop=stop, services=services))
    waiting = asyncio.create_task(up.wait())
    await asyncio.wait({station, waiting}, return_when=asyncio.FIRST_COMPLETED)
    if not up.is_set():
        waiting.cancel()
        await station
        raise LinkError("the station ended before it was up")
    url = urls[0]
    try:
        await demo.run(services, url)
        if stay:
            say(f"The dashboard stays at {url} (Ctrl-C ends it).")
            await station
    finally:
        stop.set()
        await station
