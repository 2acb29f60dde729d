"""Power against closed forms of momentum theory, its equations, and published flight times."""

import math

import numpy as np
import pytest

from gcs.core.rotors import Rotors, usual_rotors
from gcs.core.scenario import VehicleSpec
from gcs.planning.dynamics.rotor_power import GRAVITY_M_S2, RotorPower, induced_velocity

RHO = 1.225
ROTORS = Rotors(count=4, radius_m=0.2, figure_of_merit=0.65, thrust_coefficient=0.014, motor_efficiency=0.8)
STILL = np.zeros(3)


@pytest.fixture
def power():
    return RotorPower.of(VehicleSpec(mass_kg=3.0, rotors=ROTORS, drag_area_m2=0.05, avionics_w=12.0))


def test_hover_is_the_ideal_power_over_all_efficiencies(power):
    weight, area = 3 * GRAVITY_M_S2, 4 * math.pi * 0.2**2
    assert power.hover_w == pytest.approx(weight**1.5 / math.sqrt(2 * RHO * area) / 0.65 / 0.8 + 12)


def test_vehicles_without_rotor_data_have_usual_rotors():
    plain = RotorPower.of(VehicleSpec(mass_kg=3.0))
    assert usual_rotors(3.0).disc_area_m2 == pytest.approx(0.3)
    assert plain.hover_w == pytest.approx((3 * GRAVITY_M_S2) ** 1.5 / math.sqrt(2 * RHO * 0.3) / (0.6 * 0.83) + 10)


def test_induced_velocity_of_hover_climb_and_level_flight():
    x = np.linspace(0, 4, 40)
    np.testing.assert_allclose(induced_velocity(0.0, 0.0), 1.0)
    np.testing.assert_allclose(induced_velocity(x, 0.0), -x / 2 + np.sqrt(x**2 / 4 + 1), rtol=1e-9)
    np.testing.assert_allclose(induced_velocity(0.0, x), np.sqrt(-(x**2) / 2 + np.sqrt(x**4 / 4 + 1)), rtol=1e-9)


def test_glauerts_equation_holds_wherever_momentum_theory_does():
    rng = np.random.default_rng(4)
    x, mu = rng.uniform(-4, 6, 4000), rng.uniform(1.0, 6, 4000)
    w = induced_velocity(x, mu)
    np.testing.assert_allclose(w * np.hypot(mu, x + w), 1.0, rtol=1e-9)
    x, mu = rng.uniform(0, 6, 4000), rng.uniform(0.0, 6, 4000)
    w = induced_velocity(x, mu)
    np.testing.assert_allclose(w * np.hypot(mu, x + w), 1.0, rtol=1e-9)


def test_a_steep_descent_takes_what_was_measured():
    """At half the induced velocity straight down the measured one is 1.39 times hover's, at once 1.82 times."""
    assert induced_velocity(-0.5, 0.0) == pytest.approx(1 + 0.5625 - 0.343 + 0.21475 - 0.0409375)
    assert induced_velocity(-1.0, 0.0) == pytest.approx(1 + 1.125 - 1.372 + 1.718 - 0.655)
    assert induced_velocity(-1.0, 0.5) < induced_velocity(-1.0, 0.0)


def test_induced_velocity_has_no_jumps_at_the_speeds_of_multirotors():
    """Much faster straight down the equation itself has one: the wake turns over."""
    x, mu = np.linspace(-1.3, 2, 661), np.linspace(0, 3, 601)
    table = induced_velocity(x[:, None], mu[None])
    assert np.abs(np.diff(table, axis=0)).max() < 0.05
    assert np.abs(np.diff(table, axis=1)).max() < 0.05


def test_climbing_takes_the_lift_more_but_less_induced_power(power):
    weight, area, climb = 3 * GRAVITY_M_S2, 4 * math.pi * 0.2**2, 2.0
    thrust = weight + 0.5 * RHO * 0.05 * climb**2
    v_h = math.sqrt(thrust / (2 * RHO * area))
    w = -climb / 2 + math.sqrt(climb**2 / 4 + v_h**2)
    shaft = thrust * climb + 1.15 * thrust * w + (1 / 0.65 - 1.15) * thrust * v_h
    assert power.power_w([0, 0, climb], STILL) == pytest.approx(shaft / 0.8 + 12)


def test_level_flight_pays_drag_profile_and_less_induced_power(power):
    """Slow flight is cheaper than hover, fast flight dearer: the power has its valley."""
    speeds = np.linspace(0, 25, 26)
    level = np.stack([speeds, 0 * speeds, 0 * speeds], axis=1)
    watts = power.power_w(level, STILL)
    best = int(watts.argmin())
    assert 3 < speeds[best] < 18
    assert (np.diff(watts[: best + 1]) < 0).all()
    assert (np.diff(watts[best:]) > 0).all()
    np.testing.assert_allclose(power.power_w(level[:, [1, 0, 2]], STILL), watts)


def test_sinking_never_pays(power):
    sink = np.array([[0, 0, -s] for s in (0.5, 1.0, 2.0, 3.0, 6.0, 12.0)])
    watts = power.power_w(sink, STILL)
    assert (watts > 12).all()
    assert watts[:3] == pytest.approx(power.hover_w, rel=0.05)
    up_and_down = power.power_w([0, 0, 3.0], STILL) + power.power_w([0, 0, -3.0], STILL)
    assert up_and_down > 2 * power.hover_w


def test_accelerating_takes_the_kinetic_energy_too(power):
    v, a = np.array([5.0, 0, 0]), np.array([2.0, 0, 0])
    assert power.power_w(v, a) - power.power_w(v, STILL) > 3 * 2.0 * 5.0


@pytest.mark.parametrize(
    ("mass", "radius", "hours", "capacity"),
    [(6.3, 0.2667, 55 / 60, 548.0), (1.388, 0.1194, 30 / 60, 89.2)],
    ids=["matrice-300", "phantom-4-pro"],
)
def test_published_flight_times(mass, radius, hours, capacity):
    """Two vehicles whose makers tell mass, rotors, battery and time in the air: within 15 %."""
    model = RotorPower.of(VehicleSpec(mass_kg=mass, rotors=Rotors(radius_m=radius)))
    assert model.hover_w == pytest.approx(capacity / hours, rel=0.15)
