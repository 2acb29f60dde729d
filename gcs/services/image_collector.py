"""Brings a flight's pictures from the vehicle, one at a time, and keeps trying until each is whole or given up."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import TYPE_CHECKING

from gcs.core.clock import new_id, utc_now
from gcs.core.errors import GcsError, LinkError, NotFoundError, StorageError
from gcs.mavlink.ftp_fetch import BrokenFetchError
from gcs.mavlink.partial_file import PartialFile
from gcs.services.flight_recorder import NOTICE, WARNING
from gcs.services.image_account import ImageAccounting, scene_position
from gcs.storage.records import ImageRecord, ImageState

if TYPE_CHECKING:
    from gcs.core.plan import Plan
    from gcs.core.vehicle import ImageReport
    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.flight_recorder import FlightRecorder
    from gcs.services.image_account import ImageAccount
    from gcs.storage.image_parts import ImagePart

FOLDER = "/DCIM"
TRIES = 5
LISTINGS = 3
RETRY_S = 1.0
EARLIER = "earlier pictures"


class ImageCollector:
    """The pictures of one flight.

    Announced pictures with a file name are fetched at once. Vehicles that announce without a name (ArduPilot's
    CAMERA_FEEDBACK), and announcements that were lost, are found by listing the camera's folder; what was in it before
    the flight is left out. A camera that serves no files is asked to send its newest picture at each announcement.
    """

    def __init__(self, plan: Plan, vehicle: Vehicle, recorder: FlightRecorder) -> None:
        self._plan = plan
        self._vehicle = vehicle
        self._recorder = recorder
        self._accounting = ImageAccounting(plan, recorder)
        self._waiting: asyncio.Queue[ImageRecord] = asyncio.Queue()
        self._nameless: set[int] = set()
        self._counted: set[int] = set()
        self._serves_files = True
        self._newest: int | None = None
        self._taken_at_s: float | None = None
        self.announced = asyncio.Event()

    @property
    def count(self) -> int:
        """How many pictures were announced since the start of this station."""
        return len(self._counted)

    @property
    def taken_at_s(self) -> float | None:
        """When the picture that was announced last was taken, on the vehicle's clock; None when it did not tell."""
        return self._taken_at_s

    async def remember_earlier(self) -> None:
        """Before the flight: write down what the camera's folder holds already."""
        try:
            names = sorted(await self._names())
        except GcsError as error:
            self._serves_files = False
            self._recorder.log("image", f"the camera's folder cannot be listed: {error}", severity=WARNING)
            return
        self._recorder.log("image", f"{EARLIER}: {len(names)}", names=names)

    def take(self, report: ImageReport) -> None:
        """The vehicle announces a picture."""
        self._counted.add(report.index)
        self._taken_at_s = report.at_vehicle_s
        self.announced.set()
        if not report.success:
            self._recorder.log("image", f"picture {report.index} failed on the vehicle", severity=WARNING)
            return
        path = _plain_path(report.file)
        self._newest = report.index if self._newest is None else max(self._newest, report.index)
        if path is None and self._serves_files:
            if report.index not in self._nameless:
                self._nameless.add(report.index)
                self._recorder.log("image", f"picture {report.index} taken")
            return
        image = ImageRecord(
            id=new_id("image"),
            flight_id=self._recorder.flight_id,
            index=report.index,
            viewpoint_id=None,
            viewpoint_name=None,
            state=ImageState.ANNOUNCED,
            source="link",
            announced_at=utc_now(),
            vehicle_path=path,
            vehicle_time_s=report.at_vehicle_s,
            position_m=scene_position(self._plan, report.position),
        )
        if self._recorder.image(image).id == image.id:  # else it was announced before
            self._waiting.put_nowait(image)

    async def run(self) -> None:
        """Fetch what is announced, until cancelled."""
        for image in self._recorder.database.images.unfinished(self._recorder.flight_id):
            self._waiting.put_nowait(image)
        while True:
            image = await self._waiting.get()
            try:
                await self._fetch(image)
            finally:
                self._waiting.task_done()

    async def finish(self) -> ImageAccount:
        """After the flight: fetch what is left, look for what was never announced, and settle the account."""
        await self._waiting.join()
        account = await self._accounting.settle_aside()
        if not account.complete or self._nameless:
            try:
                await self._find_unannounced()
            except GcsError as error:
                self._recorder.log("image", f"the camera's folder cannot be listed: {error}", severity=WARNING)
            await self._waiting.join()
            account = await self._accounting.settle_aside()
        return account

    async def so_far(self, timeout_s: float) -> ImageAccount:
        """The account as it is when everything was fetched, or at the latest after some seconds."""
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                return await self.finish()
        return await self._accounting.settle_aside()

    async def _find_unannounced(self) -> None:
        known = {i.vehicle_path: i for i in self._recorder.database.images.of_flight(self._recorder.flight_id)}
        names = await self._names_patiently()
        for name in sorted(names - self._earlier()):
            path = f"{FOLDER}/{name}"
            if path in known and known[path].state is ImageState.FAILED:
                self._waiting.put_nowait(known[path])
            elif path not in known:
                image = ImageRecord(
                    id=new_id("image"),
                    flight_id=self._recorder.flight_id,
                    index=None,
                    viewpoint_id=None,
                    viewpoint_name=None,
                    state=ImageState.ANNOUNCED,
                    source="link",
                    announced_at=utc_now(),
                    vehicle_path=path,
                )
                self._waiting.put_nowait(self._recorder.image(image))

    async def _fetch(self, image: ImageRecord) -> None:
        self._recorder.change_image(image.id, state=ImageState.FETCHING)
        part = self._recorder.image_part(image)
        try:
            problem = await self._fetch_into(part, image)
        finally:
            part.close()
        if problem:
            self._recorder.change_image(image.id, state=ImageState.FAILED, problem=problem)
            name = image.vehicle_path or f"picture {image.index}"
            self._recorder.log("image", f"{name} not received: {problem}", severity=NOTICE)
        else:
            part.remove()
            await self._accounting.settle_aside()

    async def _fetch_into(self, part: ImagePart, image: ImageRecord) -> str:
        """Fetch a picture, from where an earlier station left it; returns why that failed, or nothing."""
        problem = ""
        resume = await asyncio.to_thread(_kept_of, part)
        for attempt in range(TRIES):
            if attempt:
                await asyncio.sleep(RETRY_S * attempt)
            try:
                data, crc32, checked = await self._bring(image, resume, part)
                await self._recorder.store_image_aside(image, data, crc32=crc32)
            except StorageError as error:
                self._recorder.problem(f"pictures cannot be kept, they stay on the vehicle: {error}")
                problem = str(error)
                break
            except GcsError as error:
                problem = str(error)
                if not isinstance(error, LinkError):
                    resume = None
                elif isinstance(error, BrokenFetchError) and error.partial is not None:
                    resume = error.partial
                if not isinstance(error, LinkError) and attempt >= 1:
                    break
            else:
                name = image.vehicle_path or f"picture {image.index}"
                self._recorder.log("image", f"{name} received, {len(data)} bytes, {checked}")
                return ""
        return problem

    async def _bring(
        self, image: ImageRecord, resume: PartialFile | None, part: ImagePart
    ) -> tuple[bytes, int | None, str]:
        """A picture's bytes, their CRC-32 where the vehicle can tell it, and how they were checked, in words."""
        if image.vehicle_path is not None:
            file = await self._vehicle.fetch_file(image.vehicle_path, resume=resume, keep=part)
            confirmed = "CRC-32 agrees" if file.confirmed else "the vehicle offers no CRC-32 to compare"
            return file.data, file.crc32, confirmed
        if image.index != self._newest:
            raise NotFoundError("the camera sends its newest picture only, and has taken another")
        picture = await self._vehicle.request_picture()
        if image.index != self._newest:
            raise NotFoundError("the camera has taken another picture meanwhile")
        return picture.data, None, "sent by the camera packet by packet, without a checksum"

    async def _names_patiently(self) -> set[str]:
        """As `_names`; a link that is away for a while must not make pictures count as missing."""
        for attempt in range(1, LISTINGS):
            try:
                return await self._names()
            except LinkError:
                if not self._serves_files:
                    raise
                await asyncio.sleep(RETRY_S * attempt)
        return await self._names()

    async def _names(self) -> set[str]:
        listing = await self._vehicle.list_files(FOLDER)
        return {entry.name for entry in listing.entries if not entry.is_directory}

    def _earlier(self) -> set[str]:
        for event in self._recorder.database.flights.events(self._recorder.flight_id):
            if event.kind == "image" and event.text.startswith(EARLIER):
                return set(event.data["names"])
        return set()


def _kept_of(part: ImagePart) -> PartialFile | None:
    """What an earlier station kept of a picture."""
    kept = part.load()
    return None if kept is None else PartialFile.of_pieces(*kept)


def _plain_path(file: str | None) -> str | None:
    """The path on the vehicle that an announcement names; None for what MAVLink FTP cannot fetch."""
    if file is None or "\0" in file:
        return None
    for prefix in ("mftp://", "mftp:"):
        if file.startswith(prefix):
            path = "/" + file.removeprefix(prefix).lstrip("/")
            return path if len(path) < 200 else None
    return None
