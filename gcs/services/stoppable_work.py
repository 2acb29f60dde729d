"""Work for a flight that an operator can stop: whoever does it learns of that as an `OperationCancelled`."""

from __future__ import annotations

import asyncio
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gcs.core.errors import ConflictError, OperationCancelled

if TYPE_CHECKING:
    from collections.abc import Iterator


@dataclass(eq=False)
class _Work:
    task: asyncio.Task[object]
    stopped: bool = False
    over: asyncio.Event = field(default_factory=asyncio.Event)


class StoppableWork:
    """What is under way for each flight."""

    def __init__(self) -> None:
        self._under_way: dict[str, list[_Work]] = {}

    @contextmanager
    def of(self, flight_id: str, words: str) -> Iterator[None]:
        """What a task does inside this block can be stopped.

        Args:
            flight_id: the flight that it is for.
            words: what is true when it was stopped, for people.

        Raises:
            OperationCancelled: it was stopped.
        """
        task = asyncio.current_task()
        if task is None:
            raise RuntimeError("only a task can be stopped")
        work = _Work(task)
        self._under_way.setdefault(flight_id, []).append(work)
        try:
            yield
        except asyncio.CancelledError:
            if work.stopped and task.uncancel() == 0:
                raise OperationCancelled(words) from None
            raise  # somebody else ends the whole task
        finally:
            self._under_way[flight_id].remove(work)
            if not self._under_way[flight_id]:
                del self._under_way[flight_id]
            work.over.set()

    async def stop(self, flight_id: str) -> None:
        """Stop what is under way for a flight; returns when it has ended.

        Raises:
            ConflictError: nothing is.
        """
        works = tuple(self._under_way.get(flight_id, ()))
        if not works:
            raise ConflictError("no transfer of this flight is under way", field=flight_id)
        for work in works:
            if not work.stopped:
                work.stopped = True
                work.task.cancel()
        for work in works:
            await work.over.wait()
