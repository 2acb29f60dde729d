"""Flights under a crane's beam, both kinds: within the corridor by another vehicle's sightings, out of it without."""

import numpy as np
import pytest

from gcs.services.benchmarks.cooperative_flight import HIDDEN_M, STOPS_M, beam_plan, flights_under_beam
from gcs.services.benchmarks.local_cooperative import GEOMETRIES, error_over_bound

KINDS = ("px4", "ardupilot")


@pytest.mark.parametrize(("place", "deviations"), GEOMETRIES)
def test_sighted_positions_err_at_most_twice_the_bound(place, deviations):
    assert 0.8 < error_over_bound(np.array(place), deviations, 400) < 2.0


def test_the_plan_leads_under_the_beam():
    low, high = np.array(HIDDEN_M)
    under = [bool(np.all((low < stop) & (stop < high))) for stop in np.array(STOPS_M)]
    assert under == [False, True, True, True, False]


def test_with_an_observer_it_stays_in_the_corridor_and_without_it_leaves_it():
    trajectory, anchor, half_width_m = beam_plan()
    cases = [(kind, 7, sighted) for kind in KINDS for sighted in (True, False)]
    flown = dict(zip(cases, flights_under_beam(cases, (trajectory, anchor)), strict=True))
    for kind in KINDS:
        seen, alone = flown[kind, 7, True], flown[kind, 7, False]
        assert seen.cross_track_m < half_width_m
        assert seen.estimate_m < half_width_m
        assert seen.mode in {"OFFBOARD", "GUIDED"}
        assert seen.told > 5 * 15.0  # at least five a second for as long as it is under the beam
        assert len(seen.said) == 2
        assert alone.cross_track_m > half_width_m
        assert alone.told == 0
