"""Cameras that do not roll: directions, upward directions and angles belong together."""

import numpy as np
import pytest

from gcs.planning.views.viewpoint_pose import camera_angles, camera_axes, pose_towards


def test_axes_are_square_the_image_is_level_and_its_top_is_up():
    rng = np.random.default_rng(0)
    yaw, pitch = rng.uniform(-np.pi, np.pi, 200), rng.uniform(-np.pi / 2, np.pi / 2, 200)
    direction, up = camera_axes(yaw, pitch)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1)
    np.testing.assert_allclose(np.linalg.norm(up, axis=1), 1)
    np.testing.assert_allclose((direction * up).sum(axis=1), 0, atol=1e-12)
    assert (up[:, 2] >= 0).all()
    np.testing.assert_allclose(np.cross(direction, up)[:, 2], 0, atol=1e-12)


def test_angles_and_directions_are_inverse():
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(100, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    back, _ = camera_axes(*camera_angles(direction))
    np.testing.assert_allclose(back, direction, atol=1e-12)


@pytest.mark.parametrize(
    ("yaw", "pitch", "direction", "up"),
    [
        (0, 0, (1, 0, 0), (0, 0, 1)),
        (np.pi / 2, 0, (0, 1, 0), (0, 0, 1)),
        (np.pi / 2, -np.pi / 2, (0, 0, -1), (0, 1, 0)),
        (0, np.pi / 2, (0, 0, 1), (-1, 0, 0)),
        (np.pi, -np.pi / 4, (-np.sqrt(0.5), 0, -np.sqrt(0.5)), (-np.sqrt(0.5), 0, np.sqrt(0.5))),
    ],
)
def test_known_attitudes(yaw, pitch, direction, up):
    got = camera_axes(yaw, pitch)
    np.testing.assert_allclose(got[0], direction, atol=1e-12)
    np.testing.assert_allclose(got[1], up, atol=1e-12)


def test_a_pose_keeps_its_angles_and_direction_together():
    pose = pose_towards("A", (1, 2, 3), (3, 4, -5), 0.001)
    np.testing.assert_allclose(pose.direction, np.array([3, 4, -5]) / np.sqrt(50))
    assert pose.yaw_rad == pytest.approx(np.arctan2(4, 3))
    assert pose.gimbal_pitch_rad == pytest.approx(np.arcsin(-5 / np.sqrt(50)))


def test_straight_down_has_a_defined_top():
    pose = pose_towards("A", (0, 0, 9), (0, 0, -2), 0.001)
    assert pose.yaw_rad == 0
    np.testing.assert_allclose(pose.up, [1, 0, 0], atol=1e-12)
