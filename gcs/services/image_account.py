"""The account of a flight's pictures: which viewpoint each belongs to, and which are missing."""

from __future__ import annotations

import asyncio
import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError, NotFoundError
from gcs.core.frames import enu_from_geodetic
from gcs.planning.local.moved_view import moved_viewpoint
from gcs.planning.views.image_matching import match_images
from gcs.services.flight_tracker import REACHED_M
from gcs.services.image_metadata import read_metadata
from gcs.services.replan_difference import moved_places
from gcs.storage.records import FlightState, ImageState

if TYPE_CHECKING:
    from datetime import datetime

    from numpy.typing import NDArray

    from gcs.core.frames import GeoPoint
    from gcs.core.plan import Plan, Viewpoint
    from gcs.services.flight_recorder import FlightRecorder
    from gcs.storage.records import ImageRecord

STEEP_RAD = math.radians(60.0)
"""A view steeper than this has no heading worth comparing."""

MISSING = "images are missing"
NOT_REACHED = "viewpoints were not reached"

_NUMBER = re.compile(r"(\d+)\D*$")


@dataclass(frozen=True)
class ImageAccount:
    """Where the pictures of a flight stand.

    Attributes:
        expected: one a viewpoint.
        received: viewpoints that have a stored picture.
        missing: names of the viewpoints that have none.
        unmatched: stored pictures that belong to no viewpoint.
        pictured: ids of the viewpoints that have a stored picture.
        misses_m: viewpoint id -> how far from it its picture was taken, where that is known.
        at_place: ids of the viewpoints whose picture was taken there, or where a report says that it was instead.
    """

    expected: int
    received: int
    missing: tuple[str, ...]
    unmatched: int
    pictured: frozenset[int] = frozenset()
    misses_m: dict[int, float] = field(default_factory=dict)
    at_place: frozenset[int] = frozenset()

    @property
    def complete(self) -> bool:
        """Whether every viewpoint has its picture."""
        return not self.missing


def scene_position(plan: Plan, place: GeoPoint | None) -> tuple[float, float, float] | None:
    """A geodetic place in the plan's scene frame (m)."""
    if place is None:
        return None
    enu = enu_from_geodetic(place.latitude_deg, place.longitude_deg, place.altitude_m, plan.scenario.anchor.point)
    return (float(enu[0]), float(enu[1]), float(enu[2]))


@dataclass(frozen=True)
class _Told:
    """What a picture's file tells."""

    taken_at: datetime | None
    yaw_rad: float | None
    position_m: tuple[float, float, float] | None


