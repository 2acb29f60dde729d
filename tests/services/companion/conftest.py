"""A companion beside a whole simulated vehicle on fake time, and a station at the other link."""

from __future__ import annotations

import contextlib
import itertools
import math
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.plan import Viewpoint
from gcs.core.scenario import parse_scenario
from gcs.core.trajectory import AngleProfile, PiecewisePolynomial
from gcs.core.vehicle import Autopilot
from gcs.mavlink.companion_lease import LeaseOrder, LeaseOrdering, OrderKind, lease_status
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.mavlink.heartbeats import station_heartbeat
from gcs.mavlink.message_rates import RATES_HZ, request_rates
from gcs.mavlink.stepped_channel import SteppedTask
from gcs.planning.trajectories.retiming import identity_warp
from gcs.planning.trajectories.stream_loss import StreamLoss
from gcs.planning.trajectories.warped_curve import slowed_curve
from gcs.services.companion.companion_options import CompanionOptions
from gcs.services.companion.core import CompanionCore
from gcs.services.companion.flyable_plan import FlyablePlan
from gcs.services.companion.own_vehicle import OwnVehicle
from sitl_mocks.flight_world import COMPANION, STATION, FlightSpec, FlightWorld

ANCHOR = (31.3622, 121.6155, 4.0)
PLAN_HASH = "5a" * 32
HOVER_M = 6.0
PLACES = ((0, 0, 0), (0, 0, HOVER_M), (12, 0, HOVER_M), (12, 8, HOVER_M), (0, 0, HOVER_M), (0, 0, 0))
LEG_S = (6.0, 8.0, 7.0, 9.0, 8.0)
VIEWPOINT_LEGS = (2, 3)


def smooth_leg(start, end):
    """Coefficients of a rest-to-rest leg, 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7."""
    leg = np.zeros((8, 3))
    leg[0] = start
    leg[4:] = np.array([35.0, -84.0, 70.0, -20.0])[:, None] * (np.asarray(end, float) - start)
    return leg


def scenario():
    """Small clearances, so that a few metres are room enough."""
    return parse_scenario(
        {
            "name": "yard",
            "structure": {"meshes": [{"file": "none.stl"}]},
            "anchor": {"latitude_deg": ANCHOR[0], "longitude_deg": ANCHOR[1], "altitude_m": ANCHOR[2]},
            "camera": {
                "sensor_width_mm": 13.2,
                "sensor_height_mm": 8.8,
                "focal_length_mm": 8.8,
                "image_width_px": 5472,
                "image_height_px": 3648,
            },
            "inspection": {"points": [{"name": "P", "position_m": [12.0, 12.0, 6.0], "normal": [0, -1, 0]}]},
            "vehicle": {"radius_m": 0.4, "max_speed_m_s": 4.0, "max_acceleration_m_s2": 2.5},
            "safety": {"clearance_m": 0.3, "tracking_m": 0.3, "position_m": 0.2, "model_m": 0.1},
            "home_m": [0, 0, 0],
        }
    )


def make_flyable(plan_hash=PLAN_HASH):
    """Up, along to two viewpoints, back over home, down."""
    places = [np.array(p, float) for p in PLACES]
    curve = PiecewisePolynomial(
        np.array([smooth_leg(a, b) for a, b in itertools.pairwise(places)]), np.array(LEG_S, float)
    )
    ends = np.cumsum(LEG_S)
    viewpoints = tuple(
        Viewpoint(
            id=number,
            name=f"V{number}",
            position_m=places[leg],
            direction=np.array([0.0, 1.0, 0.0]),
            up=np.array([0.0, 0.0, 1.0]),
            gsd_m=0.003,
            time_s=float(ends[leg - 1]),
            yaw_rad=math.pi / 2,
            gimbal_pitch_rad=-0.3,
        )
        for number, leg in enumerate(VIEWPOINT_LEGS)
    )
    plan = SimpleNamespace(
        path_m=np.array(PLACES, float),
        trajectory=curve,
        yaw=AngleProfile(np.array([0.0, 3.0, curve.duration_s]), np.array([math.pi / 2] * 3)),
        viewpoints=viewpoints,
        scenario=scenario(),
    )
    warp = identity_warp(curve.duration_s)
    leave_s, enter_s = float(ends[0]), float(ends[3])
    return FlyablePlan(plan_hash, plan, slowed_curve(curve, warp), warp, None, leave_s, enter_s, StreamLoss(1.0, 2.0))


class Plans:
    """A source of plans that has some."""

    def __init__(self, *plans):
        self.plans = {plan.plan_hash: plan for plan in plans}
        self.error = None

    def get(self, plan_hash, offboard_timeout_s):
        if self.error is not None:
            raise self.error
        return self.plans.get(plan_hash)


class Outbox:
    """Takes reports, and delivers none."""

    boot_id = 77
    deadline = math.inf

    def __init__(self):
        self.reports = []

    @property
    def pending(self):
        return len(self.reports)

    def add(self, report):
        self.reports.append(report)

    def handle(self, message):
        pass

    def on_time(self):
        pass


