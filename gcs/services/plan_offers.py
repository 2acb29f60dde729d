"""Plans offered for what flights skipped: made by the planning jobs, and accepted or refused by the operator."""

from __future__ import annotations

import asyncio
import logging
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.core.clock import new_id, utc_now
from gcs.core.errors import ConflictError, GcsError, OperationCancelled
from gcs.services.flight_recorder import ERROR, NOTICE, log_line
from gcs.services.live_feed import FeedEvent, FlightChanged, LiveFeed, OfferChanged, ReplanStored
from gcs.services.remaining_flight import pictured_before
from gcs.services.replan_difference import viewpoint_fates
from gcs.services.replan_reports import reported_differences
from gcs.services.resumed_plan import write_plan_from_home
from gcs.storage.atomic_files import open_folder
from gcs.storage.plan_files import read_report
from gcs.storage.records import Failure, OfferState, PlanOfferRecord, ViewpointFateName

if TYPE_CHECKING:
    from collections.abc import Coroutine
    from typing import Any

    from gcs.core.plan import Viewpoint
    from gcs.core.progress import Progress
    from gcs.jobs.planning_jobs import PlanningJobs
    from gcs.services.plan_service import PlanService
    from gcs.storage.database import Database

log = logging.getLogger(__name__)


def offer_job(progress: Progress, directory: str, viewpoints: tuple[int, ...], out: str) -> None:
    """What a worker process does for one offer."""
    write_plan_from_home(progress, Path(directory), viewpoints, Path(out))


