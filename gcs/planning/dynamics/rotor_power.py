"""Power of a multirotor by momentum theory, in hover, climb, descent and forward flight.

The sources are W. Johnson, Helicopter Theory, ch. 2-5 and J. G. Leishman, Principles of Helicopter Aerodynamics, ch. 2
and 5; their formulas are used in this form:

- The rotors' thrust `T = m (a + g e_z) + D` holds the weight, accelerates the vehicle and overcomes its drag
  `D = 1/2 rho f |V| V`, f the drag area. Their axis lies along it.
- The induced velocity w solves Glauert's equation `w sqrt(V_t^2 + (V_n + w)^2) = v_h^2`, with V_n the speed along the
  axis (positive upward), V_t the one square to it and `v_h^2 = T / (2 rho A)`.
- Where the rotor sinks into its own wake (`-2 v_h <= V_n < 0`) momentum theory fails and tests show more:
  `w / v_h = 1 - 1.125 x - 1.372 x^2 - 1.718 x^3 - 0.655 x^4`, `x = V_n / v_h`. What this is above the equation's
  solution comes on top of it; it fades with V_t and is gone at `V_t = v_h`, where the wake is blown away.
- The shaft power is `T V_n + kappa T w + P_0`. The first term is all that climbing, drag and acceleration take; it is
  negative where the vehicle sinks. The profile power is `P_0 = c T^1.5 (1 + 4.65 mu^2)`: a rotor of fixed pitch turns
  at a tip speed U with `T = C_T rho A U^2`, and `mu = V_t / U`. Its constant c follows from the figure of merit.
- The battery gives the shaft power over the motors' efficiency, and what the electronics take. Nothing is ever given
  back to it.

The air is still: whoever plans with wind takes it off the battery.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from gcs.core.rotors import usual_rotors

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.rotors import Rotors
    from gcs.core.scenario import VehicleSpec

GRAVITY_M_S2 = 9.80665
AIR_DENSITY_KG_M3 = 1.225
INDUCED_POWER_FACTOR = 1.15
"""Kappa: induced power over that of an even inflow, for tip losses and an uneven one."""

DRAG_AREA_M2 = 0.025
"""Drag coefficient times frontal area of a vehicle of 1 kg; it grows with the mass to the power 2/3."""

_VORTEX_RING = (1.0, -1.125, -1.372, -1.718, -0.655)
_PROFILE_GROWTH = 4.65
_HALVINGS = 60


@dataclass(frozen=True)
class RotorPower:
    """Power model of one vehicle.

    Attributes:
        mass_kg: at take-off, payload included.
        rotors: its rotors and motors.
        drag_area_m2: drag coefficient times frontal area.
        avionics_w: what electronics and payload take from the battery.
    """

    mass_kg: float
    rotors: Rotors
    drag_area_m2: float
    avionics_w: float

    @classmethod
    def of(cls, vehicle: VehicleSpec) -> Self:
        """The model of a vehicle; what the scenario does not say is as usual for its mass."""
        mass = vehicle.mass_kg
        drag = DRAG_AREA_M2 * mass ** (2 / 3) if vehicle.drag_area_m2 is None else vehicle.drag_area_m2
        return cls(mass, vehicle.rotors or usual_rotors(mass), drag, vehicle.avionics_w)

    @property
    def hover_w(self) -> float:
        """Power from the battery (W) at hover."""
        return float(self.power_w(np.zeros(3), np.zeros(3)))

    def power_w(self, velocity_m_s: ArrayLike, acceleration_m_s2: ArrayLike) -> NDArray[np.float64]:
        """Power from the battery (W).

        Args:
            velocity_m_s: through still air, scene ENU, shape (..., 3).
            acceleration_m_s2: shape (..., 3).

        Returns:
            Shape (...).
        """
        v, a = np.asarray(velocity_m_s, dtype=np.float64), np.asarray(acceleration_m_s2, dtype=np.float64)
        speed = np.linalg.norm(v, axis=-1)
        drag = 0.5 * AIR_DENSITY_KG_M3 * self.drag_area_m2 * speed[..., None] * v
        force = self.mass_kg * (a + np.array([0.0, 0.0, GRAVITY_M_S2])) + drag
        thrust = np.maximum(np.linalg.norm(force, axis=-1), 1e-9)
        useful = np.einsum("...i,...i->...", force, v)
        along = useful / thrust
        across = np.sqrt(np.maximum(speed**2 - along**2, 0.0))
        area = self.rotors.disc_area_m2
        hover_speed = np.sqrt(thrust / (2 * AIR_DENSITY_KG_M3 * area))
        induced = thrust * hover_speed * induced_velocity(along / hover_speed, across / hover_speed)
        tip_speed = np.sqrt(thrust / (self.rotors.thrust_coefficient * AIR_DENSITY_KG_M3 * area))
        profile = (1 / self.rotors.figure_of_merit - INDUCED_POWER_FACTOR) * thrust * hover_speed
        profile = profile * (1 + _PROFILE_GROWTH * (across / tip_speed) ** 2)
        at_shaft = np.maximum(useful + INDUCED_POWER_FACTOR * induced + profile, 0.0)
        return np.asarray(at_shaft / self.rotors.motor_efficiency + self.avionics_w)


def induced_velocity(along: ArrayLike, across: ArrayLike) -> NDArray[np.float64]:
    """Induced velocity over that at hover.

    Args:
        along: speed along the rotors' axis over the induced velocity at hover, positive upward, shape (...).
        across: speed square to it, likewise, shape (...), not negative.

    Returns:
        Shape (...), positive.
    """
    x, mu = np.broadcast_arrays(np.asarray(along, dtype=np.float64), np.asarray(across, dtype=np.float64))
    glauert = _glauert(x, mu)
    sinking = np.clip(x, -2.0, 0.0)
    measured = np.polynomial.polynomial.polyval(sinking, _VORTEX_RING)
    axial = -sinking / 2 + np.sqrt(sinking**2 / 4 + 1)
    return np.asarray(glauert + np.maximum(measured - axial, 0.0) * np.clip(1 - mu, 0.0, 1.0))


def _glauert(x: NDArray[np.float64], mu: NDArray[np.float64]) -> NDArray[np.float64]:
    """The largest positive root of `w sqrt(mu^2 + (x + w)^2) = 1`, by bisection.

    The left side grows with w, but for a dip where the rotor sinks faster than `sqrt(8) mu`; the root beyond the dip,
    if there is one, continues that of the climb.
    """
    dip = 9 * x**2 - 8 * (x**2 + mu**2)
    after_dip = np.where((x < 0) & (dip > 0), (3 * np.abs(x) + np.sqrt(np.maximum(dip, 0.0))) / 4, 0.0)
    low = np.where(after_dip * np.hypot(mu, x + after_dip) <= 1, after_dip, 0.0)
    high = 1 + np.maximum(-x, 0.0)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        above = middle * np.hypot(mu, x + middle) > 1
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.asarray((low + high) / 2)
