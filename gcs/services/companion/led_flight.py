"""One flight by lease: setpoints from the navigator, a picture at every viewpoint, evasion, and the landing.

Everything is decided here and sent at once; time is what the vehicle's clock says. A script of steps (a coroutine on
the vehicle's stepped channel) goes from viewpoint to viewpoint, while setpoints go out beside it at their own rate.
Whatever happens, the flight ends in one of three ways: the plan is flown and the vehicle lands; the companion has the
vehicle hold; or somebody else took the vehicle, and from that moment on nothing more is sent.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import ConflictError, GcsError, LinkError
from gcs.core.frames import rigid_between, wrap_angle
from gcs.core.replanning import ReplanReason
from gcs.core.vehicle import FlightMode
from gcs.mavlink.mode_guard import ModeChange
from gcs.mavlink.offboard import Setpoint, setpoint_message
from gcs.mavlink.stepped_channel import SteppedTask
from gcs.planning.local.moved_view import moved_viewpoint
from gcs.planning.local.navigator import LocalNavigator, Stop
from gcs.planning.local.navigator_options import NavigatorOptions
from gcs.planning.local.stream_loss_pace import StreamLossRule
from gcs.planning.views.viewing_angles import HOLD_S
from gcs.services.companion.departure_report import unreached
from gcs.services.companion.viewpoint_pictures import ViewpointPictures

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.core.plan import Viewpoint
    from gcs.mavlink.dialect import Message
    from gcs.mavlink.flight_commands import FlightCommands
    from gcs.planning.local.lidar_scan import LidarScan
    from gcs.planning.local.local_replan import LocalReplan
    from gcs.services.companion.flyable_plan import FlyablePlan
    from gcs.services.companion.own_vehicle import OwnVehicle

log = logging.getLogger(__name__)

LEAD_IN_S = 1.2
"""A stream goes out for so long before the vehicle is told to follow it."""

DECIDE_S = 0.15
"""The navigator decides at every scan, and at least this often: later than the next scan, which is not to wait."""

FOLLOWS_M, FOLLOWS_S = 2.5, 1.0
"""A vehicle further than this from where it should be, or have been so long ago, does not follow the stream."""

MAP_SIDE_M = 32.0
"""Edge of the map about the vehicle: several times the way in which it comes to rest, and little to compute with."""

FOREVER_S = 1e6
PASSED_S = 0.05
OVER_HOME_M = 1.0
"""The vehicle lands no further from home than this, seen from above."""


@dataclass
class Progress:
    """How far a plan was flown; a later lease goes on from there.

    Attributes:
        plan_s: time of the plan; None before the first start.
        done: ids of viewpoints that are photographed, or given up.
    """

    plan_s: float | None = None
    done: set[int] = field(default_factory=set)


class LedFlight:
    """Flies one plan until the end, whatever that is.

    Args:
        flyable: what is flown.
        vehicle: that flies it, hovering near the place where the plan goes on.
        progress: from where on; kept up to date.
        report: takes what is to be reported of each departure from the plan.
        say: takes what the operator should read.
        stream_hz: setpoints per second of the vehicle's clock.
        slab_half_m: the lidar tells of heights within this of the vehicle's.
    """

    def __init__(
        self,
        flyable: FlyablePlan,
        vehicle: OwnVehicle,
        progress: Progress,
        report: Callable[[LocalReplan], None],
        say: Callable[[str], None],
        *,
        stream_hz: float,
        slab_half_m: float,
    ) -> None:
        origin = vehicle.telemetry.origin
        if origin is None:
            raise LinkError("the autopilot did not tell its origin")
        self._flyable = flyable
        self._vehicle = vehicle
        self._progress = progress
        self._report = report
        self._rotation, self._shift = rigid_between(flyable.plan.scenario.anchor.point, origin.value)
        self._step_s = 1.0 / stream_hz
        self._todo = [v for v in flyable.plan.viewpoints if v.id not in progress.done]
        start_s = flyable.leave_s if progress.plan_s is None else flyable.time_of(progress.plan_s)
        self._start_s = min([start_s, *(flyable.time_of(v.time_s) for v in self._todo)])
        self._clock = vehicle.channel.clock
        self._hover: Setpoint | None = None
        self._navigator: LocalNavigator | None = None
        self._navigator_options = _navigator_options(flyable, slab_half_m)
        self._due_at = math.inf
        self._decided_s = self._seen_s = -math.inf
        self._holds: dict[str, float] = {}
        self._leaving = self._failed = False
        self._pictures = ViewpointPictures(vehicle, say)
        self._aside: Viewpoint | None = None
        """The viewpoint as it is pictured from another place, while the vehicle stands there."""
        self._tasks: list[SteppedTask] = []
        self._accounted: set[int] = set()
        """Viewpoints whose picture was announced, or that were reported as left out."""
        self.taken_over = False
        """Whether it ended because somebody else took the vehicle."""
        self.ended: str | None = None
        """Why the flight is over before the plan was; None while it goes on."""
        self.finished = False
        """Whether the plan is flown and the vehicle lands."""
        self.setpoints = 0

    # ---- what it is told ----

    def start(self) -> None:
        """Begin to stream, and take over."""
        self._vehicle.remember_sticks()
        self._tasks.append(SteppedTask(self._fly()))
        self._look_at_tasks()

    @property
    def over(self) -> bool:
        """Whether nothing more is sent."""
        return self.finished or self.ended is not None

    @property
    def plan_time_s(self) -> float:
        """How far the plan is flown, in its own time."""
        return self._flyable.plan_time(self._curve_s)

    @property
    def departing(self) -> ReplanReason | None:
        """Why the vehicle is off the plan; None while it is on it."""
        return None if self._navigator is None else self._navigator.departing

    @property
    def hold_reasons(self) -> tuple[str, ...]:
        """Why it hovers, or slows down to."""
        return tuple(self._holds)

    @property
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next."""
        return min([self._due_at, *(task.deadline for task in self._tasks)])

    def mode_changed(self, change: ModeChange) -> None:
        """A heartbeat shows another mode; to be called before anything else hears of it."""
        if change is not ModeChange.COMMANDED and not self.over:
            self.taken_over = change is ModeChange.TAKEN_OVER
            self.stop(self._vehicle.guard.hands_off or "the vehicle is disarmed")

    def handle(self, message: Message) -> None:
        """Take a message of the vehicle."""
        if not self.over and self._vehicle.moved_stick():
            self.taken_over = True
            self.stop("the pilot moves the sticks")
        for task in tuple(self._tasks):
            task.handle(message)
        self._look_at_tasks()

    def on_time(self) -> None:
        """Send what is due."""
        now = self._clock()
        for task in tuple(self._tasks):
            if task.deadline <= now:
                task.on_time()
        self._look_at_tasks()
        if self._due_at <= now:
            self._stream()

    def see(self, scan: LidarScan, at_s: float) -> None:
        """A scan was measured at a time of the vehicle's clock; `react` is to follow.

        Raises:
            InputError: the navigator cannot use it.
        """
        place, attitude = self._scene_place(at_s), self._vehicle.poses.attitude(at_s)
        if self._navigator is None or self._failed or self.over or place is None or attitude is None:
            return
        self._seen_s = max(self._seen_s, at_s)  # what one sensor tells late is entered behind the other's
        self._navigator.see(scan, place, attitude[2], self._seen_s)

    def react(self) -> None:
        """Decide, and send what follows from it at once."""
        self._decide()
        self._stream()

    def hold(self, reason: str) -> None:
        """Come to rest and hover for a reason, until it is gone; obstacles are evaded meanwhile."""
        if reason in self._holds:
            return
        self._holds[reason] = self._vehicle_s()
        if len(self._holds) == 1 and self._navigator is not None:
            self._navigator.hold()

    def release(self, reason: str) -> None:
        """The reason is gone."""
        if self._holds.pop(reason, None) is not None and not self._holds and self._navigator is not None:
            self._navigator.release()

    def held_for_s(self, reason: str) -> float:
        """For how long a reason has lasted; 0 when there is none."""
        since = self._holds.get(reason)
        return 0.0 if since is None else self._vehicle_s() - since

    def leave(self, why: str) -> None:
        """Have the vehicle hold, and end the lease when it shows that it does."""
        if self.over or self._leaving:
            return
        self._leaving = True
        self._break_off()
        self.hold("leaving")
        for task in self._tasks:
            task.cancel()
        self._tasks = [SteppedTask(self._leave(why))]
        self._look_at_tasks()

    def fail(self, why: str) -> None:
        """The navigator is broken: hover where the vehicle is, and end in a hold; the second time, end at once."""
        newest, yaw = self._vehicle.poses.newest, self._vehicle.telemetry.yaw_rad
        if self.over or self._failed or newest is None or yaw is None:
            self.stop(why)
            return
        self._failed = True
        self._hover = Setpoint.hover(newest.position_m, yaw.value)
        try:
            self.leave(why)
        except Exception:
            log.exception("it cannot be brought to a hold")
            self.stop(why)

    def stop(self, why: str) -> None:
        """End at once: no setpoint and no command goes out any more."""
        if not self.over:
            self.ended = why
            if not self._leaving:
                self._break_off()
            self._account_for_rest(ReplanReason.LEASE_ENDED)
        self._due_at = math.inf
        for task in self._tasks:
            task.cancel()
        self._tasks = []

    # ---- the script ----

    async def _fly(self) -> None:
        vehicle, commands = self._vehicle, self._commands()
        await vehicle.stack.hold_before_stream(commands)
        self._begin_stream()
        await vehicle.channel.sleep(LEAD_IN_S)
        await vehicle.stack.enter_offboard(commands)
        self._begin_plan()
        previous: Viewpoint | None = None
        for viewpoint in self._todo:
            await self._photograph(commands, viewpoint, previous)
            self._progress.done.add(viewpoint.id)
            previous = viewpoint
        navigator = self._navigating()
        await self._until(lambda: navigator.finished or self._in_landing_column(navigator), "the way home")
        self._break_off()  # a last viewpoint may have been left out on a way that ends in the column
        self.hold("landing")
        await self._until(lambda: navigator.finished or navigator.held, "the vehicle to stop over home")
        await self._land(commands)

    def _in_landing_column(self, navigator: LocalNavigator) -> bool:
        """Whether the vehicle is on the last, vertical part of the plan; where it evades it is not."""
        place = self._scene_place(self._vehicle_s())
        if navigator.away or self._curve_s < self._flyable.enter_s or place is None:
            return False
        home = np.asarray(self._flyable.plan.scenario.home_m)
        return bool(np.linalg.norm(place[:2] - home[:2]) <= OVER_HOME_M)

    async def _land(self, commands: FlightCommands) -> None:
        number = self._vehicle.stack.custom_mode(FlightMode.LAND)
        assert number is not None  # every stack that can be led has one
        await commands.switch_mode(number)
        self._due_at = math.inf
        self.finished = True
        self._account_for_rest(ReplanReason.NO_PICTURE)

    async def _leave(self, why: str) -> None:
        try:
            await self._vehicle.stack.pause(self._commands())
        except GcsError as error:
            why = f"{why}; it does not go into hold: {error.message}"
        self.stop(why)

    async def _photograph(self, commands: FlightCommands, viewpoint: Viewpoint, previous: Viewpoint | None) -> None:
        at_s = self._flyable.time_of(viewpoint.time_s)
        if previous is not None and not previous.stops:
            free_s = self._flyable.time_of(previous.time_s + HOLD_S)
            await self._until(lambda: self._curve_s >= free_s, f"the picture of {previous.name}")
        await self._pictures.point_camera(commands, viewpoint)
        if not viewpoint.stops:
            await self._until(lambda: self._curve_s + self._pictures.lag_s >= at_s, viewpoint.name)
            self._tasks.append(SteppedTask(self._photograph_in_passing(commands, viewpoint)))
            return
        navigator = self._navigating()
        await self._until(lambda: navigator.arrived == viewpoint.id or self._curve_s > at_s + PASSED_S, viewpoint.name)
        if navigator.arrived != viewpoint.id:
            return  # left out; the navigator reports why
        if navigator.moved_to is not None:
            await self._photograph_from_aside(commands, viewpoint, navigator.moved_to)
            return
        await self._pictures.settle(viewpoint, self._rotation @ viewpoint.position_m + self._shift)
        if await self._pictures.take(commands, viewpoint):
            self._accounted.add(viewpoint.id)
        navigator.go_on(viewpoint.id)

    async def _photograph_from_aside(
        self, commands: FlightCommands, viewpoint: Viewpoint, place_m: NDArray[np.float64]
    ) -> None:
        """Turn to the viewpoint's target from another place, at which the vehicle has come to rest."""
        self._aside = moved_viewpoint(viewpoint, place_m, self._flyable.plan.scenario.camera)
        await self._pictures.point_camera(commands, self._aside)
        await self._pictures.settle(self._aside, self._rotation @ place_m + self._shift)
        navigator = self._navigating()
        if navigator.arrived != viewpoint.id or navigator.moved_to is not place_m:  # it had to give way meanwhile
            self._aside = None
            await self._photograph(commands, viewpoint, None)
            return
        taken = await self._pictures.take(commands, viewpoint)
        if taken:
            self._accounted.add(viewpoint.id)
        self._aside = None
        navigator.go_on(viewpoint.id, place_m if taken else None)

    async def _photograph_in_passing(self, commands: FlightCommands, viewpoint: Viewpoint) -> None:
        if await self._pictures.take_in_passing(commands, viewpoint):
            self._accounted.add(viewpoint.id)

    # ---- inside ----

    @property
    def _curve_s(self) -> float:
        return self._start_s if self._navigator is None else self._navigator.plan_time_s

    def _navigating(self) -> LocalNavigator:
        assert self._navigator is not None  # the script has begun it
        return self._navigator

    def _commands(self) -> FlightCommands:
        def permit() -> None:
            if self.over:
                raise ConflictError("the lease has ended")

        return self._vehicle.commands(permit)

    async def _until(self, holds: Callable[[], bool], what: str) -> None:
        await self._vehicle.channel.until(holds, FOREVER_S, what)

    def _vehicle_s(self) -> float:
        now = self._vehicle.now_s()
        if now is None:
            raise LinkError("the vehicle's clock is not known")
        return now

    def _scene_place(self, at_s: float) -> NDArray[np.float64] | None:
        local = self._vehicle.poses.position(at_s)
        return None if local is None else np.asarray(self._rotation.T @ (local - self._shift))

    def _begin_stream(self) -> None:
        now = self._vehicle_s()
        place, attitude = self._vehicle.poses.position(now), self._vehicle.poses.attitude(now)
        if place is None or attitude is None:
            raise LinkError("the autopilot does not tell its position and attitude")
        self._hover = Setpoint.hover(place, attitude[2])
        self._due_at = self._clock()
        self._stream()

    def _begin_plan(self) -> None:
        assert self._hover is not None  # the stream has begun
        others = self._flyable.others
        stops = [Stop(self._flyable.time_of(v.time_s), v.id, v.stops, others.get(v.id)) for v in self._todo]
        self._navigator = LocalNavigator(
            self._flyable.curve,
            [stop for stop in stops if stop.time_s >= self._start_s],
            self._flyable.limits,
            self._navigator_options,
            start_s=self._start_s,
            place_m=self._rotation.T @ (self._hover.position_m - self._shift),
        )
        if self._holds:
            self._navigator.hold()

    def _decide(self) -> None:
        if self._navigator is None or self._failed:
            return
        self._decided_s = now = self._vehicle_s()
        for replan in self._navigator.decide(now):
            self._tell(replan)
        if self._navigator.gave_up is not None:
            self.leave(self._navigator.gave_up)

    def _tell(self, replan: LocalReplan) -> None:
        self._progress.done.update(replan.skipped)
        self._accounted.update(replan.skipped)
        self._report(replan)

    def _break_off(self) -> None:
        """The plan is left for good: tell of a departure that still lasts."""
        lasting = None if self._navigator is None else self._navigator.break_off()
        if lasting is not None:
            self._tell(lasting)

    def _account_for_rest(self, reason: ReplanReason) -> None:
        """Report every viewpoint of which nothing was told until the end."""
        rest = tuple(viewpoint.id for viewpoint in self._todo if viewpoint.id not in self._accounted)
        if rest:
            self._report(unreached(reason, rest, self._vehicle_s(), self.plan_time_s))

    def _stream(self) -> None:
        """Send the setpoint of now."""
        if self.over or self._hover is None:
            return
        now = self._vehicle_s()
        if self._navigator is not None and now - self._decided_s >= DECIDE_S:
            self._decide()
            if self.over:
                return
        setpoint = self._setpoint(now)
        problem = self._not_following(now, setpoint)
        if problem is not None:
            self.leave(problem)
        self._vehicle.channel.send(setpoint_message(setpoint, now, self._vehicle.channel.target))
        self.setpoints += 1
        self._due_at = self._clock() + self._step_s / max(self._vehicle.clock_rate, 0.1)

    def _setpoint(self, now_s: float) -> Setpoint:
        if self._navigator is None or self._failed:
            assert self._hover is not None
            return self._hover
        position, velocity, acceleration = self._navigator.motion(now_s)
        self._progress.plan_s = plan_s = self.plan_time_s
        yaw = float(self._flyable.plan.yaw.value(plan_s)) if self._aside is None else self._aside.yaw_rad
        return Setpoint(
            self._rotation @ position + self._shift,
            self._rotation @ velocity,
            self._rotation @ acceleration,
            wrap_angle(yaw),
        )

    def _not_following(self, now_s: float, setpoint: Setpoint) -> str | None:
        newest = self._vehicle.poses.newest
        if newest is None or now_s - newest.at_s > FOLLOWS_S:
            return None  # silence is another matter
        off_m = float(np.linalg.norm(newest.position_m - setpoint.position_m))
        if off_m <= FOLLOWS_M + FOLLOWS_S * float(np.linalg.norm(setpoint.velocity_m_s)):
            return None
        return f"it does not follow: {off_m:.0f} m off"

    def _look_at_tasks(self) -> None:
        """Drop what is done; a script that failed ends the flight."""
        failed = next((task.error for task in self._tasks if task.error is not None), None)
        self._tasks = [task for task in self._tasks if not task.finished]
        if failed is not None and not self.over:
            self.leave(failed.message)


def _navigator_options(flyable: FlyablePlan, slab_half_m: float) -> NavigatorOptions:
    """What local paths keep: the plan's own clearance and budgets, but for the model's error."""
    scenario = flyable.plan.scenario
    keep_m = scenario.centre_clearance_m - scenario.safety.model_m
    return NavigatorOptions(
        safe_m=keep_m,
        keep_moving_m=keep_m,
        known=flyable.known,
        slab_half_m=slab_half_m,
        map_side_m=MAP_SIDE_M,
        stream_loss=StreamLossRule(flyable.stream_loss, scenario.vehicle.radius_m + scenario.safety.position_m),
    )
