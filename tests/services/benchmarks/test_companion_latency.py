"""The latency benchmark, for a few seconds and without other work."""

from __future__ import annotations

import pytest

from gcs.services.benchmarks import companion_latency

pytestmark = pytest.mark.system


def test_every_scan_is_answered_and_a_bare_loop_stands_beside():
    rows = {row.figure: row.value for row in companion_latency.run(quick=True)}
    assert set(rows) == {"p50_ms", "p99_ms", "bare_p99_ms"}
    assert 0.0 < rows["p50_ms"] <= rows["p99_ms"]
    assert rows["bare_p99_ms"] > 0.0
