import math

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError
from gcs.core.scenario import Battery
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.energy import energy_wh, flight_power_w, hover_power_w, require_battery


def straight(velocity, seconds):
    coefficients = np.zeros((1, 8, 3))
    coefficients[0, 1] = np.asarray(velocity) * seconds
    return PiecewisePolynomial(coefficients, np.array([seconds]))


def test_hovering_is_momentum_theory_over_the_efficiency():
    # 3 kg on 0.3 m² of rotor discs, half of the power lost, and 10 W for the electronics
    weight = 3 * 9.80665
    assert hover_power_w(3.0) == pytest.approx(weight**1.5 / math.sqrt(2 * 1.225 * 0.3) / 0.5 + 10)


@pytest.mark.parametrize(("mass", "low", "high"), [(0.9, 100, 150), (3.0, 350, 450), (6.3, 598, 850)])
def test_hover_power_is_that_of_real_multirotors_or_somewhat_above(mass, low, high):
    assert low <= hover_power_w(mass) <= high


def test_climbing_costs_the_lift_and_sinking_gives_nothing_back():
    still = hover_power_w(3.0)
    climb = flight_power_w([0, 0, 2.0], [0, 0, 0], 3.0)
    assert climb - still >= 3 * 9.80665 * 2 / 0.5
    assert flight_power_w([0, 0, -1.0], [0, 0, 0], 3.0) == pytest.approx(still, rel=0.01)


def test_speed_and_acceleration_cost_more():
    powers = flight_power_w([[0, 0, 0], [5, 0, 0], [10, 0, 0]], np.zeros((3, 3)), 3.0)
    assert (np.diff(powers) > 0).all()
    assert flight_power_w([0, 0, 0], [2.5, 0, 0], 3.0) > powers[0]


def test_energy_of_a_hover_and_of_a_steady_flight():
    assert energy_wh(straight((0, 0, 0), 3600.0), 3.0) == pytest.approx(hover_power_w(3.0))
    expected = float(flight_power_w([3, 0, 1], [0, 0, 0], 3.0)) * 90 / 3600
    assert energy_wh(straight((3, 0, 1), 90.0), 3.0) == pytest.approx(expected)


def test_energy_follows_a_changing_power():
    rise = np.zeros((1, 8, 3))
    rise[0, 4:, 2] = np.array([35, -84, 70, -20]) * 20.0
    curve = PiecewisePolynomial(rise, np.array([12.0]))
    t = np.linspace(0, 12, 200_001)
    fine = np.trapezoid(flight_power_w(curve.value(t, 1), curve.value(t, 2), 3.0), t) / 3600
    assert energy_wh(curve, 3.0) == pytest.approx(fine, rel=1e-4)


def test_the_reserve_is_kept():
    battery = Battery(capacity_wh=130, reserve=0.25)
    require_battery(97.4, battery)
    with pytest.raises(InfeasibleError, match=r"needs 97\.6 Wh.*130 Wh.*25%.*97\.5 Wh") as caught:
        require_battery(97.6, battery)
    assert caught.value.field == "vehicle.battery"


def test_without_a_battery_nothing_is_refused():
    require_battery(1e6, None)
