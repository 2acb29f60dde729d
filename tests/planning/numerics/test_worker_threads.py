"""Work in threads: results in order, errors handed over, and an end when it is asked for."""

import threading

import pytest

from gcs.planning.numerics.worker_threads import in_threads, workers


def test_results_come_in_the_order_of_the_items():
    assert in_threads(lambda n: n * n, range(100)) == [n * n for n in range(100)]
    assert in_threads(lambda n: n, []) == []
    assert workers() >= 1


def test_the_share_that_is_done_is_told():
    told = []
    in_threads(lambda n: n, range(50), told.append)
    assert told[-1] == 1.0
    assert told == sorted(told)


def test_an_error_in_the_work_comes_out():
    def work(n):
        if n == 7:
            raise ValueError("seven")

    with pytest.raises(ValueError, match="seven"):
        in_threads(work, range(20))


def test_what_has_not_begun_is_left_when_it_is_stopped():
    begun, go_on = [], threading.Event()

    def work(n):
        begun.append(n)
        go_on.wait(10)

    def stop(share):
        go_on.set()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        in_threads(work, range(10000), stop)
    assert len(begun) < 10000
