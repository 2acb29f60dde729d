"""The bound beside other work: handed over, left alone, and its faults raised where it is asked for."""

import threading

import numpy as np
import pytest

from gcs.core.progress import SilentProgress
from gcs.planning.views import bound_beside as module
from gcs.planning.views.bound_beside import bound_beside
from gcs.planning.views.cover_bound import CoverBound
from gcs.planning.views.cover_problem import CoverProblem

PAIR = CoverProblem(
    np.array([0, 2, 4]), np.array([0, 1, 2, 3], dtype=np.int32), 4, np.zeros(4, dtype=bool), 4, np.array([0, 1])
)


def test_the_bound_of_two_sets_that_share_nothing():
    with bound_beside(PAIR, SilentProgress()) as bound:
        assert bound().views == pytest.approx(2.0)


def test_no_cover_no_bound():
    with bound_beside(None, SilentProgress()) as bound:
        assert bound() is None


def test_a_fault_is_raised_where_the_bound_is_asked_for(monkeypatch):
    def fail(problem, limit, poll):
        raise RuntimeError("no bound")

    monkeypatch.setattr(module, "cover_bound", fail)
    with bound_beside(PAIR, SilentProgress()) as bound, pytest.raises(RuntimeError, match="no bound"):
        bound()


def test_work_that_fails_does_not_wait_for_the_bound_and_stops_it(monkeypatch):
    stopped = threading.Event()

    def endless(problem, limit, poll):
        try:
            while True:
                poll()
                threading.Event().wait(0.001)
        finally:
            stopped.set()
        return CoverBound(0.0, 0.0, True, 0.0)

    monkeypatch.setattr(module, "cover_bound", endless)
    with pytest.raises(ValueError, match="tour"), bound_beside(PAIR, SilentProgress()):
        raise ValueError("tour")
    assert stopped.wait(10.0)
