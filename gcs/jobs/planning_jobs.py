"""Background jobs on an embedded `dask.distributed` cluster, started when the first job comes.

The scheduler runs in a thread of its own and the work in a process of its own, so that neither slows the station down.
A running task cannot be stopped from outside: its progress object is told of a cancel through the worker's event loop
and raises `OperationCancelled` at the task's next report.
"""

from __future__ import annotations

import asyncio
import logging
import os
import time
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from gcs.core.errors import GcsError, OperationCancelled

if TYPE_CHECKING:
    from distributed import Client, Future, LocalCluster, WorkerPlugin

log = logging.getLogger(__name__)

R = TypeVar("R")
Tell = Callable[[str, float], None]

TOPIC = "gcs-progress"
REPORT_EVERY_S = 0.1
CLOSE_TIMEOUT_S = 10.0
OBEY_S = 0.7
NICENESS = 10
"""Of the worker processes: planning takes what the station and whatever else runs leave of the machine."""
CANCELLED = "planning was cancelled"

_CONFIG = {
    "distributed.scheduler.allowed-failures": 0,
    # It always opens an HTTP port: on loopback, any free one, and with nothing behind it.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}

_cancelled: set[str] = set()
"""In a worker process: jobs that are to stop."""


@dataclass(frozen=True)
class _Outcome:
    """What a task gives back; errors that users may see come as values, so that nobody logs them as faults."""

    result: Any
    error: GcsError | None


class WorkerProgress:
    """The progress object of a task: tells the station, and raises when the job was cancelled.

    Args:
        job_id: of the job.
        send: sends a report to the station.
    """

    def __init__(self, job_id: str, send: Callable[[tuple[str, str, float]], None]) -> None:
        self._job_id = job_id
        self._send = send
        self._stage = ""
        self._sent_at = 0.0

    def report(self, stage: str, fraction: float) -> None:
        """Tell how far a stage is; at most ten times a second unless the stage changes.

        Raises:
            OperationCancelled: the job was cancelled.
        """
        if self._job_id in _cancelled:
            raise OperationCancelled(CANCELLED)
        now = time.monotonic()
        if stage != self._stage or fraction >= 1.0 or now - self._sent_at >= REPORT_EVERY_S:
            self._stage, self._sent_at = stage, now
            self._send((self._job_id, stage, float(fraction)))


def _task(job_id: str, function: Callable[..., Any], args: tuple[Any, ...]) -> _Outcome:
    """Runs in a worker process."""
    from distributed import get_worker

    worker = get_worker()
    progress = WorkerProgress(job_id, lambda report: worker.log_event(TOPIC, report))
    try:
        progress.report("start", 0.0)
        return _Outcome(function(progress, *args), None)
    except GcsError as error:
        return _Outcome(None, error)
    finally:
        _cancelled.discard(job_id)


def _cancel_in_worker(job_id: str) -> None:
    """Runs in the event loop of every worker process."""
    _cancelled.add(job_id)


class PlanningJobs:
    """Runs functions of the form `function(progress, *args)` in worker processes.

    Args:
        workers: processes; by default one, and two on machines with four cores or more.
    """

    def __init__(self, workers: int | None = None) -> None:
        self._workers = workers or (2 if (os.cpu_count() or 1) >= 4 else 1)
        self._starting: asyncio.Task[None] | None = None
        self._cluster: LocalCluster | None = None
        self._client: Client | None = None
        self._futures: dict[str, Future] = {}
        self._tell: dict[str, Tell] = {}
        self._begun: set[str] = set()
        self._asked: dict[str, asyncio.Event] = {}

    async def run(self, job_id: str, function: Callable[..., R], *args: Any, tell: Tell) -> R:
        """Run one job to its end.

        Args:
            job_id: its name, used once.
            function: importable by name; gets a progress object and `args`.
            args: plain values.
            tell: called in this event loop with stage and fraction.

        Raises:
            GcsError: what the function raised; `OperationCancelled` after `cancel`.
        """
        loop = asyncio.get_running_loop()
        self._tell[job_id] = lambda stage, fraction: _call_soon(loop, tell, stage, fraction)
        asked = self._asked[job_id] = asyncio.Event()
        try:
            await _first(self._started(), asked)
            if asked.is_set() or self._client is None:
                raise OperationCancelled(CANCELLED)
            done = asyncio.Event()
            future = self._client.submit(_task, job_id, function, args, key=job_id, pure=False, retries=0)
            self._futures[job_id] = future
            future.add_done_callback(lambda _future: _call_soon(loop, done.set))
            await _first(done.wait(), asked)
            if asked.is_set():
                await self._stop(job_id, future, done)
            outcome = await asyncio.to_thread(_result_of, future)
            if outcome.error is not None:
                raise outcome.error
            result: R = outcome.result
            return result
        finally:
            for known in (self._asked, self._futures, self._tell):
                known.pop(job_id, None)
            self._begun.discard(job_id)

    async def cancel(self, job_id: str) -> None:
        """Ask a job to stop; its `run` then raises `OperationCancelled` within a second."""
        if job_id in self._asked:
            self._asked[job_id].set()

    async def _stop(self, job_id: str, future: Future, done: asyncio.Event) -> None:
        """Stop a task that was submitted; one that does not look at its progress in time is left to do so later.

        Raises:
            OperationCancelled: it did not end by itself in the meantime.
        """
        client = self._client
        if client is not None and not done.is_set():
            try:
                async with asyncio.timeout(OBEY_S):
                    await asyncio.to_thread(client.run, _cancel_in_worker, job_id)
                    if job_id in self._begun:
                        await done.wait()
            except TimeoutError:
                log.warning("%s has not looked at its progress for %.1f s", job_id, OBEY_S)
        if future.status != "finished":
            await asyncio.to_thread(future.cancel)
            raise OperationCancelled(CANCELLED)

    async def close(self) -> None:
        """End the worker processes; jobs that are running end with them."""
        if self._starting is not None:
            await asyncio.wait({self._starting})
        client, cluster = self._client, self._cluster
        self._starting = self._client = self._cluster = None
        if client is not None:
            await asyncio.to_thread(client.close, CLOSE_TIMEOUT_S)
        if cluster is not None:
            await asyncio.to_thread(cluster.close, CLOSE_TIMEOUT_S)

    async def _started(self) -> None:
        if self._starting is None or (self._starting.done() and self._starting.exception() is not None):
            self._starting = asyncio.create_task(asyncio.to_thread(self._start))
        # A job that is given up in the meantime does not stop the start, so that `close` finds all of it.
        await asyncio.shield(self._starting)

    def _start(self) -> None:
        import dask
        from distributed import Client, LocalCluster

        dask.config.set(_CONFIG)
        self._cluster = LocalCluster(
            n_workers=self._workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            # A worker that closes late says as an error that its scheduler has gone; what jobs fail of is raised.
            silence_logs=logging.CRITICAL,
        )
        self._client = Client(self._cluster)
        self._client.register_plugin(_gives_way())
        self._client.subscribe_topic(TOPIC, self._on_report)

    def _on_report(self, event: tuple[float, tuple[str, str, float]]) -> None:
        """In the cluster's own event loop."""
        job_id, stage, fraction = event[1]
        self._begun.add(job_id)
        tell = self._tell.get(job_id)
        if tell is not None:
            tell(stage, fraction)


def _gives_way() -> WorkerPlugin:
    """Has every worker process run at a low priority: from its event loop's thread, which starts those for tasks."""
    from distributed import WorkerPlugin

    class GivesWay(WorkerPlugin):  # type: ignore[misc]  # distributed has no types
        def setup(self, worker: object) -> None:  # noqa: ARG002 - given by distributed
            os.nice(NICENESS)

    return GivesWay()


async def _first(work: Coroutine[Any, Any, Any], asked: asyncio.Event) -> None:
    """Wait for work to end, or for a cancel; the work's error is raised."""
    tasks = {asyncio.ensure_future(work), asyncio.ensure_future(asked.wait())}
    try:
        ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in ended:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def _result_of(future: Future) -> _Outcome:
    from distributed import KilledWorker

    try:
        outcome: _Outcome = future.result()
    except KilledWorker:
        raise GcsError("the planning process died, perhaps for want of memory: plan something smaller") from None
    return outcome


def _call_soon(loop: asyncio.AbstractEventLoop, function: Callable[..., Any], *args: Any) -> None:
    if not loop.is_closed():
        loop.call_soon_threadsafe(function, *args)
