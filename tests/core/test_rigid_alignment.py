"""The fit of surveyed points against transforms that are known, another library's fit, and drawn errors."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gcs.core.rigid_alignment import are_on_one_line, fit_alignment

PLACES = np.array([[0, 0, 0], [30, 2, 0], [4, 12, 1], [10, 6, 25], [22, 9, 18.0]])


@pytest.mark.parametrize("count", [3, 4, 5])
@pytest.mark.parametrize("with_scale", [False, True])
def test_a_known_transform_is_found_exactly(count, with_scale):
    rng = np.random.default_rng(count)
    for _ in range(20):
        turn = Rotation.random(random_state=rng).as_matrix()
        scale = rng.uniform(0.01, 100) if with_scale else 1.0
        shift = np.array([-500000.0, -4649776.0, 30.0])
        fit = fit_alignment(PLACES[:count], scale * PLACES[:count] @ turn.T + shift, with_scale=with_scale)
        np.testing.assert_allclose(fit.rotation, turn, atol=1e-9)
        assert fit.scale == pytest.approx(scale, rel=1e-9)
        assert fit.worst_m < 1e-8
        np.testing.assert_allclose(fit.apply([[7, 8, 9]]), [scale * turn @ [7, 8, 9] + shift], atol=1e-7)
        assert np.linalg.det(fit.rotation) == pytest.approx(1)


def test_map_coordinates_lose_nothing():
    turn = Rotation.from_euler("xyz", [3, -2, 40], degrees=True).as_matrix()
    origin = np.array([500000.0, 4649776.0, 100.0])
    fit = fit_alignment(PLACES + origin, PLACES @ turn.T)
    np.testing.assert_allclose(fit.apply(PLACES + origin), PLACES @ turn.T, atol=1e-8)


def test_a_noisy_fit_is_that_of_another_library():
    rng = np.random.default_rng(5)
    for _ in range(20):
        turn = Rotation.random(random_state=rng).as_matrix()
        world = PLACES @ turn.T + rng.normal(0, 0.5, PLACES.shape)
        fit = fit_alignment(PLACES, world)
        other, root_sum = Rotation.align_vectors(world - world.mean(axis=0), PLACES - PLACES.mean(axis=0))
        np.testing.assert_allclose(fit.rotation, other.as_matrix(), atol=1e-8)
        assert fit.rms_m == pytest.approx(root_sum / np.sqrt(len(PLACES)))
        assert fit.worst_m == pytest.approx(np.linalg.norm(fit.apply(PLACES) - world, axis=1).max())


def test_a_scale_fit_beats_all_near_it():
    rng = np.random.default_rng(6)
    world = 3 * PLACES + rng.normal(0, 0.5, PLACES.shape)
    fit = fit_alignment(PLACES, world, with_scale=True)
    for factor in (0.99, 1.01):
        other = fit_alignment(PLACES * fit.scale * factor, world)
        assert other.rms_m > fit.rms_m


def test_a_mirror_image_is_fitted_only_when_asked():
    world = PLACES * [1, 1, -1]
    assert fit_alignment(PLACES, world).worst_m > 5
    mirrored = fit_alignment(PLACES, world, may_mirror=True)
    assert mirrored.worst_m < 1e-9
    assert np.linalg.det(mirrored.rotation) == pytest.approx(-1)


@pytest.mark.parametrize("with_scale", [False, True])
def test_the_expected_error_is_that_of_drawn_errors(with_scale):
    rng = np.random.default_rng(7)
    places = np.array([[60.0, 5, 40], [0, 0, 0], PLACES.mean(axis=0)])
    error, expected = np.zeros(3), np.zeros(3)
    draws = 1500
    for _ in range(draws):
        fit = fit_alignment(PLACES, PLACES + rng.normal(0, 0.02, PLACES.shape), with_scale=with_scale)
        error += ((fit.apply(places) - places) ** 2).sum(axis=1)
        expected += fit.expected_error_m(places) ** 2
    np.testing.assert_allclose(np.sqrt(expected / draws), np.sqrt(error / draws), rtol=0.07)
    assert error[0] > 4 * error[2]


def test_lines_are_told():
    line = np.outer(np.arange(4), [1, 2, 3.0])
    assert are_on_one_line(line)
    assert are_on_one_line(line + np.random.default_rng(0).normal(0, 0.02, line.shape))
    assert are_on_one_line(np.ones((3, 3)))
    assert not are_on_one_line(PLACES[:3])
