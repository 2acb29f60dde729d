"""When, where and in which direction a picture was taken, as its file says (EXIF)."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from PIL import Image, UnidentifiedImageError

from gcs.core.errors import InputError
from gcs.core.frames import GeoPoint, yaw_from_heading

if TYPE_CHECKING:
    from collections.abc import Mapping

# Pillow loads its readers with the first picture; that would hold up a stream of setpoints for part of a second.
Image.preinit()

_GPS_IFD, _EXIF_IFD = 0x8825, 0x8769
_DATE_TIME, _DATE_TIME_ORIGINAL, _SUBSECONDS_ORIGINAL = 0x0132, 0x9003, 0x9291


@dataclass(frozen=True)
class ImageMetadata:
    """What a picture's file tells; None where it does not.

    Attributes:
        taken_at: by the camera's own clock, which may be wrong; without a zone it is taken for UTC.
        position: altitude above mean sea level.
        yaw_rad: heading of the view from east, counter-clockwise.
    """

    taken_at: datetime | None
    position: GeoPoint | None
    yaw_rad: float | None


def read_metadata(data: bytes, name: str) -> ImageMetadata:
    """Read a picture's EXIF.

    Args:
        data: the file.
        name: of the file, for the error.

    Raises:
        InputError: it is not a picture, or a broken one.
    """
    try:
        with Image.open(io.BytesIO(data)) as image:
            exif = image.getexif()
            gps, details = dict(exif.get_ifd(_GPS_IFD)), dict(exif.get_ifd(_EXIF_IFD))
            taken = details.get(_DATE_TIME_ORIGINAL, exif.get(_DATE_TIME))
            image.load()
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        raise InputError(f"not a whole picture: {error}", field=name) from error
    return ImageMetadata(_moment(taken, details.get(_SUBSECONDS_ORIGINAL)), _position(gps), _yaw(gps))


def _moment(taken: Any, subseconds: Any) -> datetime | None:
    try:
        moment = datetime.strptime(str(taken).strip("\0 "), "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
    except ValueError:
        return None
    digits = str(subseconds or "").strip("\0 ")
    return moment.replace(microsecond=int(f"{digits[:6]:0<6}")) if digits.isdigit() else moment


def _position(gps: Mapping[int, Any]) -> GeoPoint | None:
    try:
        latitude = _degrees(gps[2]) * (-1 if gps.get(1) == "S" else 1)
        longitude = _degrees(gps[4]) * (-1 if gps.get(3) == "W" else 1)
        altitude = float(gps[6]) * (-1 if gps.get(5) in {1, b"\x01"} else 1)
    except (KeyError, TypeError, ValueError, ZeroDivisionError, IndexError):
        return None
    if not all(math.isfinite(v) for v in (latitude, longitude, altitude)) or abs(latitude) > 90 or abs(longitude) > 180:
        return None
    return GeoPoint(latitude, longitude, altitude)


def _degrees(parts: Any) -> float:
    return float(parts[0]) + float(parts[1]) / 60 + float(parts[2]) / 3600


def _yaw(gps: Mapping[int, Any]) -> float | None:
    try:
        heading = math.radians(float(gps[17]))
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None
    return yaw_from_heading(heading) if math.isfinite(heading) else None
