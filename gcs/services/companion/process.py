"""`gcs companion`: the core on a real link and the real clock, until it is interrupted."""

from __future__ import annotations

import asyncio
import logging
import os
import time
from contextlib import AsyncExitStack, suppress
from typing import TYPE_CHECKING

from gcs.core.errors import InputError
from gcs.core.garbage import spare_what_is_loaded
from gcs.mavlink.companion_lease import COMPANION
from gcs.mavlink.dialect import Message
from gcs.mavlink.heartbeats import is_vehicle
from gcs.mavlink.link_url import parse_link_url
from gcs.mavlink.links import make_link
from gcs.mavlink.report_outbox import ReportOutbox
from gcs.services.companion.companion_options import CompanionOptions
from gcs.services.companion.core import CompanionCore, heartbeat
from gcs.services.companion.lease_memory import LeaseMemory
from gcs.services.companion.link_key import KEY_WANTED, CompanionSigning, link_signing
from gcs.services.companion.navigator_warm_up import warm_navigator
from gcs.services.companion.station_plans import StationFiles, StationPlans, keep_folder, station_address
from gcs.storage.data_directory import default_data_directory, make_data_directory
from gcs.storage.kept_plans import KeptPlans
from gcs.storage.lease_file import LeaseFile
from gcs.storage.report_outbox_files import ReportOutboxFiles

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from gcs.mavlink.link_base import Link, Peer
    from gcs.mavlink.received_message import ReceivedMessage

log = logging.getLogger(__name__)

ANYBODY = 1
"""System id with which the companion speaks before it has heard its autopilot."""

NICENESS = -10
"""The lidar's scans cannot wait for what else the computer does."""

GREETING_S = 1.0
LONGEST_SLEEP_S = 0.5
AFTER_ERROR_S = 0.1


async def run_companion(
    url: str,
    *,
    station: str | None,
    token_file: Path | None,
    keep: Path | None,
    plans: tuple[Path, ...],
    options: CompanionOptions,
    say: Callable[[str], None],
    data_dir: Path | None = None,
    key_file: Path | None = None,
    on_taken: Callable[[ReceivedMessage], None] | None = None,
) -> None:
    """Run a companion until it is cancelled.

    Args:
        url: of the link to the autopilot.
        station: URL of the station that has the plans; None to fly kept plans alone.
        token_file: holds the station's session token; that of the data directory when not given.
        keep: where plans, progress and undelivered reports are kept; `companion` in the data directory when not given.
        plans: folders of plans to be kept from the start.
        options: see `CompanionOptions`.
        say: takes lines for whoever started it.
        data_dir: of this machine; the user's own when not given.
        key_file: holds the key that signs the link; that of the data directory for this link, if any, when not given.
        on_taken: told of each message once what follows from it at once is sent.

    Raises:
        InputError: the link, the station's URL, a plan's folder or a key is none.
        LinkError: the link cannot be opened.
        StorageError: nothing can be kept.
    """
    address = None if station is None else station_address(station)
    data = data_dir or default_data_directory()
    directory = keep or data / "companion"
    make_data_directory(directory)
    signing = link_signing(url, key_file, data_dir, directory)
    kept = KeptPlans(directory / "plans")
    for folder in plans:
        say(f"plan {keep_folder(kept, folder)[:12]} is kept")
    files = None if address is None else StationFiles(address, _token(token_file or data / "token"))
    reports, memory = ReportOutboxFiles(directory / "reports"), LeaseMemory(LeaseFile(directory / "lease.json"))
    shell = _Shell(url, signing, StationPlans(kept, files), reports, memory, options, say)
    shell.on_taken = on_taken
    await shell.run()


def _token(path: Path) -> str:
    try:
        token = path.read_text().strip()
    except OSError as error:
        raise InputError(f"the station's token cannot be read: {error.strerror}", field=str(path)) from None
    if not token:
        raise InputError("it holds no token", field=str(path))
    return token


