"""Rotors and motors of a multirotor, as far as its power depends on them."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from gcs.core.fields import Positive, Strict


class Rotors(Strict):
    """Lifting rotors of one vehicle. Of coaxial pairs each pair counts as one rotor: their discs lie in one stream.

    `figure_of_merit` is the ideal over the true shaft power at hover, `thrust_coefficient` is
    `T / (rho A (Omega R)^2)`, and `motor_efficiency` is shaft power over battery power, motors and their controllers
    together.
    """

    count: Annotated[int, Field(ge=1, le=64)] = 4
    radius_m: Positive
    figure_of_merit: Annotated[float, Field(ge=0.2, le=0.85)] = 0.6
    thrust_coefficient: Annotated[float, Field(ge=0.002, le=0.05)] = 0.012
    motor_efficiency: Annotated[float, Field(gt=0.2, lt=1)] = 0.83

    @property
    def disc_area_m2(self) -> float:
        """Area of all discs."""
        return self.count * math.pi * self.radius_m**2


DISC_LOADING_KG_M2 = 10.0
"""Mass per area of all rotor discs where the rotors are not known; common multirotors of 1 to 10 kg have 6 to 12."""


def usual_rotors(mass_kg: float) -> Rotors:
    """Four rotors as vehicles of this mass commonly have them."""
    return Rotors(radius_m=math.sqrt(mass_kg / DISC_LOADING_KG_M2 / (4 * math.pi)))
