"""Timeouts that follow what was measured."""

from __future__ import annotations

import pytest

from gcs.mavlink.round_trip import GROWTH, RoundTrip


def test_before_anything_is_measured_the_first_timeout_counts_and_grows_to_the_longest():
    trip = RoundTrip(0.25, 1.5, 0.06)
    assert not trip.known
    assert trip.timeout_s() == 0.25
    assert trip.timeout_s(2) == pytest.approx(0.25 * GROWTH**2)
    assert trip.timeout_s(10_000) == 1.5
    assert trip.timeout_s(10_000, patience=2.0) == 3.0


@pytest.mark.parametrize(("trip_s", "least", "most"), [(0.01, 0.06, 0.06), (0.05, 0.07, 0.08), (0.8, 0.82, 0.9)])
def test_a_steady_round_trip_is_waited_for_a_little_longer_than_it_takes(trip_s, least, most):
    trip = RoundTrip(0.25, 1.5, 0.06)
    for _ in range(30):
        trip.measured(trip_s)
    assert trip.known
    assert least <= trip.timeout_s() <= most


def test_an_unsteady_one_is_waited_for_much_longer():
    trip = RoundTrip(0.25, 5.0, 0.06)
    for k in range(30):
        trip.measured(0.1 if k % 2 else 0.5)
    assert trip.timeout_s() > 0.8


def test_without_a_shortest_timeout_the_first_one_is_it():
    trip = RoundTrip(0.25, 1.5)
    for _ in range(30):
        trip.measured(0.01)
    assert trip.timeout_s() == 0.25
