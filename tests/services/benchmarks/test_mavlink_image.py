"""Case `image-5` in its small version: fake time, so that the figures are the same on every machine."""

from gcs.services.benchmarks.mavlink_image import CASE, run


def test_losses_cost_less_than_half_of_the_rate():
    rows = {row.figure: row for row in run(quick=True)}
    assert {row.case for row in rows.values()} == {CASE}
    assert set(rows) == {"seconds", "rate_ratio"}
    assert 0.5 <= rows["rate_ratio"].value < 1.0
    assert rows["seconds"].reference_value < rows["seconds"].value