class PlanOffers:
    """Offers of the station. Each is a plan from home through exactly the viewpoints that one flight skipped.

    Args:
        database: where they are listed.
        feed: the dashboards; it also tells when a flight is over.
        plans: the station's plans, of which an accepted offer becomes one.
        jobs: runs the planning.
        data_dir: the data directory; what is offered is in its folder `offers` until it is accepted.
    """

    def __init__(
        self, database: Database, feed: LiveFeed, plans: PlanService, jobs: PlanningJobs, data_dir: Path
    ) -> None:
        self._database = database
        self._feed = feed
        self._plans = plans
        self._jobs = jobs
        self._folder = data_dir / "offers"
        self._tasks: set[asyncio.Task[None]] = set()
        self._asking = asyncio.Lock()

    def open(self, *, by_itself: bool) -> None:
        """Make the folder and clear up what a killed station left.

        Args:
            by_itself: whether a plan is offered when a flight is over, not only on request.

        Raises:
            StorageError: it cannot be made.
        """
        open_folder(self._folder)
        for offer in self._database.offers.in_state(OfferState.PLANNING):
            why = Failure("Interrupted", "the station ended while this plan was being made: ask for it again")
            self._database.offers.update(offer.id, state=OfferState.FAILED, failure=vars(why))
        if by_itself:
            self._feed.listen(self._hear)

    async def close(self) -> None:
        """End all planning of offers."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def of_flight(self, flight_id: str) -> tuple[PlanOfferRecord, ...]:
        """The offers of a flight, oldest first.

        Raises:
            NotFoundError: there is no such flight.
        """
        return self._database.offers.of_flight(self._database.flights.get(flight_id).id)

    async def request(self, flight_id: str) -> PlanOfferRecord:
        """Begin to make an offer, as an operator asks; one for the same viewpoints that still stands is that offer.

        Raises:
            NotFoundError: there is no such flight.
            ConflictError: every viewpoint that the flight skipped has its picture, or it skipped none.
        """
        offer = await self._offer(flight_id, again=frozenset({OfferState.FAILED, OfferState.REFUSED}))
        if offer is None:
            raise ConflictError("this flight skipped no viewpoint that has no picture yet", field="flight_id")
        return offer

    async def _offer(self, flight_id: str, again: frozenset[OfferState]) -> PlanOfferRecord | None:
        """The offer for what a flight skipped, made if need be; None when nothing is to be flown again.

        Args:
            flight_id: of the flight.
            again: states in which an offer for the same viewpoints does not keep a new one from being made.
        """
        async with self._asking:
            flight = self._database.flights.get(flight_id)
            skipped = await asyncio.to_thread(self._skipped, flight_id, flight.plan_id)
            if not skipped:
                return None
            viewpoints = tuple(v.id for v in skipped)
            earlier = self._database.offers.of_flight(flight_id)
            if earlier and earlier[-1].viewpoints == viewpoints and earlier[-1].state not in again:
                return earlier[-1]
            for offer in earlier:
                if offer.state.open:
                    self._change(offer.id, state=OfferState.SUPERSEDED)
                    await self._jobs.cancel(offer.id)
                    self._remove_files(offer)
            offer = PlanOfferRecord(
                id=new_id("offer"),
                flight_id=flight_id,
                state=OfferState.PLANNING,
                created_at=utc_now(),
                viewpoints=viewpoints,
                names=tuple(v.name for v in skipped),
            )
            self._database.offers.add(offer)
            self._feed.publish(OfferChanged(offer))
            self._spawn(self._make(offer, flight.plan_id))
            return offer

    def accept(self, offer_id: str) -> PlanOfferRecord:
        """Make the offered plan one of the station's plans; one that is accepted already stays as it is.

        Raises:
            NotFoundError: there is no such offer.
            ConflictError: it cannot be accepted; says how it stands.
        """
        offer = self._database.offers.get(offer_id)
        if offer.state is OfferState.ACCEPTED:
            return offer
        self._demand(offer, OfferState.OFFERED)
        flown = self._plans.get(self._database.flights.get(offer.flight_id).plan_id).plan
        plan = self._plans.adopt(self._folder / offer.id, f"{flown.name}, what was skipped").plan
        self._remove_files(offer)
        self._say(offer, f"the plan for what was skipped is accepted: {plan.id}")
        return self._change(offer.id, state=OfferState.ACCEPTED, decided_at=utc_now(), plan_id=plan.id)

    def refuse(self, offer_id: str) -> PlanOfferRecord:
        """Write down that the offered plan is not wanted; one that is refused already stays as it is.

        Raises:
            NotFoundError: there is no such offer.
            ConflictError: it cannot be refused; says how it stands.
        """
        offer = self._database.offers.get(offer_id)
        if offer.state is OfferState.REFUSED:
            return offer
        self._demand(offer, OfferState.OFFERED)
        self._remove_files(offer)
        self._say(offer, "the plan for what was skipped is refused")
        return self._change(offer.id, state=OfferState.REFUSED, decided_at=utc_now())

    def _hear(self, event: FeedEvent) -> None:
        match event:
            case FlightChanged(overview) if overview.flight.state.over:
                self._spawn(self._consider(overview.flight.id))
            case ReplanStored(view):  # one that came late, too
                self._spawn(self._consider(view.record.flight_id))
            case _:
                pass

    async def _consider(self, flight_id: str) -> None:
        """Offer by itself, when a flight is over."""
        try:
            if self._database.flights.get(flight_id).state.over and self._database.replans.of_flight(flight_id):
                await self._offer(flight_id, again=frozenset())
        except GcsError:
            log.exception("flight %s: no plan could be offered", flight_id)

    def _skipped(self, flight_id: str, plan_id: str) -> list[Viewpoint]:
        """Viewpoints that a flight skipped for good and that no flight has pictured, in the plan's order."""
        fates = viewpoint_fates(reported_differences(self._database, self._plans, flight_id))
        skipped = {viewpoint for viewpoint, fate in fates.items() if fate is ViewpointFateName.SKIPPED}
        if not skipped:
            return []
        plan = self._plans.read(plan_id)
        skipped -= pictured_before(plan, self._database, self._plans)
        return [v for v in plan.viewpoints if v.id in skipped]

    async def _make(self, offer: PlanOfferRecord, plan_id: str) -> None:
        out = self._folder / offer.id
        try:
            directory = str(self._plans.directory(plan_id))
            await self._jobs.run(offer.id, offer_job, directory, offer.viewpoints, str(out), tell=_nobody)
            report = read_report(out)
        except OperationCancelled:  # a newer offer has taken its place
            return
        except GcsError as error:
            self._fail(offer, Failure(error.title, error.message, error.field))
        except Exception as error:
            log.exception("offer %s failed", offer.id)
            self._fail(offer, Failure("Internal fault", f"planning failed unexpectedly ({error!r})"))
        else:
            length_m, duration_s = float(report["length_m"]), float(report["duration_s"])
            self._change(offer.id, state=OfferState.OFFERED, length_m=length_m, duration_s=duration_s)
            what = f"{length_m:.0f} m in {duration_s:.0f} s through the {len(offer.names)} skipped viewpoints"
            self._say(offer, f"a new plan is offered: {what}")

    def _fail(self, offer: PlanOfferRecord, failure: Failure) -> None:
        self._change(offer.id, state=OfferState.FAILED, failure=vars(failure))
        self._say(offer, f"there is no plan for what was skipped: {failure.message}", severity=ERROR)

    def _change(self, offer_id: str, **changes: Any) -> PlanOfferRecord:
        offer = self._database.offers.update(offer_id, **changes)
        self._feed.publish(OfferChanged(offer))
        return offer

    def _say(self, offer: PlanOfferRecord, text: str, severity: int = NOTICE) -> None:
        log_line(self._database, self._feed, offer.flight_id, "offer", text, severity=severity, offer=offer.id)

    def _remove_files(self, offer: PlanOfferRecord) -> None:
        shutil.rmtree(self._folder / offer.id, ignore_errors=True)

    def _spawn(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    @staticmethod
    def _demand(offer: PlanOfferRecord, state: OfferState) -> None:
        if offer.state is not state:
            when = f" since {offer.decided_at}" if offer.decided_at else ""
            raise ConflictError(f"this offer is {offer.state}{when}", field="offer_id")


def _nobody(stage: str, fraction: float) -> None:
    """How far the planning of an offer is, is not shown."""
