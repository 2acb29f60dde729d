"""Pictures that are taken while the vehicle flies on: commanded ahead by the lag of the camera, and followed up.

A command takes its way, and a camera its time. Cameras that tell when a picture was taken show how long that is in all,
and the following pictures are commanded so much earlier.
"""

from __future__ import annotations

import asyncio
from collections import deque
from statistics import median
from typing import TYPE_CHECKING

from gcs.core.errors import GcsError
from gcs.services.flight_recorder import WARNING

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from gcs.core.plan import Viewpoint
    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.flight_recorder import FlightRecorder
    from gcs.services.image_collector import ImageCollector

LATEST = 5
LONGEST_LAG_S = 1.0
"""A picture that was taken longer after its command was not taken by it, or not by its first sending."""

NEAR_M = 0.3
"""A picture is said to be out of place when its command was not taken within this of its viewpoint."""

ANNOUNCED_WITHIN_S = 4.0


class PassingPictures:
    """Commands of one flight that nobody waits for.

    Args:
        vehicle: that takes the pictures.
        collector: hears of them.
        recorder: where it is written down what went wrong.
    """

    def __init__(self, vehicle: Vehicle, collector: ImageCollector, recorder: FlightRecorder) -> None:
        self._vehicle = vehicle
        self._collector = collector
        self._recorder = recorder
        self._lags_s: deque[float] = deque(maxlen=LATEST)
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def lag_s(self) -> float:
        """From a command to its picture, on the vehicle's clock (s); 0 until a picture has shown it."""
        return median(self._lags_s) if self._lags_s else 0.0

    def trigger(self, viewpoint: Viewpoint, vehicle_s: float, off_m: Callable[[], float | None]) -> None:
        """Have a picture taken now.

        Args:
            viewpoint: what it is of.
            vehicle_s: the vehicle's clock now.
            off_m: tells how far the vehicle is from the viewpoint, when asked; None when that is not known.
        """
        self.start(self._take(viewpoint, vehicle_s, off_m))

    def start(self, work: Coroutine[None, None, None]) -> None:
        """Have something else done meanwhile."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def settle(self) -> None:
        """Wait until all commands are answered and all pictures announced, or given up."""
        await asyncio.gather(*self._tasks)

    def cancel(self) -> None:
        """Wait for nothing any more."""
        for task in self._tasks:
            task.cancel()

    async def _take(self, viewpoint: Viewpoint, vehicle_s: float, off_m: Callable[[], float | None]) -> None:
        before = self._collector.count
        try:
            await self._vehicle.take_picture()
            off = off_m()
            if off is None or off > NEAR_M:
                where = "an unknown distance" if off is None else f"up to {off:.1f} m"
                self._say(viewpoint, f"photographed {where} from its place")
            async with asyncio.timeout(ANNOUNCED_WITHIN_S):
                while self._collector.count == before:
                    self._collector.announced.clear()
                    await self._collector.announced.wait()
        except TimeoutError:
            self._say(viewpoint, "the vehicle has not announced its picture yet")
            return
        except GcsError as error:
            self._say(viewpoint, str(error))
            return
        taken_s = self._collector.taken_at_s
        if taken_s is not None and 0.0 <= taken_s - vehicle_s <= LONGEST_LAG_S:
            self._lags_s.append(taken_s - vehicle_s)

    def _say(self, viewpoint: Viewpoint, what: str) -> None:
        self._recorder.log("image", f"{viewpoint.name}: {what}", severity=WARNING)
