"""OMPL's planners beside ours: left out where they are not installed, held against the closed form where they are."""

import math

import pytest

from gcs.services.benchmarks import local_references
from gcs.services.benchmarks.local_references import REFERENCES, reference_runs

QUERY = ((1.0, 5.0), (9.0, 5.0), ((4.0, 3.0), (6.0, 7.0)), 10.0)
SHORTEST_M = 2.0 + 2 * math.hypot(3.0, 2.0)


def test_what_is_not_installed_is_left_out(monkeypatch):
    monkeypatch.setattr(local_references, "find_spec", lambda name: None)
    assert reference_runs("BITstar", *QUERY, 1.05 * SHORTEST_M, 1) is None


@pytest.mark.parametrize("name", REFERENCES)
def test_what_is_installed_finds_a_way_that_is_short_enough(name):
    pytest.importorskip("ompl")
    for run in reference_runs(name, *QUERY, 1.05 * SHORTEST_M, 2):
        assert SHORTEST_M - 1e-6 <= run.length_m <= 1.05 * SHORTEST_M
        assert run.seconds < local_references.LONGEST_S


def test_what_is_cut_off_before_it_is_short_enough_never_was(monkeypatch):
    pytest.importorskip("ompl")
    monkeypatch.setattr(local_references, "LONGEST_S", 0.05)
    (run,) = reference_runs("RRTstar", *QUERY, 0.9 * SHORTEST_M, 1)
    assert math.isinf(run.seconds)
