"""The camera component (id 100): takes pictures, keeps them as files, and tells of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass

from gcs.core.frames import heading_from_yaw
from sitl_mocks.commands import ACCEPTED, DENIED, UNSUPPORTED, Command
from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.distance_trigger import DistanceTrigger
from sitl_mocks.file_tree import FileTree
from sitl_mocks.picture import (
    FOCAL_LENGTH_MM,
    HEIGHT_PX,
    SENSOR_HEIGHT_MM,
    SENSOR_WIDTH_MM,
    WIDTH_PX,
    Exposure,
)
from sitl_mocks.scene_frame import Array, e7

CAPACITY_MIB = 32_000.0
_OLD_REQUESTS = {
    mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION: mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION,
    mavlink.MAV_CMD_REQUEST_CAMERA_SETTINGS: mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS,
    mavlink.MAV_CMD_REQUEST_STORAGE_INFORMATION: mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION,
    mavlink.MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS: mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS,
}


@dataclass
class Shot:
    """A picture that was taken; its file comes when it has been drawn."""

    exposure: Exposure
    path: str
    drawing: Future[bytes]


@dataclass
class CameraFolder(FileTree):
    """The files of the camera."""

    folders: tuple[str, ...] = ("/DCIM",)


class Camera:
    """Takes pictures when told; a command that is sent again takes no second picture.

    Args:
        expose: what the camera sees at this instant, given the running number and the commanded sequence.
        draw: draws a picture, in the background or at once.
        folder: receives the files.
        boot_ms: the vehicle's clock.
        announce: called with what the camera has to tell when a picture has been stored.
        taken: called at each exposure.
        tells_files: whether what it announces names its files.
    """

    def __init__(
        self,
        *,
        expose: Callable[[int, int], Exposure],
        draw: Callable[[Exposure], Future[bytes]],
        folder: CameraFolder,
        boot_ms: Callable[[], int],
        announce: Callable[[Message | None], None],
        taken: Callable[[Exposure], None] = lambda _: None,
        tells_files: bool = True,
    ) -> None:
        self._expose = expose
        self._draw = draw
        self.folder = folder
        self._boot_ms = boot_ms
        self._announce = announce
        self._taken = taken
        self._tells_files = tells_files
        self._last_sequence = 0
        self._interval_s = 0.0
        self._left = 0
        self._next_s = 0.0
        self._trigger = DistanceTrigger()
        self.shots: list[Shot] = []
        self._stored = 0

    def begin_flight(self) -> None:
        """A new flight counts its commands from the beginning, and takes no pictures of its own."""
        self._last_sequence = 0
        self._trigger = DistanceTrigger()

    def start_capture(self, interval_s: float, total: int, sequence: int, now_s: float) -> int:
        """IMAGE_START_CAPTURE; returns the MAV_RESULT."""
        if total == 1 and sequence > 0:
            if sequence == self._last_sequence:
                return int(mavlink.MAV_RESULT_ACCEPTED)  # the command was sent again
            self._last_sequence = sequence
        if total != 1 and not interval_s > 0.0:
            return int(mavlink.MAV_RESULT_DENIED)
        self.take(sequence)
        self._interval_s = interval_s
        self._left = total - 1 if total > 0 else 1_000_000
        self._next_s = now_s + interval_s
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def stop_capture(self) -> None:
        """IMAGE_STOP_CAPTURE."""
        self._left = 0

    def take(self, sequence: int = 0) -> None:
        """Expose now."""
        exposure = self._expose(len(self.shots), sequence)
        path = f"/DCIM/IMG_{exposure.index + 1:04d}.JPG"
        self.shots.append(Shot(exposure, path, self._draw(exposure)))
        self._taken(exposure)

    def step(self, now_s: float, position_m: Array) -> None:
        """Take the pictures whose time or place has come, store what has been drawn, and tell of it in order."""
        while self._left > 0 and now_s >= self._next_s:
            self._left -= 1
            self._next_s += self._interval_s
            self.take()
        if self._trigger.is_due(position_m):
            self.take()
        while self._stored < len(self.shots) and self.shots[self._stored].drawing.done():
            shot = self.shots[self._stored]
            self.folder.files[shot.path] = shot.drawing.result()
            self._stored += 1
            self._announce(self.captured_message(shot.exposure.index))
            self._announce(self.status_message())

    def newest_file(self) -> bytes | None:
        """The newest picture that has been stored."""
        return self.folder.files[self.shots[self._stored - 1].path] if self._stored else None

    def captured_message(self, index: int) -> Message | None:
        """CAMERA_IMAGE_CAPTURED of a picture; None when there is no such picture yet."""
        if not 0 <= index < self._stored:
            return None
        shot = self.shots[index]
        exposure = shot.exposure
        return mavlink.MAVLink_camera_image_captured_message(
            round(exposure.boot_s * 1e3),
            round(exposure.unix_s * 1e6),
            1,
            e7(exposure.place.latitude_deg),
            e7(exposure.place.longitude_deg),
            round(exposure.place.altitude_m * 1e3),
            round((exposure.place.altitude_m - exposure.home_altitude_m) * 1e3),
            _quaternion(exposure),
            exposure.index,
            1,
            f"mftp:{shot.path}".encode() if self._tells_files else b"",
        )

    def status_message(self) -> Message:
        """CAMERA_CAPTURE_STATUS."""
        return mavlink.MAVLink_camera_capture_status_message(
            self._boot_ms(), 1 if self._left > 0 else 0, 0, self._interval_s, 0, CAPACITY_MIB, self._stored
        )

    def information_message(self) -> Message:
        """CAMERA_INFORMATION."""
        return mavlink.MAVLink_camera_information_message(
            self._boot_ms(),
            list(b"gcs".ljust(32, b"\0")),
            list(b"sitl_mocks camera".ljust(32, b"\0")),
            1,
            FOCAL_LENGTH_MM,
            SENSOR_WIDTH_MM,
            SENSOR_HEIGHT_MM,
            WIDTH_PX,
            HEIGHT_PX,
            0,
            mavlink.CAMERA_CAP_FLAGS_CAPTURE_IMAGE,
            0,
            b"",
        )

    def storage_message(self) -> Message:
        """STORAGE_INFORMATION."""
        used = sum(len(data) for data in self.folder.files.values()) / 2**20
        return mavlink.MAVLink_storage_information_message(
            self._boot_ms(),
            1,
            1,
            mavlink.STORAGE_STATUS_READY,
            CAPACITY_MIB,
            used,
            CAPACITY_MIB - used,
            50.0,
            20.0,
        )

    def settings_message(self) -> Message:
        """CAMERA_SETTINGS."""
        return mavlink.MAVLink_camera_settings_message(self._boot_ms(), mavlink.CAMERA_MODE_IMAGE)

    def run_command(self, command: Command, now_s: float, reply: Callable[[Message], None]) -> int:
        """Carry out a command for the camera component.

        Args:
            command: it.
            now_s: the vehicle's clock.
            reply: sends a message that was asked for.

        Returns:
            The MAV_RESULT.
        """
        m = mavlink
        if command.number == m.MAV_CMD_IMAGE_START_CAPTURE:
            sequence = command.params[3]
            count = int(sequence) if math.isfinite(sequence) else 0
            return self.start_capture(command.params[1], int(command.params[2]), count, now_s)
        if command.number == m.MAV_CMD_IMAGE_STOP_CAPTURE:
            self.stop_capture()
            return ACCEPTED
        if command.number == m.MAV_CMD_DO_SET_CAM_TRIGG_DIST:
            self._trigger = DistanceTrigger(command.params[0], at_once=command.params[2] == 1.0)
            return ACCEPTED
        if command.number == m.MAV_CMD_SET_CAMERA_MODE:
            return ACCEPTED if int(command.params[1]) == m.CAMERA_MODE_IMAGE else UNSUPPORTED
        message_id = _OLD_REQUESTS.get(command.number)
        if command.number == m.MAV_CMD_REQUEST_MESSAGE:
            message_id = int(command.params[0])
        if message_id is None:
            return UNSUPPORTED
        message = self._message(message_id, command.params[1])
        if message is None:
            return DENIED if message_id == m.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED else UNSUPPORTED
        reply(message)
        return ACCEPTED

    def _message(self, message_id: int, index: float) -> Message | None:
        m = mavlink
        if message_id == m.MAVLINK_MSG_ID_CAMERA_INFORMATION:
            return self.information_message()
        if message_id == m.MAVLINK_MSG_ID_CAMERA_SETTINGS:
            return self.settings_message()
        if message_id == m.MAVLINK_MSG_ID_STORAGE_INFORMATION:
            return self.storage_message()
        if message_id == m.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS:
            return self.status_message()
        if message_id == m.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED and math.isfinite(index):
            return self.captured_message(int(index))
        return None


def feedback_message(exposure: Exposure, taken: int) -> Message:
    """CAMERA_FEEDBACK, by which ArduPilot tells of an exposure; with how many were taken so far."""
    place = exposure.place
    return mavlink.MAVLink_camera_feedback_message(
        round(exposure.unix_s * 1e6),
        0,
        0,
        exposure.index + 1,
        e7(place.latitude_deg),
        e7(place.longitude_deg),
        place.altitude_m,
        place.altitude_m - exposure.home_altitude_m,
        math.degrees(exposure.roll_rad),
        math.degrees(exposure.pitch_rad),
        math.degrees(heading_from_yaw(exposure.yaw_rad)),
        0.0,
        0,
        taken,
    )


def _quaternion(exposure: Exposure) -> list[float]:
    """Attitude of the camera, north-east-down, w first."""
    heading = math.pi / 2 - exposure.yaw_rad
    cy, sy = math.cos(heading / 2), math.sin(heading / 2)
    cp, sp = math.cos(exposure.pitch_rad / 2), math.sin(exposure.pitch_rad / 2)
    return [cy * cp, -sy * sp, cy * sp, sy * cp]
