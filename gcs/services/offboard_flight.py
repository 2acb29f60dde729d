"""An offboard flight: the plan streamed as setpoints, halting at every viewpoint until its picture is taken.

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
from gcs.core.frames import geodetic_from_enu, rigid_between, wrap_angle
from gcs.mavlink.offboard import Setpoint
from gcs.planning.dynamics.tracking_prediction import predict_tracking, usual_quadrotor
from gcs.planning.dynamics.wind_gusts import WindGusts
from gcs.services.flight_recorder import WARNING
from gcs.services.plan_clock import PlanClock
from gcs.services.stream_feed_forward import StreamFeedForward

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.core.motion import MotionSample
    from gcs.core.plan import Plan, Viewpoint
    from gcs.mavlink.offboard import OffboardSession
    from gcs.mavlink.vehicle import Vehicle
    from gcs.planning.trajectories.retiming import TimeWarp
    from gcs.services.flight_recorder import FlightRecorder
    from gcs.services.image_collector import ImageCollector
    from gcs.services.plan_clock import ClockReading

HORIZONTAL = np.array([1.0, 1.0, 0.0])
COLUMN_M = 0.2
"""Within this of home, seen from above, the vehicle is in the take-off and landing column."""

SLEW = 0.4
"""Change of the plan clock's rate per second; from full rate it stops within 1 / (2 SLEW) s of plan time."""

FOLLOWS_M = 2.0
"""A vehicle that is further than this from where it should stand does not follow the stream."""

GUSTS = WindGusts(deviation_m_s=1.0)
"""Wind for the prediction before take-off: light gusts."""

