"""Cutting curves in time and joining them."""

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.local.curve_parts import joined_curves, part_of_curve


@pytest.fixture
def curve():
    rng = np.random.default_rng(0)
    return PiecewisePolynomial(rng.normal(size=(6, 8, 3)), rng.uniform(0.3, 3.0, 6))


def test_a_part_has_the_curves_values_and_derivatives(curve):
    part = part_of_curve(curve, 0.7, 5.3, cuts_s=(1.0, 2.5))
    assert part.duration_s == pytest.approx(4.6)
    inner = np.setdiff1d(np.linspace(0.01, 4.59, 200), part.starts_s)
    for order in range(4):
        assert np.allclose(part.value(inner, order), curve.value(0.7 + inner, order), rtol=1e-9, atol=1e-7)
    borders = 0.7 + part.starts_s
    for wanted in (1.0, 2.5):
        assert np.abs(borders - wanted).min() < 1e-12


def test_the_parts_joined_are_the_curve(curve):
    whole = joined_curves(
        part_of_curve(curve, 0.0, 1.1), part_of_curve(curve, 1.1, 4.0), part_of_curve(curve, 4.0, curve.duration_s)
    )
    times = np.linspace(0.01, curve.duration_s - 0.01, 300)
    assert np.allclose(whole.value(times), curve.value(times))


def test_no_piece_is_without_length_at_a_border(curve):
    border = float(curve.starts_s[2])
    part = part_of_curve(curve, border, border + 1e-10 + 1.0, cuts_s=(border + 1e-10,))
    assert part.durations_s.min() > 1e-3


@pytest.mark.parametrize(("begin", "end"), [(-0.1, 1.0), (1.0, 1.0), (2.0, 1.0), (0.0, 1e3), (float("nan"), 1.0)])
def test_what_is_no_part_is_refused(curve, begin, end):
    with pytest.raises(InputError, match="no part"):
        part_of_curve(curve, begin, end)
