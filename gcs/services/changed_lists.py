"""Somebody else changed what a vehicle holds after the station had proved it: said, and no longer taken for proved."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from gcs.core.errors import GcsError
from gcs.mavlink.mission_protocol import MissionType
from gcs.services.flight_recorder import ERROR

if TYPE_CHECKING:
    from gcs.services.flight_recorder import FlightRecorder

log = logging.getLogger(__name__)


def note_changed_list(recorder: FlightRecorder, mission_type: MissionType) -> None:
    """Write down that a list of the flight's vehicle was changed; what it holds is unknown until it is read again."""
    try:
        if mission_type is MissionType.MISSION:
            if not recorder.flight.proved:
                return
            recorder.change(proved=False)
        words = f"somebody else changed the vehicle's {mission_type.noun} after the station had proved or read it"
        recorder.log("problem", f"{words}: what it holds is not known until it is read again", severity=ERROR)
    except GcsError:
        log.exception("flight %s: a changed %s is not recorded", recorder.flight_id, mission_type.noun)
