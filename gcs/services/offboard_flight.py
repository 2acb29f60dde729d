"""An offboard flight: the plan streamed as setpoints, halting where it stops for a picture until that is taken.

Pictures of viewpoints that it flies through are commanded in passing (`passing_pictures`).

What the vehicle shows of its drag and its lag on the way goes back into the stream. Acceleration is asked for in
addition against the drag of the setpoint's horizontal velocity, which is what the tilt tells about. The lag is a lead
of the stream: setpoints run ahead of where the vehicle is due by it, and what belongs to the place, as the yaw, follows
the vehicle. Neither the path of the setpoints nor their speed changes, so what was proved for the loss of the stream at
every point and velocity of the plan stays proved.
"""

from __future__ import annotations

import asyncio
import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import GcsError, LinkError, RefusedError
from gcs.core.frames import rigid_between, wrap_angle
from gcs.core.learned_dynamics import NOTHING_LEARNED
from gcs.mavlink.offboard import Setpoint
from gcs.planning.views.viewing_angles import HOLD_S
from gcs.services.flight_recorder import WARNING
from gcs.services.home_column import SLEW, column_times, column_top_amsl_m
from gcs.services.passing_pictures import PassingPictures
from gcs.services.plan_clock import PlanClock
from gcs.services.stream_feed_forward import StreamFeedForward
from gcs.services.tracking_forecast import GUSTS, forecast_tracking

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.core.learned_dynamics import LearnedDynamics
    from gcs.core.motion import MotionSample
    from gcs.core.plan import Plan, Viewpoint
    from gcs.mavlink.offboard import OffboardSession
    from gcs.mavlink.vehicle import Vehicle
    from gcs.planning.trajectories.retiming import TimeWarp
    from gcs.services.flight_recorder import FlightRecorder
    from gcs.services.image_collector import ImageCollector
    from gcs.services.plan_clock import ClockReading

HORIZONTAL = np.array([1.0, 1.0, 0.0])
FOLLOWS_M, FOLLOWS_S = 2.0, 1.0
"""A vehicle that is further than this from where it should stand, or in flight from where it should have been so long
ago, does not follow the stream."""

INFORMATION = 6
FEED_S = 0.1
DEADMAN_S = 1.0
"""The stream outlives a stall of the event loop by no more than this: the shortest patience of an autopilot."""
SETTLE_TIMEOUT_S = 10.0
SETTLED_M, SETTLED_M_S = 0.3, 0.3
SETTLED_YAW_RAD, SETTLED_PITCH_RAD = math.radians(5.0), math.radians(3.0)
POLL_S, PASSING_POLL_S = 0.05, 0.005
PICTURE_TIMEOUT_S = 4.0
PICTURE_TRIES = 3


class StreamEndedError(GcsError):
    """The stream of setpoints ended before the plan did."""

    title = "Stream ended"