INFORMATION = 6
FEED_S = 0.1
DEADMAN_S = 1.0
"""The stream outlives a stall of the event loop by no more than this: the shortest patience of an autopilot."""
SETTLE_TIMEOUT_S = 10.0
SETTLED_M, SETTLED_M_S = 0.3, 0.3
SETTLED_YAW_RAD, SETTLED_PITCH_RAD = math.radians(5.0), math.radians(3.0)
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
    """

    def __init__(
        self, plan: Plan, warp: TimeWarp, vehicle: Vehicle, recorder: FlightRecorder, collector: ImageCollector
    ) -> None:
        self._plan = plan
        self._warp = warp
        self._vehicle = vehicle
        self._recorder = recorder
        self._collector = collector
        self._session: OffboardSession | None = None
        leave, enter = column_times(plan)
        self._clock = PlanClock(warp.time_of(leave), slew=SLEW, paused=True)
        self._land_at_s = warp.time_of(enter)
        self._take_off_m = float(plan.trajectory.value(leave)[2])
        self._rotation = np.eye(3)
        self._shift = np.zeros(3)
        self._feed_forward = StreamFeedForward(accelerates=vehicle.takes_acceleration_forward)
        self._due_s = self._clock.time_s

    @property
    def plan_time_s(self) -> float:
        """How far along the plan the vehicle is due to be."""
        return float(self._warp.plan_time(self._due_s))

    def pause(self) -> None:
        """Slow down to a hover; the stream goes on."""
        self._clock.pause()

    def resume(self) -> None:
        """Go on after a pause."""
        self._clock.resume()

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
        altitude = geodetic_from_enu(
            [*self._plan.scenario.home_m[:2], self._take_off_m], self._plan.scenario.anchor.point
        )
        self._session = session = await self._vehicle.offboard(
            f"flight {self._recorder.flight_id}", take_off_altitude_amsl_m=float(altitude[2]), deadman_s=DEADMAN_S
        )
        feeding = asyncio.create_task(self._feed(session))
        self._vehicle.on_motion = self._learn
        try:
            session.fly(self.setpoint)
            on_flying()
            self._clock.resume()
            for viewpoint in self._plan.viewpoints:
                await self._photograph(viewpoint)
            self._clock.gate_s = math.inf
            stop_at_s = self._land_at_s - 0.5 / SLEW
            await self._until(lambda: self._clock.time_s >= stop_at_s, math.inf, "the way home")
            self._clock.pause()
            await self._until(lambda: self._clock.stopped, math.inf, "the vehicle to stop over home")
            await self._vehicle.land()
        finally:
            self._vehicle.on_motion = None
            feeding.cancel()

    async def _predict(self) -> None:
        """Say before take-off how closely a rigid body of the vehicle's mass could fly this."""
        plan, parameters = self._plan, usual_quadrotor(self._plan.scenario.vehicle.mass_kg)
        found = await asyncio.to_thread(
            predict_tracking,
            plan.trajectory,
            plan.yaw,
            parameters=parameters,
            gusts=GUSTS,
            seed=plan.scenario.planner.seed,
        )
        hardest = found.thrust_n[1] / parameters.max_motor_thrust_n
        self._recorder.log(
            "offboard",
            f"predicted for a usual quadrotor of {parameters.mass_kg:g} kg in gusts of {GUSTS.deviation_m_s:g} m/s: "
            f"up to {found.deviation_m:.2f} m beside the curve, {found.mean_deviation_m:.2f} m in the mean, yaw within "
            f"{math.degrees(found.yaw_rad):.1f}°, motors up to {hardest:.0%}",
            severity=WARNING if found.saturated_share > 0.0 else INFORMATION,
            deviation_m=found.deviation_m,
            mean_deviation_m=found.mean_deviation_m,
            axes_m=list(found.axes_m),
            yaw_rad=found.yaw_rad,
            thrust_n=list(found.thrust_n),
            saturated_share=found.saturated_share,
        )

    def setpoint(self, vehicle_s: float) -> Setpoint | None:
        """The setpoint at a time of the vehicle's clock; called from the stream's thread."""
        now = self._clock.read(vehicle_s)
        learned = self._feed_forward.at(vehicle_s)
        ahead_s = min(now.time_s + learned.tilt_lead_s * now.rate, max(self._clock.gate_s, now.time_s))
        (position, _), (velocity, velocity_ahead), (_, acceleration) = self._on_plan(
            now, np.array([now.time_s, ahead_s])
        )
        self._due_s = now.time_s - learned.lead_s * now.rate
        setpoint = Setpoint(
            position_m=self._rotation @ position + self._shift,
            velocity_m_s=self._rotation @ velocity,
            acceleration_m_s2=self._rotation @ (acceleration + learned.drag_s * velocity_ahead * HORIZONTAL),
            yaw_rad=wrap_angle(float(self._plan.yaw.value(self._warp.plan_time(self._due_s)))),
        )
        self._feed_forward.sent(vehicle_s, setpoint.position_m, setpoint.velocity_m_s)
        return setpoint

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

    async def _photograph(self, viewpoint: Viewpoint) -> None:
        self._clock.gate_s = gate = self._warp.time_of(viewpoint.time_s)
        try:
            await self._vehicle.point_gimbal(viewpoint.gimbal_pitch_rad)
        except GcsError as error:
            self._recorder.problem(f"{viewpoint.name}: the gimbal was not pointed: {error}")
        await self._until(lambda: self._clock.time_s >= gate, math.inf, viewpoint.name)
        try:
            await self._until(lambda: self._settled(viewpoint), SETTLE_TIMEOUT_S, f"{viewpoint.name} to settle")
        except LinkError:
            off_m = self._distance_from(viewpoint)
            if off_m is None or off_m > FOLLOWS_M:
                where = "not known where" if off_m is None else f"{off_m:.0f} m from where"
                text = f"it does not follow the stream: at {viewpoint.name} it is {where} it should be"
                raise RefusedError(text, field=self._vehicle.identity.name) from None
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

    async def _until(self, holds: Callable[[], bool], timeout_s: float, what: str) -> None:
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
            await asyncio.sleep(0.05)


def column_times(plan: Plan) -> tuple[float, float]:
    """When the plan leaves the take-off column over home, and when it has entered the landing column (plan time, s).

    A plan that begins in the air leaves at 0.
    """
    t = np.arange(0.0, plan.trajectory.duration_s, 0.02)
    p = plan.trajectory.value(t)
    aside = np.hypot(*(p - np.asarray(plan.scenario.home_m))[:, :2].T)
    outside = np.flatnonzero(aside > COLUMN_M)
    if len(outside) == 0:
        return 0.0, 0.0
    first, last = int(outside[0]), int(outside[-1])
    return float(t[max(first - 1, 0)]), float(t[min(last + 1, len(t) - 1)])
