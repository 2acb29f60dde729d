"""The camera's side of a vehicle: which component it is, pictures it announces, and announcements that were lost."""

from __future__ import annotations

from gcs.core.vehicle import ImageReport
from gcs.mavlink.autopilots.base import CommandCall
from gcs.mavlink.camera_description import CameraDescription
from gcs.mavlink.command_protocol import command_long
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.image_messages import ImageGaps, image_report
from gcs.mavlink.transaction import Send

ASK_EVERY_S = 2.0
DESCRIPTION_TRIES = 5
DESCRIPTION_MESSAGES = frozenset({"CAMERA_INFORMATION", "CAMERA_SETTINGS", "STORAGE_INFORMATION"})
CAMERA_MESSAGES = DESCRIPTION_MESSAGES | {
    "HEARTBEAT",
    "CAMERA_CAPTURE_STATUS",
    "CAMERA_IMAGE_CAPTURED",
    "CAMERA_FEEDBACK",
}
"""All that `CameraWatch.take` has a use for."""
CAMERA_IDS = range(mavlink.MAV_COMP_ID_CAMERA, mavlink.MAV_COMP_ID_CAMERA6 + 1)


class CameraWatch:
    """Follows the camera of one vehicle.

    A camera component's pictures are numbered, so lost announcements are noticed and asked for again; how many it took
    in all is asked every `ASK_EVERY_S`, so that the loss of the last one is noticed too. Where the autopilot announces
    pictures in the camera's stead (CAMERA_FEEDBACK) they are not asked for, as each would then be announced twice. What
    the camera is gets asked until it is known, a few times.

    Args:
        system_id: of the vehicle.
        send: puts a message on the link.
        asks: whether the camera announces its pictures itself and can be asked for lost announcements.

    Attributes:
        component: the camera's component id; None until it was heard.
        description: what it tells of itself.
    """

    def __init__(self, system_id: int, send: Send, *, asks: bool = True) -> None:
        self._system_id = system_id
        self._send = send
        self._asks = asks
        self._gaps: ImageGaps | None = None
        self._asked_at = float("-inf")
        self._descriptions_asked = 0
        self.component: int | None = None
        self.description = CameraDescription()

    def take(self, message: Message) -> ImageReport | None:
        """Take a message of the vehicle; returns the picture that it announces."""
        kind = message.get_type()
        component = message.get_srcComponent()
        if kind == "HEARTBEAT" and message.type == mavlink.MAV_TYPE_CAMERA and self.component is None:
            self.component = component
        elif kind == "CAMERA_CAPTURE_STATUS" and component == self.component:
            if self._gaps is None and message.image_count >= 0:
                self._gaps = ImageGaps(message.image_count)
            elif self._gaps is not None:
                self._gaps.taken_so_far(message.image_count)
        if component == self.component:
            self.description = self.description.with_message(message)
        report = image_report(message)
        if report is not None and kind == "CAMERA_IMAGE_CAPTURED":
            if self.component is None and component in CAMERA_IDS:
                self.component = component
            if component == self.component:
                self._gaps = self._gaps or ImageGaps()
                self._gaps.heard(report.index)
        return report

    def on_time(self, now_s: float) -> None:
        """Ask for what is missing; to be called several times a second."""
        if self.component is None:
            return
        for index in self._gaps.due(now_s) if self._gaps is not None and self._asks else ():
            self._ask(mavlink.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED, index)
        if now_s - self._asked_at < ASK_EVERY_S:
            return
        self._asked_at = now_s
        if self._asks:
            self._ask(mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS, 0)
        missing = self.description.missing()
        if missing and self._descriptions_asked < DESCRIPTION_TRIES:
            self._descriptions_asked += 1
            for message_id in missing:
                self._ask(message_id, 0)

    def _ask(self, message_id: int, index: int) -> None:
        if self.component is not None:
            call = CommandCall(mavlink.MAV_CMD_REQUEST_MESSAGE, (float(message_id), float(index)))
            self._send(command_long(call, (self._system_id, self.component), 0))
