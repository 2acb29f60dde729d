"""Energy of a flight, by the rotors' power along its curve (`rotor_power`), and what a battery allows.

Published flight times: a DJI M300 of 6.3 kg on four rotors of 0.533 m stays up for 55 min with 548 Wh, which is 598 W;
the model gives 669 W at hover with these rotors, and 795 W where the scenario names only the mass. A DJI Phantom 4 Pro
of 1.388 kg on four rotors of 9.4 inches is said to fly for 30 min with 89.2 Wh: 178 W, the model gives 162 W. The
reserve stands for such differences, for wind and for cold.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.planning.dynamics.rotor_power import RotorPower

if TYPE_CHECKING:
    from gcs.core.scenario import Battery, VehicleSpec
    from gcs.core.trajectory import PiecewisePolynomial

SAMPLE_GAP_S = 0.05


def energy_wh(
    trajectory: PiecewisePolynomial, vehicle: VehicleSpec, start_s: float = 0.0, end_s: float | None = None
) -> float:
    """Energy (Wh) that flying a trajectory takes from the battery, by the trapezoidal rule over samples 50 ms apart.

    Args:
        trajectory: what is flown.
        vehicle: whose power it takes.
        start_s: from when on.
        end_s: until when; its end when not given.
    """
    end = trajectory.duration_s if end_s is None else end_s
    t = np.linspace(start_s, end, int(np.ceil((end - start_s) / SAMPLE_GAP_S)) + 1)
    power = RotorPower.of(vehicle).power_w(trajectory.value(t, 1), trajectory.value(t, 2))
    return float(np.trapezoid(power, t)) / 3600


def usable_wh(battery: Battery) -> float:
    """What a flight may take from a battery: all but the reserve (safety rule 8)."""
    return battery.capacity_wh * (1 - battery.reserve)


def require_battery(needed_wh: float, battery: Battery | None) -> None:
    """Refuse a flight that needs more than the battery less its reserve (safety rule 8).

    Args:
        needed_wh: energy of the whole flight.
        battery: what there is; None when the scenario says nothing about it.

    Raises:
        InfeasibleError: it is not enough.
    """
    if battery is None:
        return
    usable = usable_wh(battery)
    if needed_wh > usable:
        raise InfeasibleError(
            f"the flight needs {needed_wh:.1f} Wh, but {battery.capacity_wh:g} Wh less a reserve of "
            f"{battery.reserve:.0%} leave {usable:.1f} Wh: inspect less in one flight (regions, fewer points, a "
            "coarser GSD), fly faster, or take a larger battery",
            field="vehicle.battery",
        )
