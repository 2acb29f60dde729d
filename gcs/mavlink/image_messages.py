"""Pictures as vehicles announce them: CAMERA_IMAGE_CAPTURED (PX4 side) and CAMERA_FEEDBACK (ArduPilot)."""

from __future__ import annotations

from gcs.core.frames import GeoPoint
from gcs.core.vehicle import ImageReport
from gcs.mavlink.dialect import Message

_LONGEST_UPTIME_S = 10 * 365 * 86400.0
"""CAMERA_FEEDBACK's time is since boot or since 1970, without saying which; a larger value cannot be since boot."""


def image_report(message: Message) -> ImageReport | None:
    """The picture that a message announces; None for other messages and impossible content."""
    kind = message.get_type()
    if kind == "CAMERA_IMAGE_CAPTURED":
        if message.image_index < 0:
            return None
        return ImageReport(
            index=message.image_index,
            file=_text(message.file_url),
            position=_position(message.lat, message.lon, message.alt / 1000.0),
            at_vehicle_s=message.time_boot_ms / 1000.0,
            success=message.capture_result == 1,
        )
    if kind == "CAMERA_FEEDBACK":
        time_s = message.time_usec / 1e6
        return ImageReport(
            index=message.img_idx,
            file=None,
            position=_position(message.lat, message.lng, message.alt_msl),
            at_vehicle_s=time_s if time_s < _LONGEST_UPTIME_S else None,
        )
    return None


def _text(raw: str | bytes) -> str | None:
    text = raw.decode("utf-8", "replace") if isinstance(raw, bytes) else raw
    return text.rstrip("\0") or None


def _position(latitude: int, longitude: int, altitude_m: float) -> GeoPoint | None:
    """A position, unless it is the "not known" of 0/0 or impossible."""
    if latitude == 0 and longitude == 0:
        return None
    if abs(latitude) > 900_000_000 or abs(longitude) > 1_800_000_000 or not abs(altitude_m) < 1e5:
        return None
    return GeoPoint(latitude / 1e7, longitude / 1e7, altitude_m)


class ImageGaps:
    """Which announcements of pictures were lost, and when to ask for them again.

    The vehicle numbers its pictures; a number that was jumped over is a lost message. Lost ones are asked for with
    MAV_CMD_REQUEST_MESSAGE, patiently, and given up after some tries.

    Args:
        first: the first number that is expected; None takes the first that is heard, as earlier pictures may belong to
            another flight.
        retry_s: pause between two requests for one number.
        tries: requests for one number before it is given up.
        most: at most so many numbers are followed; a jump beyond that is a new count of the vehicle's.
    """

    def __init__(self, first: int | None = None, *, retry_s: float = 1.0, tries: int = 10, most: int = 1000) -> None:
        self._next = first
        self._retry_s = retry_s
        self._tries = tries
        self._most = most
        self._missing: dict[int, tuple[float, int]] = {}

    @property
    def missing(self) -> tuple[int, ...]:
        """Numbers that are known to exist and have not been heard, given-up ones too."""
        return tuple(sorted(self._missing))

    @property
    def expected(self) -> int | None:
        """The number that the next picture will have; None before the first."""
        return self._next

    def heard(self, index: int) -> bool:
        """Take the number of an announcement.

        Returns:
            Whether it is new; False for one that was heard before.
        """
        if self._next is None or index >= self._next + self._most:
            self._missing.clear()
            self._next = index + 1
            return True
        if index >= self._next:
            self._missing.update((lost, (float("-inf"), 0)) for lost in range(self._next, index))
            while len(self._missing) > self._most:
                del self._missing[min(self._missing)]
            self._next = index + 1
            return True
        return self._missing.pop(index, None) is not None

    def taken_so_far(self, count: int) -> None:
        """Take the vehicle's own total (CAMERA_CAPTURE_STATUS.image_count): numbers below it exist."""
        if self._next is not None and self._next < count < self._next + self._most:
            self._missing.update((lost, (float("-inf"), 0)) for lost in range(self._next, count))
            self._next = count

    def due(self, now_s: float) -> tuple[int, ...]:
        """Numbers to ask for now; each is then due again after the pause, until given up."""
        due = []
        for index, (asked_at, tries) in sorted(self._missing.items()):
            if tries < self._tries and now_s >= asked_at + self._retry_s:
                self._missing[index] = (now_s, tries + 1)
                due.append(index)
        return tuple(due)
