"""Energy of a flight: a simple power model of a multirotor, from its mass alone.

The rotors' thrust `T = |m (a + g e_z) + D|` holds the weight, accelerates the vehicle and overcomes the drag
`D = 1/2 rho C_d A |v| v`. Ideal power by momentum theory (J. G. Leishman, Principles of Helicopter Aerodynamics,
ch. 2): hovering takes `T sqrt(T / (2 rho A_rotors))`. Climbing adds `m g v_z`, moving through the air `D . v`. All of
it is divided by one efficiency from battery to air, which stands for the rotors' profile losses (figure of merit about
0.6) and those of motors and controllers (about 0.83).

It errs on the high side where it is simple: sinking gives nothing back, and the smaller induced power of forward
flight is not counted. Against published hover times: a 6.3 kg DJI M300 with 548 Wh is said to stay up for 55 min, which
is 598 W; the model gives 792 W. The payload is part of the mass; the electronics on board have their own constant.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.scenario import Battery
    from gcs.core.trajectory import PiecewisePolynomial

GRAVITY_M_S2 = 9.80665
AIR_DENSITY_KG_M3 = 1.225
DISC_LOADING_KG_M2 = 10.0
"""Mass per area of all rotor discs; common multirotors of 1 to 10 kg have 6 to 12."""

EFFICIENCY = 0.5
DRAG_AREA_M2 = 0.025
"""Drag coefficient times frontal area of a vehicle of 1 kg; it grows with the mass to the power 2/3."""

ELECTRONICS_W = 10.0
SAMPLE_GAP_S = 0.05


def hover_power_w(mass_kg: float) -> float:
    """Power from the battery (W) at hover."""
    return float(flight_power_w(np.zeros(3), np.zeros(3), mass_kg))


def flight_power_w(velocity_m_s: ArrayLike, acceleration_m_s2: ArrayLike, mass_kg: float) -> NDArray[np.float64]:
    """Power from the battery (W).

    Args:
        velocity_m_s: through still air, scene ENU, shape (..., 3).
        acceleration_m_s2: shape (..., 3).
        mass_kg: take-off mass.

    Returns:
        Shape (...).
    """
    v, a = np.asarray(velocity_m_s, dtype=np.float64), np.asarray(acceleration_m_s2, dtype=np.float64)
    speed = np.linalg.norm(v, axis=-1)
    drag = 0.5 * AIR_DENSITY_KG_M3 * DRAG_AREA_M2 * mass_kg ** (2 / 3) * speed[..., None] * v
    thrust = np.linalg.norm(mass_kg * (a + np.array([0.0, 0.0, GRAVITY_M_S2])) + drag, axis=-1)
    disc_area = mass_kg / DISC_LOADING_KG_M2
    induced = thrust * np.sqrt(thrust / (2 * AIR_DENSITY_KG_M3 * disc_area))
    climb = mass_kg * GRAVITY_M_S2 * np.maximum(v[..., 2], 0.0)
    through_air = np.einsum("...i,...i->...", drag, v)
    return np.asarray((induced + climb + through_air) / EFFICIENCY + ELECTRONICS_W)


def energy_wh(trajectory: PiecewisePolynomial, mass_kg: float) -> float:
    """Energy (Wh) that flying a trajectory takes from the battery, by the trapezoidal rule over samples 50 ms apart."""
    t = np.linspace(0.0, trajectory.duration_s, int(np.ceil(trajectory.duration_s / SAMPLE_GAP_S)) + 1)
    power = flight_power_w(trajectory.value(t, 1), trajectory.value(t, 2), mass_kg)
    return float(np.trapezoid(power, t)) / 3600


def require_battery(needed_wh: float, battery: Battery | None) -> None:
    """Refuse a plan that needs more than the battery less its reserve (safety rule 8).

    Args:
        needed_wh: energy of the whole flight.
        battery: what there is; None when the scenario says nothing about it.

    Raises:
        InfeasibleError: it is not enough.
    """
    if battery is None:
        return
    usable = battery.capacity_wh * (1 - battery.reserve)
    if needed_wh > usable:
        raise InfeasibleError(
            f"the flight needs {needed_wh:.1f} Wh, but {battery.capacity_wh:g} Wh less a reserve of "
            f"{battery.reserve:.0%} leave {usable:.1f} Wh: inspect less in one flight (regions, fewer points, a "
            "coarser GSD), fly faster, or take a larger battery",
            field="vehicle.battery",
        )
