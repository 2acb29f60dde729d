"""The files of one vehicle, over MAVLink FTP: listed, fetched, written; and its camera's picture without files."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TypeVar

from gcs.core.errors import LinkError, RefusedError
from gcs.core.progress import Progress
from gcs.core.vehicle import VehicleIdentity
from gcs.mavlink.camera_description import CameraDescription
from gcs.mavlink.ftp_directory import DirectoryListing, ListDirectory
from gcs.mavlink.ftp_fetch import FetchedFile, FetchFile
from gcs.mavlink.ftp_protocol import OnBytes, SequenceNumbers, path_from_url
from gcs.mavlink.ftp_store import StoreFile
from gcs.mavlink.ftp_transaction import FtpTransaction
from gcs.mavlink.image_transmission import RequestImage, TransmittedImage
from gcs.mavlink.partial_file import PartialFile, PartKeeper
from gcs.mavlink.vehicle_channel import VehicleChannel
from gcs.mavlink.vehicle_state import VehicleState

R = TypeVar("R")

CAMERA_S = 5.0
"""A camera tells of itself every second. One that was not heard for so long after its vehicle was is taken for none,
and the autopilot is asked for its files; before that it may just be late, as after a restart of the station."""
MADE_UP_BYTES = 1 << 20
"""Most bytes of a file that the vehicle makes up as it is read."""


class VehicleFiles(VehicleState):
    """The part of a `Vehicle` that moves files."""

    def __init__(self, identity: VehicleIdentity, channel: VehicleChannel, *, lost_after_s: float) -> None:
        super().__init__(identity, channel, lost_after_s=lost_after_s)
        self._file_numbers: dict[int, SequenceNumbers] = {}
        self._file_lock = asyncio.Lock()
        self._camera_due_s = self._now() + CAMERA_S

    @property
    def camera(self) -> CameraDescription:
        """What its camera tells of itself, as far as it was heard."""
        return self._camera.description

    async def list_files(self, path: str, component: int | None = None) -> DirectoryListing:
        """List a folder of its camera, or of another component that serves files."""
        return await self._exchange_files(ListDirectory, path, component)

    async def fetch_file(
        self,
        path: str,
        progress: Progress | None = None,
        *,
        component: int | None = None,
        resume: PartialFile | None = None,
        keep: PartKeeper | None = None,
    ) -> FetchedFile:
        """Read a file of its camera, or of another component; one at a time, others wait.

        Args:
            path: of the file, or its `mftp:` address as an ImageReport has it.
            progress: told under the path's name.
            component: that serves it; by default the one that the address names, else the camera, else the autopilot.
            resume: what an earlier try left (`partial` of its BrokenFetchError, or what its `keep` has).
            keep: is given every piece that comes, besides those of `resume`.

        Raises:
            BrokenFetchError: the link broke; it has what came.
        """
        fetch = partial(FetchFile, resume=resume, keep=keep, on_progress=_telling(progress, path))
        return await self._exchange_files(fetch, path, component)

    async def request_picture(self, progress: Progress | None = None) -> TransmittedImage:
        """Have its camera send its newest picture, packet by packet: for cameras that serve no files.

        Raises:
            RefusedError: no camera of it was heard, or the picture cannot be taken.
            NotFoundError: there is no picture.
            IncompleteError: it did not arrive whole.
            LinkError: the camera does not answer.
        """
        camera = self.camera_component
        if camera is None:
            raise RefusedError("no camera component of it has been heard", field=self.identity.name)
        async with self._file_lock:
            request = RequestImage(
                (self.identity.system_id, camera),
                self._channel.send,
                self._now,
                on_progress=_telling(progress, "picture"),
            )
            return await self._named(self._channel.run(request))

    async def read_made_up(self, path: str) -> bytes:
        """Read a file of its autopilot that it makes up as it is read; the content must be checked."""
        fetch = partial(FetchFile, max_bytes=MADE_UP_BYTES, made_up=True)
        return (await self._exchange_files(fetch, path, self.identity.component_id)).data

    async def write_to_autopilot(self, path: str, data: bytes, on_bytes: OnBytes | None = None) -> None:
        """Write a file of its autopilot, which uses it when it has been closed."""
        store = partial(StoreFile, data=data, on_progress=on_bytes)
        await self._exchange_files(store, path, self.identity.component_id)

    async def _exchange_files(self, make: Callable[..., FtpTransaction[R]], path: str, component: int | None) -> R:
        """Run an exchange with the server that has a file: a component of its own, or the one that is most likely."""
        bare, named = path_from_url(path)
        server = component or named or await self._usual_file_server()
        async with self._file_lock:
            exchange = make(
                bare,
                self.identity.system_id,
                server,
                self._channel.send,
                self._now,
                sequence=self._file_numbers.setdefault(server, SequenceNumbers()),
                own_system=self._channel.sender[0],
            )
            return await self._named(self._channel.run(exchange))

    async def _usual_file_server(self) -> int:
        """Its camera, which may be heard later than the autopilot, else the autopilot."""
        patience_s = self._camera_due_s - self._now()
        if self.camera_component is None and patience_s > 0:
            with suppress(LinkError):
                await self.until(lambda: self.camera_component is not None, patience_s, "its camera")
        return self.camera_component or self.identity.component_id


def _telling(progress: Progress | None, stage: str) -> OnBytes | None:
    if progress is None:
        return None

    def tell(done: int, total: int) -> None:
        progress.report(stage, done / max(total, 1))

    return tell