class World:
    """Vehicle, companion and station, and the time that passes for all of them."""

    def __init__(self, autopilot="px4", obstacles=(), loss=0.0, parameters=None, tells_3d=False, **options):
        home = geodetic_from_enu([0.0, 0.0, 0.0], GeoPoint(*ANCHOR))
        place = tuple(float(c) for c in home)
        spec = FlightSpec(autopilot, 3, ANCHOR, place, obstacles, parameters, loss, tells_3d=tells_3d)
        self.world = FlightWorld(spec)
        self.vehicle = self.world._vehicle
        self.now_s = 0.0
        self._out = {STATION: [], COMPANION: []}
        self._packers = {STATION: FramePacker(255, 190), COMPANION: FramePacker(1, 191)}
        self._parsers = {STATION: FrameParser(), COMPANION: FrameParser()}
        self.sent_by_companion = []
        self.plans, self.outbox = Plans(make_flyable()), Outbox()
        self.core = CompanionCore(
            system_id=1,
            send=self._sender(COMPANION),
            clock=self.clock,
            plans=self.plans,
            outbox=self.outbox,
            options=CompanionOptions(**options),
        )
        kind = Autopilot(autopilot)
        self.station = OwnVehicle(kind, (1, 1), (255, 190), self._sender(STATION), self.clock)
        self.states, self.texts = [], []
        self.station_is_away = False
        self._tasks, self._beat_at = [], 0.0
        self.drop = lambda message: False
        """Tells which messages to the companion are lost."""

    def clock(self):
        return self.now_s

    def _sender(self, name):
        def send(message):
            if name == COMPANION:
                self.sent_by_companion.append((self.now_s, message))
            self._out[name].append(self._packers[name].pack(message))

        return send

    def run(self, seconds, until=lambda: False):
        """Let time pass; True when `until` came to hold."""
        end = self.now_s + seconds
        while self.now_s < end:
            if until():
                return True
            out, self._out = self._out, {STATION: [], COMPANION: []}
            wake = min([end, self.core.deadline, self._beat_at, *(task.deadline for task in self._tasks)])
            self.now_s, heard = self.world.fly(wake, out)
            for packet in heard[COMPANION]:
                for message in self._parsers[COMPANION].feed(packet):
                    if not self.drop(message):
                        self.core.handle(message)
            for packet in () if self.station_is_away else heard[STATION]:
                for message in self._parsers[STATION].feed(packet):
                    self._hear(message)
            self._on_time()
        return until()

    def _hear(self, message):
        status = lease_status(message)
        if status is not None:
            self.states.append(status)
        elif message.get_type() == "STATUSTEXT" and message.get_srcComponent() == 191:
            self.texts.append(message.text)
        self.station.handle(message)
        for task in self._tasks:
            task.handle(message)

    def _on_time(self):
        self.core.on_time()
        for task in self._tasks:
            if task.deadline <= self.now_s:
                task.on_time()
        self._tasks = [task for task in self._tasks if not task.finished]
        if self.now_s >= self._beat_at:
            self._beat_at = self.now_s + 1.0
            if not self.station_is_away:
                self._sender(STATION)(station_heartbeat())

    def do(self, work, timeout_s=60.0):
        """Have the station do something to its end."""
        task = SteppedTask(work)
        self._tasks.append(task)
        if not self.run(timeout_s, lambda: task.finished):
            task.cancel()
            raise TimeoutError("it takes too long")
        if task.error is not None:
            raise task.error

    def take_off(self):
        """Up to where the plan begins."""
        self.run(2.0)
        self.do(request_rates(self.station.channel, RATES_HZ))
        self.run(20.0, lambda: _ready(self.station))
        commands = self.station.commands(lambda: None)
        self.do(self.station.stack.take_off(commands, ANCHOR[2] + HOVER_M))
        self.run(5.0, lambda: self.station.in_air and self.station.may_be_led)
        self.run(2.0)

    def order(self, kind=OrderKind.FLY, lease=1, plan_hash=PLAN_HASH, timeout_s=60.0):
        """Give an order until it is answered; returns the state, or raises what came of it."""
        found = []

        async def ordering():
            order = LeaseOrder(lease, kind, plan_hash)
            found.append(await self.station.channel.run(LeaseOrdering(order, 1, self._sender(STATION), self.clock)))

        self.do(ordering(), timeout_s)
        return found[0]

    def setpoints_since(self, at_s):
        """How many setpoints the companion has sent since."""
        kind = "SET_POSITION_TARGET_LOCAL_NED"
        return sum(1 for sent_s, message in self.sent_by_companion if sent_s > at_s and message.get_type() == kind)

    def fly_until(self, *states, timeout_s=200.0):
        """Let time pass until the lease is in one of some states."""
        assert self.run(timeout_s, lambda: self.core.status.state in states), self.core.status
        return self.core.status


def _ready(station):
    telemetry = station.telemetry
    return telemetry.home is not None and telemetry.ready_to_arm is not None and telemetry.ready_to_arm.value


@pytest.fixture(params=["px4", "ardupilot"])
def autopilot(request):
    return request.param


@pytest.fixture
def make_world():
    return World


@pytest.fixture(name="make_flyable")
def make_flyable_fixture():
    return make_flyable


@pytest.fixture
def file_station():
    """A station that serves the `files` (by name) of the plan with `plan_hash` to who has its `token`.

    `asked` are the names of the files that were asked for; an answer breaks off `cut` bytes before its announced end.
    """
    state = SimpleNamespace(plan_hash="", files={}, token="token", asked=[], cut=0)

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self):
            folder, name = self.path.rsplit("/", 1)
            state.asked.append(name)
            known = self.headers["Authorization"] == f"Bearer {state.token}"
            body = state.files.get(name) if known and folder == f"/api/plans/by-hash/{state.plan_hash}" else None
            self.send_response(401 if not known else 404 if body is None else 200)
            self.send_header("Content-Length", str(len(body or b"") + state.cut))
            self.end_headers()
            self.wfile.write(body or b"")

        def log_message(self, *words):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Answer)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    state.url = f"http://127.0.0.1:{server.server_port}"
    yield state
    with contextlib.suppress(OSError):
        server.shutdown()
    thread.join()
    server.server_close()
