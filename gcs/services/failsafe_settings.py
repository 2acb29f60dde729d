"""Failsafes that the operator has the station set, instead of accepting that they are off (safety rule 5)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from gcs.core.errors import InputError, RefusedError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from gcs.mavlink.vehicle import Vehicle


def wanted_settings(accepted: Sequence[str]) -> dict[str, float]:
    """Entries of the form NAME=VALUE among what the operator accepts; the last of a name counts.

    Raises:
        InputError: the value is no number.
    """
    wanted = {}
    for entry in accepted:
        name, equals, text = entry.partition("=")
        if not equals:
            continue
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise InputError(f"{entry!r} is not NAME=VALUE with a number", field="accept")
        wanted[name.strip()] = value
    return wanted


async def set_failsafes(vehicle: Vehicle, accepted: Sequence[str], tell: Callable[[str], None]) -> None:
    """Set failsafes on a disarmed vehicle as the operator asked, and see that it keeps them.

    Args:
        vehicle: it.
        accepted: what the operator accepts; entries NAME=VALUE are settings, others are not looked at.
        tell: takes what was changed, in words.

    Raises:
        InputError: a value is no number, or does not fit.
        RefusedError: it is no failsafe, the vehicle is armed, or it keeps another value.
        LinkError: it does not answer.
    """
    wanted = wanted_settings(accepted)
    strange = [name for name in wanted if name not in vehicle.failsafe_parameters]
    if strange:
        known = ", ".join(vehicle.failsafe_parameters) or "none"
        raise RefusedError(f"{', '.join(strange)} is no failsafe of it; there are {known}", field=vehicle.identity.name)
    if not wanted:
        return
    before = await vehicle.read_parameters(wanted)
    for name, value in wanted.items():
        if before[name] == value:
            continue
        armed = vehicle.telemetry.armed
        if armed is None or armed.value:
            raise RefusedError(
                f"{name} is set on a disarmed vehicle only: land and disarm it", field=vehicle.identity.name
            )
        kept = await vehicle.set_parameter(name, value)
        was = "unknown" if before[name] is None else f"{before[name]:g}"
        tell(f"{name} of {vehicle.identity.name} was set from {was} to {kept:g}, as the operator asked")
