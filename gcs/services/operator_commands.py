"""What every command of an operator to a flight has to pass: its turn, and the vehicle's name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.core.errors import ConflictError, RefusedError

if TYPE_CHECKING:
    from gcs.mavlink.vehicle import Vehicle


class OneAtATime:
    """One command of a flight at a time.

    Args:
        busy: flights with a command under way.
        flight_id: which flight.
    """

    def __init__(self, busy: set[str], flight_id: str) -> None:
        self._busy = busy
        self._flight_id = flight_id

    async def __aenter__(self) -> None:
        if self._flight_id in self._busy:
            raise ConflictError("another command of this flight is under way", field=self._flight_id)
        self._busy.add(self._flight_id)

    async def __aexit__(self, *error: object) -> None:
        self._busy.discard(self._flight_id)


def require_confirmation(vehicle: Vehicle, confirm: str) -> None:
    """Refuse a confirmation that does not name the vehicle (safety rule 2)."""
    if confirm.strip() not in {vehicle.identity.name, str(vehicle.identity.system_id)}:
        raise RefusedError(f"the confirmation does not name the vehicle: type {vehicle.identity.name}", field="confirm")
