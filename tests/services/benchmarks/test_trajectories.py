"""The quick version of the benchmark runs and shows what it should."""

from gcs.services.benchmarks.trajectories import run


def test_quick_rows_stay_in_the_corridor_at_the_references_cost():
    rows = {(row.case, row.figure): row for row in run(True)}
    assert rows["corridor-50", "violation_m"].value == 0.0
    assert abs(rows["corridor-50", "cost_error"].value) < 1e-3
    assert rows["corridor-50", "ms"].value > 0
    assert rows["corridor-50", "ms"].reference == "Clarabel"
    for case in ("free-10", "free-100"):
        assert rows[case, "ms"].value > 0
        assert rows[case, "with_gradient_ms"].value > 0
        assert rows[case, "cost_error"].value < 1e-9
    assert rows["free-100", "ms"].reference == "minsnap-trajectories"
    assert rows["free-10", "ms"].reference == "spline-trajectory"
