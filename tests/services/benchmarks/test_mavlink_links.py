"""How the figures of paired uploads are made, and that uploads over a bad link are proved on fake time."""

from __future__ import annotations

import pytest

from gcs.services.benchmarks.lockstep_worlds import LockstepWorlds
from gcs.services.benchmarks.mavlink_links import Pair, _proved_in_time, _rows


def figures(pairs):
    return {row.figure: (row.value, row.reference_value) for row in _rows("link-5", pairs, 0.995)}


def test_medians_are_of_those_that_succeeded_and_the_ratio_of_pairs():
    pairs = [Pair(3.0, 0.1, 6.0), Pair(4.0, 0.2, None), Pair(None, None, 9.0), Pair(5.0, 0.3, 5.0), Pair(6.0, 0.9, 5.0)]
    rows = figures(pairs)
    assert rows["seconds"] == (pytest.approx(4.5), pytest.approx(5.5))
    assert rows["seconds_ratio"] == (pytest.approx(1.0), None)
    assert rows["proof_seconds"] == (pytest.approx(0.25), None)
    assert rows["success"][0] == 0.995
    assert rows["success"][1] in {0.8, None}  # where MAVSDK is not installed


def test_without_pairs_there_is_the_success_alone():
    assert figures([]) == {"success": (0.995, None)}


@pytest.mark.parametrize(("loss", "proved"), [(0.0, True), (0.3, True), (1.0, False)])
def test_uploads_on_fake_time(loss, proved):
    with LockstepWorlds() as worlds:
        assert list(worlds.run_all(_proved_in_time(loss, seed) for seed in range(3))) == [proved] * 3