class OffboardFlight:
    """Streams one plan to one vehicle.

    Args:
        plan: what is flown; it begins at home on the ground, or at rest in the air where the vehicle hovers.
        warp: the plan's times, slowed where losing the stream would not be survivable (safety rule 6).
        vehicle: who flies.
        recorder: where it is written down.
        collector: hears of the pictures.
        learned: what the vehicle's earlier flights have shown of its drag and lag.
    """

    def __init__(
        self,
        plan: Plan,
        warp: TimeWarp,
        vehicle: Vehicle,
        recorder: FlightRecorder,
        collector: ImageCollector,
        learned: LearnedDynamics = NOTHING_LEARNED,
    ) -> None:
        self._plan = plan
        self._warp = warp
        self._vehicle = vehicle
        self._recorder = recorder
        self._collector = collector
        self._session: OffboardSession | None = None
        leave, enter = column_times(plan)
        self._clock = PlanClock(warp.time_of(leave), slew=SLEW, paused=True, vehicle_now=self._vehicle_now)
        self._land_at_s = warp.time_of(enter)
        self._leave_s = leave
        self._rotation = np.eye(3)
        self._shift = np.zeros(3)
        self._known_before = learned
        self._feed_forward = StreamFeedForward(accelerates=vehicle.takes_acceleration_forward, learned=learned)
        self._lead_s = 0.0
        self._passing = PassingPictures(vehicle, collector, recorder)

    @property
    def plan_time_s(self) -> float:
        """How far along the plan the vehicle is due to be."""
        return float(self._warp.plan_time(self._due_s))

    @property
    def learned(self) -> LearnedDynamics:
        """What is known of the vehicle by now."""
        return self._known_before if self._session is None else self._feed_forward.learned

    def pause(self) -> None:
        """Slow down to a hover; the stream goes on."""
        self._clock.pause()
        self._stream_anew()

    def resume(self) -> None:
        """Go on after a pause."""
        self._clock.resume()
        self._stream_anew()

    @property
    def streaming(self) -> bool:
        """Whether setpoints go out."""
        return self._session is not None and self._session.active

    async def fly(self, on_flying: Callable[[], None]) -> None:
        """Take off if need be, fly the whole plan, and hand over to the vehicle's own landing over home.

        Args:
            on_flying: called when the stream leads the vehicle.

        Raises:
            StreamEndedError: the stream ended early; the vehicle holds or somebody else has it.
            RefusedError: the vehicle refused to take off, to be led, or to land.
            LinkError: it is not heard.
        """
        origin = self._vehicle.telemetry.origin
        if origin is None:
            raise LinkError("it did not tell its origin", field=self._vehicle.identity.name)
        await self._predict()
        self._rotation, self._shift = rigid_between(self._plan.scenario.anchor.point, origin.value)
        self._session = session = await self._vehicle.offboard(
            f"flight {self._recorder.flight_id}",
            take_off_altitude_amsl_m=column_top_amsl_m(self._plan, self._leave_s),
            deadman_s=DEADMAN_S,
        )
        feeding = asyncio.create_task(self._feed(session))
        self._vehicle.on_motion = self._learn
        try:
            self.resume()
            on_flying()
            viewpoints = self._plan.viewpoints
            for previous, viewpoint in zip((None, *viewpoints[:-1]), viewpoints, strict=True):
                self._open_to(self._next_gate_s(viewpoint))
                if viewpoint.stops:
                    await self._photograph(viewpoint, previous)
                else:
                    await self._photograph_in_passing(viewpoint, previous)
            self._open_to(math.inf)
            stop_at_s = self._land_at_s - 0.5 / SLEW
            await self._until(lambda: self._clock.time_s >= stop_at_s, math.inf, "the way home")
            self.pause()
            await self._until(lambda: self._clock.stopped, math.inf, "the vehicle to stop over home")
            await self._vehicle.land()
            await self._passing.settle()
        finally:
            self._vehicle.on_motion = None
            feeding.cancel()
            self._passing.cancel()

    async def _predict(self) -> None:
        """Say before take-off how closely a rigid body of the vehicle's mass could fly this."""
        found = await asyncio.to_thread(forecast_tracking, self._plan)
        f = found.figures
        self._recorder.log(
            "offboard",
            f"predicted for a usual quadrotor of {found.mass_kg:g} kg in gusts of {GUSTS.deviation_m_s:g} m/s: up to "
            f"{f.deviation_m:.2f} m beside the curve, {f.mean_deviation_m:.2f} m in the mean, yaw within "
            f"{math.degrees(f.yaw_rad):.1f}°, motors up to {f.thrust_n[1] / found.most_thrust_n:.0%}",
            severity=WARNING if f.saturated_share > 0.0 else INFORMATION,
            **found.as_json(),
        )

    def setpoint(self, vehicle_s: float) -> Setpoint | None:
        """The setpoint at a time of the vehicle's clock, a little ahead of it; called from the stream's thread."""
        now = self._clock.read(vehicle_s)
        learned = self._feed_forward.at(vehicle_s)
        ahead_s = min(now.time_s + learned.tilt_lead_s * now.rate, max(self._clock.gate_s, now.time_s))
        (position, _), (velocity, velocity_ahead), (_, acceleration) = self._on_plan(
            now, np.array([now.time_s, ahead_s])
        )
        self._lead_s = learned.lead_s
        yaw_s = now.time_s - learned.lead_s * now.rate
        setpoint = Setpoint(
            position_m=self._rotation @ position + self._shift,
            velocity_m_s=self._rotation @ velocity,
            acceleration_m_s2=self._rotation @ (acceleration + learned.drag_s * velocity_ahead * HORIZONTAL),
            yaw_rad=wrap_angle(float(self._plan.yaw.value(self._warp.plan_time(yaw_s)))),
        )
        self._feed_forward.sent(vehicle_s, setpoint.position_m, setpoint.velocity_m_s)
        return setpoint

    @property
    def _due_s(self) -> float:
        """Time of the place where the vehicle is due now, which is behind its setpoints."""
        now = self._clock.now
        return now.time_s - self._lead_s * now.rate

    def _vehicle_now(self) -> float:
        """The vehicle's clock, if it is known."""
        try:
            return math.inf if self._session is None else self._session.vehicle_now()
        except LinkError:
            return math.inf

    def _open_to(self, gate_s: float) -> None:
        if gate_s != self._clock.gate_s:
            self._clock.gate_s = gate_s
            self._stream_anew()

    def _stream_anew(self) -> None:
        """Have what was changed take effect at once: setpoints that were made before are not to go out."""
        if self._session is not None:
            self._session.fly(self.setpoint)

    def _on_plan(self, now: ClockReading, times_s: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Positions, velocities and accelerations at times of the clock, shape (n, 3), as fast as it runs now."""
        plan_s = self._warp.plan_time(times_s)
        warp_rate, warp_change = self._warp.rate(times_s)[:, None], self._warp.acceleration(times_s)[:, None]
        rate = warp_rate * now.rate
        change = warp_change * now.rate**2 + warp_rate * now.rate_change
        position, velocity, acceleration = (self._plan.trajectory.value(plan_s, k) for k in range(3))
        return [position, velocity * rate, acceleration * rate**2 + velocity * change]

    def _learn(self, sample: MotionSample) -> None:
        self._feed_forward.learn(sample)
        news = self._feed_forward.news()
        if news is not None:
            text, numbers = news
            self._recorder.log("offboard", text, **numbers)

    async def _feed(self, session: OffboardSession) -> None:
        """Keep the dead-man's switch closed for as long as this task, and with it the event loop, is alive."""
        while session.active:
            session.feed()
            await asyncio.sleep(FEED_S)

    def _next_gate_s(self, viewpoint: Viewpoint) -> float:
        """Time of the first stop from a viewpoint on."""
        stops = (v for v in self._plan.viewpoints if v.stops and v.time_s >= viewpoint.time_s)
        following = next(stops, None)
        return math.inf if following is None else self._warp.time_of(following.time_s)

    async def _photograph_in_passing(self, viewpoint: Viewpoint, previous: Viewpoint | None) -> None:
        if previous is None or previous.stops or previous.gimbal_pitch_rad != viewpoint.gimbal_pitch_rad:
            await self._until_steady_no_more(previous)
            self._passing.start(self._point_camera(viewpoint))
        due = self._warp.time_of(viewpoint.time_s)
        lag = self._passing.lag_s
        await self._until(lambda: self._due_s + lag >= due, math.inf, viewpoint.name, PASSING_POLL_S)
        session = self._session
        if session is not None:
            self._passing.trigger(viewpoint, session.vehicle_now(), lambda: self._distance_from(viewpoint))
        speed = float(np.linalg.norm(self._plan.trajectory.value(viewpoint.time_s, 1)))
        self._require_near(viewpoint, FOLLOWS_M + speed * FOLLOWS_S)

    async def _until_steady_no_more(self, previous: Viewpoint | None) -> None:
        """Wait until the camera may turn away from a viewpoint that was flown through."""
        if previous is not None and not previous.stops:
            until = self._warp.time_of(previous.time_s + HOLD_S)
            await self._until(lambda: self._due_s >= until, math.inf, f"the picture of {previous.name}", PASSING_POLL_S)

    async def _point_camera(self, viewpoint: Viewpoint) -> None:
        try:
            await self._vehicle.point_gimbal(viewpoint.gimbal_pitch_rad)
        except GcsError as error:
            self._recorder.problem(f"{viewpoint.name}: the gimbal was not pointed: {error}")

    async def _photograph(self, viewpoint: Viewpoint, previous: Viewpoint | None) -> None:
        await self._until_steady_no_more(previous)
        await self._point_camera(viewpoint)
        gate = self._clock.gate_s
        await self._until(lambda: self._clock.time_s >= gate, math.inf, viewpoint.name)
        await self._passing.settle()
        try:
            await self._until(lambda: self._settled(viewpoint), SETTLE_TIMEOUT_S, f"{viewpoint.name} to settle")
        except LinkError:
            self._require_near(viewpoint, FOLLOWS_M)
            self._recorder.log(
                "viewpoint", f"{viewpoint.name}: not settled, photographed all the same", severity=WARNING
            )
        for _ in range(PICTURE_TRIES):
            before = self._collector.count
            try:
                await self._vehicle.take_picture()
                await self._until(lambda: self._collector.count > before, PICTURE_TIMEOUT_S, "the picture")  # noqa: B023
            except StreamEndedError:
                raise
            except GcsError as error:
                self._recorder.log("image", f"{viewpoint.name}: {error}", severity=WARNING)
            else:
                return
        self._recorder.problem(f"{viewpoint.name}: the vehicle announced no picture")

    def _require_near(self, viewpoint: Viewpoint, within_m: float) -> None:
        """End the flight when the vehicle is elsewhere: nothing leads it."""
        off_m = self._distance_from(viewpoint)
        if off_m is None or off_m > within_m:
            where = "not known where" if off_m is None else f"{off_m:.0f} m from where"
            text = f"it does not follow the stream: at {viewpoint.name} it is {where} it should be"
            raise RefusedError(text, field=self._vehicle.identity.name)

    def _settled(self, viewpoint: Viewpoint) -> bool:
        """Whether vehicle and camera stand still and look where they should, as far as telemetry tells."""
        telemetry = self._vehicle.telemetry
        off, velocity, yaw = self._distance_from(viewpoint), telemetry.velocity_m_s, telemetry.yaw_rad
        if off is None or velocity is None or yaw is None:
            return False
        turned = abs(wrap_angle(yaw.value - viewpoint.yaw_rad))
        still = off <= SETTLED_M and np.linalg.norm(velocity.value) <= SETTLED_M_S and turned <= SETTLED_YAW_RAD
        pitch = telemetry.gimbal_pitch_rad
        return bool(still) and (
            pitch is None or abs(wrap_angle(pitch.value - viewpoint.gimbal_pitch_rad)) <= SETTLED_PITCH_RAD
        )

    def _distance_from(self, viewpoint: Viewpoint) -> float | None:
        place = self._vehicle.telemetry.local_position_m
        if place is None:
            return None
        return float(np.linalg.norm(place.value - (self._rotation @ viewpoint.position_m + self._shift)))

    async def _until(self, holds: Callable[[], bool], timeout_s: float, what: str, poll_s: float = POLL_S) -> None:
        """Wait, and notice the stream's end meanwhile."""
        loop = asyncio.get_running_loop()
        give_up_at = loop.time() + timeout_s
        while not holds():
            session = self._session
            if session is None or session.end is not None:
                _, detail = (session and session.end) or (None, "it was never started")
                raise StreamEndedError(f"the stream of setpoints ended: {detail}")
            if loop.time() >= give_up_at:
                raise LinkError(f"waited {timeout_s:g} s in vain for {what}")
            await asyncio.sleep(poll_s)
