"""What a camera tells of itself (camera protocol v2): CAMERA_INFORMATION, CAMERA_SETTINGS, STORAGE_INFORMATION."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gcs.mavlink.dialect import Message, mavlink

_LONGEST_NAME = 32


@dataclass(frozen=True)
class CameraDescription:
    """A camera as it describes itself; None where it does not, or where the number is impossible.

    Attributes:
        name: vendor and model, untrusted text.
        focal_length_mm: of the lens.
        sensor_mm: width and height.
        resolution_px: width and height.
        takes_images: whether it can.
        in_image_mode: whether it is set to.
        storage_ready: whether it has a formatted medium, or more.
        free_mib: room on it.
    """

    name: str | None = None
    focal_length_mm: float | None = None
    sensor_mm: tuple[float, float] | None = None
    resolution_px: tuple[int, int] | None = None
    takes_images: bool | None = None
    in_image_mode: bool | None = None
    storage_ready: bool | None = None
    free_mib: float | None = None

    def with_message(self, message: Message) -> CameraDescription:
        """The description after one more message of the camera."""
        kind = message.get_type()
        if kind == "CAMERA_INFORMATION":
            return self._with_information(message)
        if kind == "CAMERA_SETTINGS":
            return replace(self, in_image_mode=message.mode_id != mavlink.CAMERA_MODE_VIDEO)
        if kind == "STORAGE_INFORMATION":
            return self._with_storage(message)
        if kind == "CAMERA_CAPTURE_STATUS" and _positive(message.available_capacity) is not None:
            return replace(self, free_mib=_positive(message.available_capacity))
        return self

    def missing(self) -> tuple[int, ...]:
        """Ids of the messages that have not been heard."""
        known = {
            mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION: self.takes_images,
            mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS: self.in_image_mode,
            mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION: self.storage_ready,
        }
        return tuple(number for number, value in known.items() if value is None)

    def words(self) -> str:
        """In one line."""
        parts = [self.name or "a camera without a name"]
        if self.focal_length_mm is not None:
            parts.append(f"{self.focal_length_mm:g} mm")
        if self.sensor_mm is not None:
            parts.append(f"sensor {self.sensor_mm[0]:g} x {self.sensor_mm[1]:g} mm")
        if self.resolution_px is not None:
            parts.append(f"{self.resolution_px[0]} x {self.resolution_px[1]} px")
        if self.free_mib is not None:
            parts.append(f"{self.free_mib:.0f} MiB free")
        return ", ".join(parts)

    def _with_information(self, message: Message) -> CameraDescription:
        names = (_text(message.vendor_name), _text(message.model_name))
        width, height = _positive(message.sensor_size_h), _positive(message.sensor_size_v)
        pixels = (int(message.resolution_h), int(message.resolution_v))
        return replace(
            self,
            name=" ".join(n for n in names if n) or None,
            focal_length_mm=_positive(message.focal_length),
            sensor_mm=None if width is None or height is None else (width, height),
            resolution_px=pixels if all(pixels) else None,
            takes_images=bool(message.flags & mavlink.CAMERA_CAP_FLAGS_CAPTURE_IMAGE),
        )

    def _with_storage(self, message: Message) -> CameraDescription:
        ready = message.status in {mavlink.STORAGE_STATUS_READY, mavlink.STORAGE_STATUS_NOT_SUPPORTED}
        free_mib = message.available_capacity
        told = message.status == mavlink.STORAGE_STATUS_READY and math.isfinite(free_mib) and free_mib >= 0
        return replace(self, storage_ready=ready, free_mib=float(free_mib) if told else self.free_mib)


def _text(raw: bytes | list[int]) -> str:
    text = bytes(raw).split(b"\0", 1)[0].decode("utf-8", "replace")
    return "".join(c for c in text if c.isprintable()).strip()[:_LONGEST_NAME]


def _positive(value: float) -> float | None:
    return float(value) if math.isfinite(value) and value > 0 else None
