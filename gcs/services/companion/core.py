"""The companion as one synchronous state machine: told of messages and of time, it sends through what it was given.

It owns the vehicle's setpoints only by a lease that a station ordered, and only while the vehicle does what the
companion commanded; any other change of mode ends the lease at once, and nothing but a new order begins another. It
never leaves return, landing or a pilot's mode. The station is needed for orders alone: a flight goes on without it.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from gcs.core.errors import GcsError, InputError
from gcs.core.replanning import ReplanReason
from gcs.mavlink.companion_lease import (
    COMPANION,
    NO_HASH,
    OVER,
    LeaseOrder,
    LeaseState,
    LeaseStatus,
    OrderKind,
    lease_order,
    lease_status_message,
)
from gcs.mavlink.dialect import mavlink
from gcs.mavlink.heartbeats import autopilot_of, is_vehicle
from gcs.mavlink.plan_announcement import announced_plan
from gcs.mavlink.stepped_channel import SteppedTask
from gcs.services.companion.announced_plans import AnnouncedPlans
from gcs.services.companion.companion_options import CompanionOptions
from gcs.services.companion.departure_report import departure_reports, unreached
from gcs.services.companion.lease_memory import LeaseMemory
from gcs.services.companion.led_flight import LedFlight, Progress
from gcs.services.companion.objections import OBJECTION_S, away_from_start, unfit_senses, unwell_in_flight
from gcs.services.companion.operator_texts import OperatorTexts
from gcs.services.companion.own_vehicle import OwnVehicle
from gcs.services.companion.senses import SENSOR_MESSAGES, Senses
from gcs.storage.lease_file import KeptLease

if TYPE_CHECKING:
    from collections.abc import Callable

    from gcs.mavlink.dialect import Message
    from gcs.mavlink.transaction import Clock, Send
    from gcs.planning.local.local_replan import LocalReplan
    from gcs.services.companion.doors import Outbox, PlanSource
    from gcs.services.companion.flyable_plan import FlyablePlan
    from gcs.services.companion.senses import Measured

log = logging.getLogger(__name__)

HEARTBEAT_S = 1.0
STATUS_S = 0.5
WATCH_S = 0.1
ORDER_STANDS_S = 5.0
"""An order that cannot be followed yet stands for so long after it was last heard."""

AUTOPILOT_SILENT_S = 3.0
OWN_ERROR = "an error in the companion, see its log"


class CompanionCore:
    """See the module.

    Args:
        system_id: of the vehicle.
        send: puts a message on the link to the autopilot, which passes on what is for the station.
        clock: monotonic seconds.
        plans: where plans come from.
        outbox: delivers reports.
        options: how it is set up.
        memory: of the time before a restart.
    """

    def __init__(
        self,
        *,
        system_id: int,
        send: Send,
        clock: Clock,
        plans: PlanSource,
        outbox: Outbox,
        options: CompanionOptions | None = None,
        memory: LeaseMemory | None = None,
    ) -> None:
        self._options = options or CompanionOptions()
        self._system_id = system_id
        self._send = send
        self._clock = clock
        self._plans = plans
        self._outbox = outbox
        self._announced = AnnouncedPlans(plans, clock)
        self._texts = OperatorTexts(send, clock)
        self._senses = Senses(self._options.slab_half_m, self._texts.say)
        self._vehicle: OwnVehicle | None = None
        self._introduction: SteppedTask | None = None
        self._flight: LedFlight | None = None
        self._flyable: FlyablePlan | None = None
        self._progress: dict[str, Progress] = {}
        self._order: LeaseOrder | None = None
        self._heard_order_at = float("-inf")
        self._objects_since: float | None = None
        self._past_leases: set[int] = set()
        self._state = LeaseState.IDLE
        self._text = ""
        self._beat_at = self._tell_at = self._watch_at = clock()
        self._memory = memory or LeaseMemory(None)
        self._cut_short: KeptLease | None = None
        """The lease that led the vehicle when the companion was restarted, until what it left is told."""
        if self._memory.before is not None:
            self._take_up(self._memory.before)

    # ---- what it is told ----

    @property
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next."""
        due = [self._beat_at, self._tell_at, self._watch_at, self._outbox.deadline, self._senses.deadline]
        if self._introduction is not None:
            due.append(self._introduction.deadline)
        if self._flight is not None and not self._flight.over:
            due.append(self._flight.deadline)
        return min(due)

    def handle(self, message: Message) -> None:
        """Take a message from the link, of whomever."""
        if message.get_type() == "TUNNEL":
            self._take_tunnel(message)
        elif message.get_srcSystem() == self._system_id and message.get_srcComponent() != COMPANION:
            self._take_own(message)

    def on_time(self) -> None:
        """Called when `deadline` has passed, or earlier."""
        now = self._clock()
        flight = self._flight
        if self._vehicle is not None and self._senses.deadline <= now:
            self._see(self._senses.on_time(self._vehicle))
        if flight is not None and not flight.over and flight.deadline <= now:
            self._guard(flight.on_time)
        if self._introduction is not None and self._introduction.deadline <= now:
            self._introduction.on_time()
        if self._outbox.deadline <= now:
            self._outbox.on_time()
        if now >= self._watch_at:
            self._watch_at = now + WATCH_S
            self._watch()
        self._notice_end()
        if now >= self._beat_at:
            self._beat_at = now + HEARTBEAT_S
            self._send(heartbeat(leading=self._leading))
        if now >= self._tell_at:
            self._tell()

    def fail(self) -> None:
        """An error of this program's own, which was logged: lead no more, and have the vehicle hold."""
        if self._flight is not None:
            self._flight.fail(OWN_ERROR)

    @property
    def status(self) -> LeaseStatus:
        """What is told of the lease."""
        now = None if self._vehicle is None else self._vehicle.now_s()
        quality = self._senses.odometry.quality
        departing = None if self._flight is None or self._flight.over else self._flight.departing
        return LeaseStatus(
            lease=0 if self._order is None else self._order.lease,
            state=self._state,
            away=departing or 0,
            plan_hash=NO_HASH if self._order is None else self._order.plan_hash,
            plan_time_s=self._so_far.plan_s or 0.0 if self._flight is None else self._flight.plan_time_s,
            vehicle_s=now or 0.0,
            reports_pending=self._outbox.pending,
            lidar_age_s=None if now is None else self._senses.lidar_age_s(now),
            odometry_quality=-1 if quality is None else quality,
            text=self._text,
        )

    # ---- the vehicle ----

    @property
    def _leading(self) -> bool:
        return self._flight is not None and not self._flight.over

    def _take_own(self, message: Message) -> None:
        kind = message.get_type()
        if self._vehicle is None:
            if kind == "HEARTBEAT" and is_vehicle(message):
                self._meet(message)
            return
        change = self._vehicle.handle(message)
        flight = self._flight
        if change is not None and flight is not None:
            self._guard(lambda: flight.mode_changed(change))
        if kind in SENSOR_MESSAGES:
            self._see(self._senses.take(message, self._vehicle))
        if self._introduction is not None:
            self._introduction.handle(message)
        if flight is not None and not flight.over:
            self._guard(lambda: flight.handle(message))
        self._notice_end()

    def _meet(self, heartbeat: Message) -> None:
        target = (self._system_id, heartbeat.get_srcComponent())
        sender = (self._system_id, COMPANION)
        self._vehicle = OwnVehicle(autopilot_of(heartbeat), target, sender, self._send, self._clock)
        self._vehicle.handle(heartbeat)
        self._introduction = SteppedTask(self._vehicle.introduce())

    def _see(self, measured: Measured | None) -> None:
        flight = self._flight
        if measured is None or flight is None or flight.over:
            return

        def see() -> None:
            try:
                flight.see(*measured)
            except InputError as error:
                self._senses.refuse(error, measured[1])
            else:
                flight.react()

        self._guard(see)

    def _guard(self, fly: Callable[[], None]) -> None:
        """Go on with the flight; an error of the planner's own must not leave the vehicle to what it flew before."""
        try:
            fly()
        except Exception:
            log.exception("the flight cannot go on")
            self.fail()

    # ---- orders ----

    def _take_tunnel(self, message: Message) -> None:
        if message.target_system not in (0, self._system_id) or message.target_component not in (0, COMPANION):
            return
        self._outbox.handle(message)
        announced, order = announced_plan(message), lease_order(message)
        if announced is not None:
            self._send(self._announced.answer(announced, *self._fitness()))
            self._mind_hull(self._announced.plan)
        if order is None:
            return
        if order.kind is OrderKind.FLY:
            self._take_fly(order)
        elif self._order is not None and order.lease == self._order.lease and self._flight is not None:
            self._take_change(order.kind, self._flight)
        self._tell()

    def _take_fly(self, order: LeaseOrder) -> None:
        if self._order is not None and order.lease == self._order.lease:
            self._heard_order_at = self._clock()
        elif order.lease in self._past_leases:
            self._answer(order, LeaseState.REFUSED, "this lease is over")
        elif self._leading:
            self._answer(order, LeaseState.REFUSED, "another lease leads the vehicle")
        else:
            self._past_leases.add(order.lease)
            self._order, self._heard_order_at, self._objects_since = order, self._clock(), None
            self._flight = None
            self._enter(LeaseState.IDLE, "prepares")
            self._begin()

    def _take_change(self, kind: OrderKind, flight: LedFlight) -> None:
        if flight.over:
            return
        if kind is OrderKind.PAUSE:
            flight.hold("order")
            self._enter(LeaseState.PAUSED, "paused by order")
        elif kind is OrderKind.RESUME:
            flight.release("order")
            self._enter(LeaseState.LEADING, "goes on by order")
        else:
            flight.leave("ended by order")

    def _begin(self) -> None:
        """Follow the order to fly, as soon as nothing speaks against it."""
        order, vehicle = self._order, self._vehicle
        if order is None or self._state is not LeaseState.IDLE:
            return
        now = self._clock()
        if now - self._heard_order_at > ORDER_STANDS_S:
            self._enter(LeaseState.REFUSED, "the order was not heard again")
            return
        try:
            objection = self._objection(order, vehicle)
        except GcsError as error:
            self._enter(LeaseState.REFUSED, error.message)
            return
        if objection is None:
            self._lead(order)
        elif objection == "":
            self._objects_since = None
        else:
            self._objects_since = self._objects_since or now
            self._text = objection
            if now - self._objects_since > OBJECTION_S:
                self._enter(LeaseState.REFUSED, objection)

    def _objection(self, order: LeaseOrder, vehicle: OwnVehicle | None) -> str | None:
        """What speaks against an order to fly; empty while the plan is being got, None when nothing does.

        Raises:
            GcsError: the plan cannot be had.
        """
        if vehicle is None:
            return "the autopilot is not heard"
        now = vehicle.now_s()
        if now is None or vehicle.offboard_timeout_s is None:
            self._text = "gets to know the autopilot"
            return ""
        self._flyable = self._plans.get(order.plan_hash, vehicle.offboard_timeout_s)
        self._mind_hull(self._flyable)
        if self._flyable is None:
            self._text = "gets the plan"
            return ""
        if not vehicle.in_air:
            return "the vehicle does not fly"
        if not vehicle.may_be_led:
            name = vehicle.telemetry.mode_name
            return f"the vehicle is in {'no mode' if name is None else name.value}, not held"
        unfit = unfit_senses(self._senses, self._options, now)
        return unfit or away_from_start(self._flyable, vehicle, now, self._progress_on(self._flyable).plan_s)

    def _fitness(self) -> tuple[float | None, str | None]:
        """The autopilot's time without setpoints, once known, and what speaks against flying any plan at present."""
        vehicle = self._vehicle
        now = None if vehicle is None else vehicle.now_s()
        if vehicle is None or now is None:
            return None, None
        objection = "it flies another plan" if self._leading else None
        objection = objection or unfit_senses(self._senses, self._options, now)
        return vehicle.offboard_timeout_s, objection

    def _mind_hull(self, flyable: FlyablePlan | None) -> None:
        if flyable is not None:
            self._senses.hull_m = flyable.plan.scenario.vehicle.radius_m

    def _progress_on(self, flyable: FlyablePlan) -> Progress:
        return self._progress.setdefault(flyable.plan_hash, Progress())

    # ---- what it remembers ----

    @property
    def _so_far(self) -> Progress:
        """Of the last order's plan."""
        return Progress() if self._order is None else self._progress.get(self._order.plan_hash, Progress())

    def _take_up(self, before: KeptLease) -> None:
        """Know what was so before a restart; a vehicle that flies has found its own hold, and waits for an order."""
        self._order = LeaseOrder(before.lease, OrderKind.FLY, before.plan_hash)
        self._past_leases.add(before.lease)
        self._progress[before.plan_hash] = Progress(before.plan_s, set(before.done))
        if before.state in OVER:
            self._state, self._text = LeaseState(before.state), "restarted"
        else:
            self._state, self._text = LeaseState.ENDED, f"restarted; {len(before.done)} viewpoints were done"
            self._cut_short = before

    def _account_for_cut_short(self, vehicle: OwnVehicle, now_s: float | None) -> None:
        """Tell what a lease that was cut short by a restart left, as soon as its plan is at hand."""
        before, order = self._cut_short, self._order
        if before is None or order is None or now_s is None or vehicle.offboard_timeout_s is None:
            return
        if order.lease == before.lease:
            try:
                self._flyable = self._plans.get(before.plan_hash, vehicle.offboard_timeout_s)
            except GcsError as error:
                self._texts.say(f"what the lease before the restart left is not reported: {error.message}")
                self._cut_short = None
                return
            if self._flyable is None:
                return
            rest = tuple(v.id for v in self._flyable.plan.viewpoints if v.id not in before.done)
            if rest:
                self._departed(unreached(ReplanReason.LEASE_ENDED, rest, now_s, before.plan_s or 0.0))
        self._cut_short = None

    def _remember(self) -> None:
        if self._order is not None:
            so_far, order = self._so_far, self._order
            done = tuple(sorted(so_far.done))
            self._memory.remember(KeptLease(order.lease, self._state, order.plan_hash, so_far.plan_s, done))

    def _forget_flown(self, vehicle: OwnVehicle) -> None:
        """What is flown after a landing begins anew."""
        if self._progress and not self._leading and vehicle.on_ground:
            self._progress.clear()

    def _lead(self, order: LeaseOrder) -> None:
        assert self._vehicle is not None and self._flyable is not None  # nothing speaks against it
        self._vehicle.guard.take_back()  # by the order, which an operator gave
        self._flight = LedFlight(
            self._flyable,
            self._vehicle,
            self._progress_on(self._flyable),
            self._departed,
            self._texts.say,
            stream_hz=self._options.stream_hz,
            slab_half_m=self._options.slab_half_m,
        )
        self._enter(LeaseState.LEADING, f"leads, lease {order.lease:08x}")
        self._flight.start()
        self._notice_end()

    def _departed(self, replan: LocalReplan) -> None:
        assert self._flyable is not None  # a flight of it reports
        plan, plan_hash = self._flyable.plan, self._flyable.plan_hash
        for report in departure_reports(replan, plan, plan_hash, self._outbox.boot_id):
            self._outbox.add(report)
        self._tell_at = self._clock()

    # ---- what it watches ----

    def _watch(self) -> None:
        vehicle = self._vehicle
        if vehicle is None:
            return
        vehicle.on_time()
        if self._introduction is not None and self._introduction.finished:
            self._introduction = None
        now, flight = vehicle.now_s(), self._flight
        self._account_for_cut_short(vehicle, now)
        self._forget_flown(vehicle)
        self._begin()
        self._remember()
        if flight is None or flight.over or now is None:
            return
        if not vehicle.is_fresh("armed", AUTOPILOT_SILENT_S):
            flight.stop("the autopilot is not heard")
            return
        for what, problem in unwell_in_flight(vehicle, self._senses, self._options, now).items():
            if problem is None:
                flight.release(what)
                continue
            if what not in flight.hold_reasons:
                self._texts.say_measured(f"{problem}: slows to a hover")
            flight.hold(what)
            if flight.held_for_s(what) > self._options.give_up_s:
                flight.leave(f"{problem}, for {self._options.give_up_s:.0f} s")

    def _notice_end(self) -> None:
        flight = self._flight
        if flight is None or self._state not in (LeaseState.LEADING, LeaseState.PAUSED):
            return
        if flight.finished:
            if self._order is not None:
                self._progress.pop(self._order.plan_hash, None)
            self._enter(LeaseState.FINISHED, "the plan is flown; the vehicle lands")
        elif flight.ended is not None:
            self._enter(LeaseState.TAKEN_OVER if flight.taken_over else LeaseState.ENDED, flight.ended)
            self._texts.say(f"lease ended: {flight.ended}")

    # ---- what it tells ----

    def _enter(self, state: LeaseState, text: str) -> None:
        self._state, self._text = state, text
        self._remember()
        self._tell()

    def _answer(self, order: LeaseOrder, state: LeaseState, text: str) -> None:
        """Tell the state of a lease that is not, or no longer, the one that counts."""
        self._send(lease_status_message(LeaseStatus(order.lease, state, plan_hash=order.plan_hash, text=text)))

    def _tell(self) -> None:
        self._tell_at = self._clock() + STATUS_S
        self._send(lease_status_message(self.status))


def heartbeat(*, leading: bool) -> Message:
    """What the companion says of itself."""
    state = mavlink.MAV_STATE_ACTIVE if leading else mavlink.MAV_STATE_STANDBY
    kind = mavlink.MAV_TYPE_ONBOARD_CONTROLLER
    return mavlink.MAVLink_heartbeat_message(kind, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, state, 3)
