import numpy as np
import pytest

from gcs.core.errors import InfeasibleError
from gcs.core.scenario import Battery, VehicleSpec
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.dynamics.energy import energy_wh, require_battery
from gcs.planning.dynamics.rotor_power import RotorPower

VEHICLE = VehicleSpec(mass_kg=3.0)


def straight(velocity, seconds):
    coefficients = np.zeros((1, 8, 3))
    coefficients[0, 1] = np.asarray(velocity) * seconds
    return PiecewisePolynomial(coefficients, np.array([seconds]))


def power_w(velocity, acceleration=(0, 0, 0)):
    return RotorPower.of(VEHICLE).power_w(velocity, acceleration)


def test_energy_of_a_hover_and_of_a_steady_flight():
    assert energy_wh(straight((0, 0, 0), 3600.0), VEHICLE) == pytest.approx(RotorPower.of(VEHICLE).hover_w)
    expected = float(power_w([3, 0, 1])) * 90 / 3600
    assert energy_wh(straight((3, 0, 1), 90.0), VEHICLE) == pytest.approx(expected)


def test_energy_follows_a_changing_power():
    rise = np.zeros((1, 8, 3))
    rise[0, 4:, 2] = np.array([35, -84, 70, -20]) * 20.0
    curve = PiecewisePolynomial(rise, np.array([12.0]))
    t = np.linspace(0, 12, 200_001)
    fine = np.trapezoid(power_w(curve.value(t, 1), curve.value(t, 2)), t) / 3600
    assert energy_wh(curve, VEHICLE) == pytest.approx(fine, rel=1e-4)


def test_energy_of_a_part_of_the_time():
    curve = straight((3, 0, 1), 90.0)
    parts = energy_wh(curve, VEHICLE, 0.0, 30.0) + energy_wh(curve, VEHICLE, 30.0)
    assert parts == pytest.approx(energy_wh(curve, VEHICLE))


def test_the_reserve_is_kept():
    battery = Battery(capacity_wh=130, reserve=0.25)
    require_battery(97.4, battery)
    with pytest.raises(InfeasibleError, match=r"needs 97\.6 Wh.*130 Wh.*25%.*97\.5 Wh") as caught:
        require_battery(97.6, battery)
    assert caught.value.field == "vehicle.battery"


def test_without_a_battery_nothing_is_refused():
    require_battery(1e6, None)
