"""One flight by lease: vehicle, obstacles and bad links are a world on fake time, companion and station are here."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.core.frames import GeoPoint, enu_from_geodetic, geodetic_from_enu
from gcs.core.replanning import ReplanReason, ReplanReport, ViewpointFate
from gcs.core.vehicle import Autopilot
from gcs.mavlink.companion_lease import COMPANION
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.mavlink.report_outbox import ReportOutbox
from gcs.services.benchmarks.flight_station import STATION, FlightStation
from gcs.services.benchmarks.lockstep_worlds import Order
from gcs.services.benchmarks.random_obstacles import blocked_in_the_end, random_obstacles
from gcs.services.benchmarks.report_world import ReportsInMemory
from gcs.services.benchmarks.wall_plan import ANCHOR, HOME_M, WallPlans, wall_plan
from gcs.services.companion.companion_options import CompanionOptions
from gcs.services.companion.core import CompanionCore

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.mavlink.dialect import Message

SYSTEM_ID = 1
LOSS = 0.05
STREAM_HZ = 20.0
"""The fewest setpoints that are allowed: the hardest for the vehicle, and the least to compute."""

PHOTOGRAPHED_M = 1.0
"""A picture taken within this of a viewpoint, or of where a report says that it was moved to, is one of it."""


@dataclass(frozen=True)
class FlightOutcome:
    """What became of a flight.

    Attributes:
        seed: that it was drawn from.
        autopilot: of the vehicle.
        least_m: least distance between its hull and an obstacle.
        touched: obstacles that it touched.
        viewpoints: of the plan.
        moved: viewpoints that were reported as moved and of which there is a picture from there, in truth.
        photographed: other viewpoints of which there is a picture, in truth.
        skipped: for each other viewpoint whose skipping was reported the reason.
        reachable: how many of the skipped have nothing that stands too near for good.
        reports_made: by the companion.
        reports_once: of these, came to the station exactly once and as they were.
        by_hand: why it had to be ended by hand; None when it ended by itself.
        flown_s: until the landing.
    """

    seed: int
    autopilot: str
    least_m: float
    touched: tuple[str, ...]
    viewpoints: int
    moved: int
    photographed: int
    skipped: tuple[ReplanReason, ...]
    reachable: int
    reports_made: int
    reports_once: int
    by_hand: str | None
    flown_s: float

    @property
    def unaccounted(self) -> int:
        """Viewpoints that were neither photographed, from wherever, nor reported as skipped."""
        return self.viewpoints - self.photographed - self.moved - len(self.skipped)


class _AllReports(ReportsInMemory):
    """Remembers beside what waits all that ever did."""

    def __init__(self) -> None:
        super().__init__()
        self.added: list[ReplanReport] = []

    def keep(self, report: ReplanReport) -> None:
        super().keep(report)
        self.added.append(report)


class _End:
    """One end of a link of the world, and what is to be sent from there."""

    def __init__(self, source: tuple[int, int]) -> None:
        self._packer = FramePacker(*source)
        self._outbox: list[str] = []

    def send(self, message: Message) -> None:
        self._outbox.append(self._packer.pack(message).hex())

    def take(self) -> list[str]:
        sent, self._outbox = self._outbox, []
        return sent


async def fly_once(seed: int) -> FlightOutcome:
    """Fly once; the seed draws everything, and its parity the autopilot. Awaits `Order`s, see `lockstep_worlds`."""
    rng = np.random.default_rng([seed, 7])
    autopilot = Autopilot.PX4 if seed % 2 == 0 else Autopilot.ARDUPILOT
    made, flyable = wall_plan(), WallPlans().get(wall_plan().plan_hash, 1.0)
    assert flyable is not None  # it is made at once
    way_m = flyable.curve.value(np.arange(flyable.leave_s, flyable.enter_s, 0.2))
    take_off_m = flyable.curve.value(flyable.leave_s)
    viewpoints_m = np.array([viewpoint.position_m for viewpoint in made.plan.viewpoints])
    keep_m = made.plan.scenario.centre_clearance_m
    obstacles = random_obstacles(rng, way_m, np.asarray(HOME_M), viewpoints_m, keep_m)
    spec = {
        "autopilot": autopilot.value,
        "seed": seed,
        "anchor": ANCHOR,
        "home": [float(c) for c in geodetic_from_enu(HOME_M, made.plan.scenario.anchor.point)],
        "obstacles": obstacles,
        "loss": LOSS,
    }
    await Order("open-flight", seed, spec)
    now_s = 0.0

    def clock() -> float:
        return now_s

    air, cable = _End(STATION), _End((SYSTEM_ID, COMPANION))
    memory = _AllReports()
    outbox = ReportOutbox(memory, cable.send, clock, boot_id=seed)
    core = CompanionCore(
        system_id=SYSTEM_ID,
        send=cable.send,
        clock=clock,
        plans=WallPlans(),
        outbox=outbox,
        options=CompanionOptions(stream_hz=STREAM_HZ),
    )
    altitude = float(geodetic_from_enu(take_off_m, made.plan.scenario.anchor.point)[2])
    station = FlightStation(autopilot, altitude, made.plan_hash, air.send, clock)
    ends: dict[str, tuple[_End, FlightStation | CompanionCore]] = {
        "station": (air, station),
        "companion": (cable, core),
    }
    while not station.over:
        until_s = min(station.deadline, core.deadline)
        sent = {name: end.take() for name, (end, _) in ends.items()}
        now_s, heard = await Order("fly", seed, until_s, sent)
        for name, (_, machine) in ends.items():
            for packet in heard[name]:
                for message in FrameParser().feed_datagram(bytes.fromhex(packet)):
                    machine.handle(message)
            if now_s >= machine.deadline:
                machine.on_time()
    truth = await Order("truth", seed, None)
    blocked = blocked_in_the_end(obstacles, viewpoints_m, keep_m)
    return _outcome(seed, autopilot, truth, station, memory.added, blocked)


def _outcome(
    seed: int,
    autopilot: Autopilot,
    truth: dict[str, Any],
    station: FlightStation,
    made: list[ReplanReport],
    blocked: NDArray[np.bool_],
) -> FlightOutcome:
    viewpoints = wall_plan().plan.viewpoints
    shots = np.array([shot["position_m"] for shot in truth["shots"]]).reshape(-1, 3)

    def is_pictured_from(place_m: NDArray[np.float64]) -> bool:
        return bool((np.linalg.norm(shots - place_m, axis=1) <= PHOTOGRAPHED_M).any())

    changes = [(change, report.reason) for report in station.reports for change in report.viewpoints]
    moved = {c.viewpoint for c, _ in changes if c.place is not None and is_pictured_from(_in_scene(c.place))}
    photographed = {v.id for v in viewpoints if is_pictured_from(v.position_m)} - moved
    told = {c.viewpoint: reason for c, reason in changes if c.fate is ViewpointFate.SKIPPED}
    skipped = {viewpoint: reason for viewpoint, reason in told.items() if viewpoint not in photographed | moved}
    free = {v.id for v, is_blocked in zip(viewpoints, blocked, strict=True) if not is_blocked}
    came = Counter((report.number, report.plan_hash_after) for report in station.reports)
    least_m = truth["obstacles"]["least_distance_m"]
    return FlightOutcome(
        seed=seed,
        autopilot=autopilot.value,
        least_m=math.inf if least_m is None else least_m,
        touched=tuple(truth["obstacles"]["touched"]),
        viewpoints=len(viewpoints),
        moved=len(moved),
        photographed=len(photographed),
        skipped=tuple(skipped.values()),
        reachable=len(free & skipped.keys()),
        reports_made=len(made),
        reports_once=sum(came[report.number, report.plan_hash_after] == 1 for report in made),
        by_hand=station.by_hand,
        flown_s=truth["time_s"],
    )


def _in_scene(place: GeoPoint) -> NDArray[np.float64]:
    anchor = wall_plan().plan.scenario.anchor.point
    return np.array(enu_from_geodetic(place.latitude_deg, place.longitude_deg, place.altitude_m, anchor))