class _Shell:
    """Opens the link, waits for the autopilot, and drives the core."""

    def __init__(
        self,
        url: str,
        signing: CompanionSigning | None,
        plans: StationPlans,
        store: ReportOutboxFiles,
        memory: LeaseMemory,
        options: CompanionOptions,
        say: Callable[[str], None],
    ) -> None:
        self._address = parse_link_url(url)
        self._signing = signing
        self._plans = plans
        self._store = store
        self._memory = memory
        self._options = options
        self._say = say
        self.on_taken: Callable[[ReceivedMessage], None] | None = None
        self._core: CompanionCore | None = None
        self._system_id: int | None = None
        self._link: Link | None = None
        self._autopilot: Peer | None = None
        self._wake = asyncio.Event()
        self._logged = ""

    async def run(self) -> None:
        """Until it is cancelled."""
        async with AsyncExitStack() as stack:
            if self._signing is not None:
                stack.push_async_callback(_ended, asyncio.create_task(self._signing.watch(self._say)))
            stack.push_async_callback(self._close)
            await self._open(ANYBODY)
            warm_navigator()
            await self._meet()
            _be_prompt()
            await self._drive()

    async def _close(self) -> None:
        if self._link is not None:
            await self._link.close()

    async def _open(self, system_id: int) -> None:
        await self._close()
        self._link = make_link(self._address, (system_id, COMPANION), self._heard, time.monotonic)
        if self._signing is not None:
            self._link.signing = self._signing.signing
        await self._link.open()
        self._say(f"listens for the autopilot on {self._link.url}")

    async def _meet(self) -> None:
        """Wait for the autopilot, and become a component of its system."""
        while self._system_id is None:
            self._greet()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._wake.wait(), GREETING_S)
            self._wake.clear()
        system_id = self._system_id
        if system_id != ANYBODY:
            await self._open(system_id)
        self._say(f"beside the autopilot of system {system_id}")
        outbox = ReportOutbox(self._store, self._send, time.monotonic)
        self._core = CompanionCore(
            system_id=system_id,
            send=self._send,
            clock=time.monotonic,
            plans=self._plans,
            outbox=outbox,
            options=self._options,
            memory=self._memory,
        )

    async def _drive(self) -> None:
        core = self._core
        assert core is not None  # it has been met
        while True:
            wait_s = min(core.deadline - time.monotonic(), LONGEST_SLEEP_S)
            if wait_s > 0:
                self._wake.clear()
                with suppress(TimeoutError):
                    async with asyncio.timeout(wait_s):
                        await self._wake.wait()
            else:
                await asyncio.sleep(0)
            try:
                core.on_time()
            except Exception as error:  # the link, and the reports that still wait, must outlive it
                if repr(error) != self._logged:
                    log.exception("an error of its own")
                self._logged = repr(error)
                core.fail()
                await asyncio.sleep(AFTER_ERROR_S)

    def _heard(self, link: Link, peer: Peer, message: ReceivedMessage) -> None:
        del link
        if self._system_id is None:
            if message.get_type() == "HEARTBEAT" and is_vehicle(message):
                if self._signing is None and message.is_signed:
                    self._say(KEY_WANTED)
                self._system_id, self._autopilot = message.get_srcSystem(), peer
                self._wake.set()
            return
        if message.get_srcSystem() == self._system_id:
            self._autopilot = peer
        if self._core is None:
            return
        try:
            self._core.handle(message)
        except Exception:  # untrusted input: a message that cannot be taken must not stop the flight
            log.exception("a %s could not be taken", message.get_type())
        if self.on_taken is not None:
            self.on_taken(message)
        self._wake.set()

    def _send(self, message: Message) -> None:
        if self._autopilot is not None:
            self._autopilot.send(message)

    def _greet(self) -> None:
        """Speak first where the link asks for it, so that the autopilot learns the way."""
        assert self._link is not None
        for peer in self._link.peers:
            peer.send(heartbeat(leading=False))


def _be_prompt() -> None:
    """Answer scans soon on a busy computer: before other processes, where this one may, and without long pauses."""
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
    spare_what_is_loaded()


async def _ended(task: asyncio.Task[None]) -> None:
    """End a task."""
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