class ImageAccounting:
    """Matches the stored pictures of one flight with its viewpoints, each where its picture was to be taken in the end.

    Positions come from the vehicle's announcements, else from the files; headings and, so that pictures from link and
    card can be mixed, the order from the files. What a file says is read once.
    """

    def __init__(self, plan: Plan, recorder: FlightRecorder) -> None:
        self._plan = plan
        self._recorder = recorder
        self._told: dict[str, _Told] = {}

    def settle(self) -> ImageAccount:
        """Match anew, write changed matches down, and count."""
        viewpoints = self._viewpoints()
        return self._write_down(viewpoints, *self._match(self._stored(), viewpoints))

    async def settle_aside(self) -> ImageAccount:
        """The same without holding up the event loop by reading files and comparing."""
        viewpoints = self._viewpoints()
        return self._write_down(viewpoints, *await asyncio.to_thread(self._match, self._stored(), viewpoints))

    def _viewpoints(self) -> list[Viewpoint]:
        """The plan's, with the places that reports tell of those that were moved."""
        plan = self._plan
        places = moved_places(self._recorder.database, plan, self._recorder.flight)
        return [
            moved_viewpoint(v, np.array(places[v.id]), plan.scenario.camera) if v.id in places else v
            for v in plan.viewpoints
        ]

    def _stored(self) -> list[ImageRecord]:
        images = self._recorder.database.images.of_flight(self._recorder.flight_id)
        return [i for i in images if i.state is ImageState.STORED]

    def _match(
        self, stored: list[ImageRecord], viewpoints: list[Viewpoint]
    ) -> tuple[list[ImageRecord], list[int | None], NDArray[np.float64]]:
        """The pictures in order, the index of each one's viewpoint, and where they were taken; writes nothing."""
        images = self._in_order(stored)
        positions, headings = np.full((len(images), 3), np.nan), np.full(len(images), np.nan)
        for k, image in enumerate(images):
            told = self._from_file(image)
            position = image.position_m or told.position_m
            if position is not None:
                positions[k] = position
            if told.yaw_rad is not None:
                headings[k] = told.yaw_rad
        return images, match_images(positions, headings, *_wanted(viewpoints)), positions

    def _write_down(
        self,
        viewpoints: list[Viewpoint],
        images: list[ImageRecord],
        matches: list[int | None],
        positions: NDArray[np.float64],
    ) -> ImageAccount:
        recorder = self._recorder
        misses: dict[int, float] = {}
        at_place: set[int] = set()
        planned_m = {v.id: v.position_m for v in self._plan.viewpoints}
        for image, match, place in zip(images, matches, positions, strict=True):
            viewpoint = None if match is None else viewpoints[match]
            viewpoint_id, name = (None, None) if viewpoint is None else (viewpoint.id, viewpoint.name)
            if image.viewpoint_id != viewpoint_id:
                recorder.change_image(image.id, viewpoint_id=viewpoint_id, viewpoint_name=name)
            if viewpoint is not None and not np.isnan(place).any():
                misses[viewpoint.id] = float(np.linalg.norm(place - planned_m[viewpoint.id]))
                if np.linalg.norm(place - viewpoint.position_m) <= REACHED_M:
                    at_place.add(viewpoint.id)
        seen = {m for m in matches if m is not None}
        missing = tuple(v.name for k, v in enumerate(viewpoints) if k not in seen)
        return ImageAccount(
            expected=len(viewpoints),
            received=len(seen),
            missing=missing,
            unmatched=sum(m is None for m in matches),
            pictured=frozenset(viewpoints[k].id for k in seen),
            misses_m=misses,
            at_place=frozenset(at_place),
        )

    def _in_order(self, images: list[ImageRecord]) -> list[ImageRecord]:
        """In the order in which they were taken, as far as it is known."""
        if all(self._from_file(i).taken_at is not None for i in images):
            return sorted(images, key=lambda i: (self._from_file(i).taken_at, *_numbers(i)))
        return sorted(images, key=lambda i: (i.vehicle_time_s or 0.0, *_numbers(i)))

    def _from_file(self, image: ImageRecord) -> _Told:
        if image.id not in self._told:
            try:
                metadata = read_metadata(self._recorder.image_data(image), image.id)
                told = _Told(metadata.taken_at, metadata.yaw_rad, scene_position(self._plan, metadata.position))
            except (InputError, NotFoundError):
                told = _Told(None, None, None)
            self._told[image.id] = told
        return self._told[image.id]


def count_pictures_as_visits(account: ImageAccount, plan: Plan, recorder: FlightRecorder) -> None:
    """A picture that was taken at its place shows that the vehicle was there, also when nobody listened then."""
    known = {v.viewpoint_id for v in recorder.database.flights.visits(recorder.flight_id)}
    for viewpoint in plan.viewpoints:
        if viewpoint.id not in known and viewpoint.id in account.at_place:
            recorder.visit(viewpoint.id, viewpoint.name, account.misses_m[viewpoint.id])


def complete_by_pictures(account: ImageAccount, recorder: FlightRecorder) -> bool:
    """Whether an incomplete flight became complete by pictures that came later; then its state says so."""
    flight = recorder.flight
    reached = recorder.database.flights.visits(recorder.flight_id)
    if flight.state is not FlightState.INCOMPLETE or not account.complete or len(reached) < flight.viewpoints:
        return False
    solved = tuple(p for p in flight.problems if MISSING not in p and NOT_REACHED not in p)
    recorder.change(problems=solved)
    recorder.enter(FlightState.COMPLETED, f"{account.received} of {account.expected} images are here")
    return True


def _wanted(viewpoints: list[Viewpoint]) -> tuple[np.ndarray, np.ndarray]:
    positions = np.array([v.position_m for v in viewpoints]).reshape(-1, 3)
    headings = [math.nan if abs(v.gimbal_pitch_rad) > STEEP_RAD else v.yaw_rad for v in viewpoints]
    return positions, np.array(headings)


def _numbers(image: ImageRecord) -> tuple[int, int, str]:
    """The vehicle's running number, the number in the file's name, and the name."""
    path = image.vehicle_path or image.id
    number = _NUMBER.search(path[-40:])
    return (image.index or 0, int(number[1]) if number else 0, path)
