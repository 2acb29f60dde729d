"""The telemetry log of every flight: opened before arming, closed when the vehicle is down again."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.core.errors import GcsError
from gcs.services.flight_recorder import ERROR, NOTICE

if TYPE_CHECKING:
    from gcs.services.flight_run import FlightRun
    from gcs.storage.telemetry_log import LogTotals, TelemetryLog, TelemetryLogStore

log = logging.getLogger(__name__)

AFTER_DISARM_S = 3.0
"""What a vehicle says right after it disarmed belongs to the flight."""


@dataclass
class _Recording:
    run: FlightRun
    log: TelemetryLog
    ending: asyncio.Task[None]


class FlightLogs:
    """Records the links of vehicles that are on a flight; for the event loop.

    Args:
        store: where the logs lie.
    """

    def __init__(self, store: TelemetryLogStore) -> None:
        self._store = store
        self._recordings: dict[str, _Recording] = {}

    def begin(self, run: FlightRun) -> None:
        """Record every packet of the flight's vehicle, both ways, until some seconds after it is down."""
        flight_id = run.recorder.flight_id
        loop = asyncio.get_running_loop()

        def tell(text: str) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(_say, run, text, ERROR)

        file = self._store.open(flight_id, tell)
        run.vehicle.on_packet = file.record
        ending = asyncio.create_task(self._end_when_down(run), name=f"log of {flight_id}")
        self._recordings[flight_id] = _Recording(run, file, ending)
        _say(run, f"every packet is recorded in flights/{file.path.name}", NOTICE)

    async def end(self, flight_id: str) -> None:
        """Close a flight's log and say in its record what is in it; nothing when it is closed already."""
        recording = self._recordings.pop(flight_id, None)
        if recording is None:
            return
        if recording.ending is not asyncio.current_task():
            recording.ending.cancel()
        vehicle = recording.run.vehicle
        if vehicle.on_packet == recording.log.record:
            vehicle.on_packet = None
        totals = await asyncio.to_thread(recording.log.close)
        _say(recording.run, _account(recording.log.path.name, totals), ERROR if totals.lost else NOTICE)

    async def close(self) -> None:
        """Close all logs; the flights may go on."""
        await asyncio.gather(*(self.end(flight_id) for flight_id in list(self._recordings)))

    async def _end_when_down(self, run: FlightRun) -> None:
        await run.down.wait()
        await asyncio.sleep(AFTER_DISARM_S)
        await self.end(run.recorder.flight_id)


def _account(name: str, totals: LogTotals) -> str:
    missing = f"; {totals.lost} packets are missing, as the disk did not take them" if totals.lost else ""
    return f"the telemetry log flights/{name} is closed: {totals.packets} packets{missing}"


def _say(run: FlightRun, text: str, severity: int) -> None:
    try:
        run.recorder.log("log", text, severity=severity)
    except GcsError:  # the same disk, most likely
        log.exception("flight %s: %s", run.recorder.flight_id, text)
