"""The answer to PLAN_ANNOUNCE: whether the companion could fly a plan, asked on the ground before anything is armed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.core.errors import GcsError
from gcs.mavlink.plan_announcement import plan_not_ready_message, plan_ready_message
from gcs.services.companion.objections import OBJECTION_S

if TYPE_CHECKING:
    from gcs.mavlink.dialect import Message
    from gcs.mavlink.transaction import Clock
    from gcs.services.companion.doors import PlanSource
    from gcs.services.companion.flyable_plan import FlyablePlan

SAME_ASKING_S = 5.0
"""A station that asks repeats itself; after a pause of so long it is asked anew, and an old failure counts no more."""


class AnnouncedPlans:
    """Prepares what is announced, and says where that stands; a plan is acknowledged only when it could be flown now.

    Args:
        plans: where plans come from.
        clock: monotonic seconds.

    Attributes:
        plan: the last that was ready.
    """

    def __init__(self, plans: PlanSource, clock: Clock) -> None:
        self._plans = plans
        self._clock = clock
        self.plan: FlyablePlan | None = None
        self._plan_hash = ""
        self._asked_at = float("-inf")
        self._objects_since: float | None = None

    def answer(self, plan_hash: str, offboard_timeout_s: float | None, objection: str | None) -> Message:
        """The answer to one announcement.

        Args:
            plan_hash: that was announced.
            offboard_timeout_s: of the autopilot (see PlanSource); None while that is not known.
            objection: what speaks against flying whatever plan; None when nothing does.
        """
        now = self._clock()
        anew = plan_hash != self._plan_hash or now - self._asked_at > SAME_ASKING_S
        self._plan_hash, self._asked_at = plan_hash, now
        if objection is None or anew:
            self._objects_since = None
        if objection is not None:
            since = now if self._objects_since is None else self._objects_since
            refused = now - since > OBJECTION_S
            self._objects_since = None if refused else since  # whoever asks after a refusal, asks anew
            return plan_not_ready_message(plan_hash, objection, refused=refused)
        if offboard_timeout_s is None:
            return plan_not_ready_message(plan_hash, "gets to know the autopilot", refused=False)
        try:
            plan = self._plan(plan_hash, offboard_timeout_s, anew=anew)
        except GcsError as error:
            return plan_not_ready_message(plan_hash, str(error), refused=True)
        if plan is None:
            return plan_not_ready_message(plan_hash, "gets the plan and makes it ready", refused=False)
        self.plan = plan
        return plan_ready_message(plan_hash)

    def _plan(self, plan_hash: str, offboard_timeout_s: float, *, anew: bool) -> FlyablePlan | None:
        try:
            return self._plans.get(plan_hash, offboard_timeout_s)
        except GcsError:
            if not anew:
                raise
            return self._plans.get(plan_hash, offboard_timeout_s)
