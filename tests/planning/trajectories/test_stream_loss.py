"""Safety rule 6 by brute force: at every instant of the warped flight, fly on, brake, and look how near it came."""

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError, OperationCancelled
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.trajectories.stream_loss import SLOWEST_M_S, TOUCHDOWN_M_S, StreamLoss, slow_for_stream_loss

REST_TO_REST = np.array([0, 0, 0, 0, 35, -84, 70, -20.0])
KEEP_M = 0.9


class Wall:
    """Everything with x above a value is solid."""

    ground_m = None

    def __init__(self, x):
        self.x = x

    def distance(self, points, *, ground=True, limit=np.inf):
        return self.x - np.asarray(points)[:, 0]


def straight(start, end, duration):
    coefficients = REST_TO_REST[:, None] * (np.array(end, float) - start)
    coefficients[0] += start
    return PiecewisePolynomial(coefficients[None], np.array([duration]))


def worst_after_loss(trajectory, warp, distance, timeout, deceleration, home, every=0.02):
    """Least distance from surfaces, and from the ground outside the column over home, over all that could be swept;
    and the speed with which the ground is touched in that column."""
    t = np.arange(0, warp.duration_s, every)
    p, v, _ = warp.setpoint(trajectory, t)
    speed = np.linalg.norm(v, axis=1)
    length = speed * timeout + speed**2 / (2 * deceleration)
    share = np.linspace(0, 1, 60)[:, None, None]
    points = p + share * (v / np.maximum(speed, 1e-9)[:, None] * length[:, None])
    flat = points.reshape(-1, 3)
    nearest = distance.distance(flat, ground=False).min()
    in_column = np.linalg.norm(flat[:, :2] - home[:2], axis=1) <= 0.5
    if distance.ground_m is not None:
        nearest = min(nearest, (flat[~in_column, 2] - distance.ground_m).min())
    into_ground = (points[-1, :, 2] < home[2] - 1e-6) & in_column.reshape(len(share), -1)[-1]
    return nearest, speed[into_ground].max(initial=0.0)


@pytest.mark.parametrize(("timeout", "deceleration"), [(1.0, 2.5), (3.0, 1.5)])
def test_flying_at_a_wall_is_slowed_just_enough(timeout, deceleration):
    trajectory = straight([0, 0, 20], [30, 0, 20], 14.0)
    wall, home = Wall(31.5), np.array([-50.0, 0, 0])
    warp = slow_for_stream_loss(
        trajectory,
        wall,
        timeout_s=timeout,
        deceleration_m_s2=deceleration,
        acceleration_m_s2=2.5,
        keep_m=KEEP_M,
        home_m=home,
    )
    before, _ = worst_after_loss(trajectory, Unwarped(trajectory), wall, timeout, deceleration, home)
    after, _ = worst_after_loss(trajectory, warp, wall, timeout, deceleration, home)
    assert before < KEEP_M
    assert KEEP_M <= after < KEEP_M + 0.5
    t = np.linspace(0, warp.duration_s, 20_001)
    assert np.linalg.norm(warp.setpoint(trajectory, t).acceleration_m_s2, axis=1).max() <= 2.5
    assert float(warp.rate(1.0)) == pytest.approx(1.0, abs=0.02)


class Unwarped:
    def __init__(self, trajectory):
        self.trajectory, self.duration_s = trajectory, trajectory.duration_s

    def setpoint(self, trajectory, t):
        return tuple(trajectory.value(t, k) for k in range(3))


@pytest.mark.parametrize("timeout", [1.0, 3.0])
def test_the_whole_tower_flight_survives_a_loss_at_every_instant(tower_flight, tower_scenario, tower_distance, timeout):
    trajectory, home = tower_flight.built.trajectory, np.array(tower_scenario.home_m)
    warp = slow_for_stream_loss(
        trajectory,
        tower_distance,
        timeout_s=timeout,
        deceleration_m_s2=2.0,
        acceleration_m_s2=2.5,
        keep_m=KEEP_M,
        home_m=home,
    )
    nearest, touchdown = worst_after_loss(trajectory, warp, tower_distance, timeout, 2.0, home)
    assert nearest >= KEEP_M
    assert touchdown <= TOUCHDOWN_M_S + 1e-6
    assert trajectory.duration_s <= warp.duration_s < 2 * trajectory.duration_s
    t = np.linspace(0, warp.duration_s, 40_001)
    assert np.linalg.norm(warp.setpoint(trajectory, t).acceleration_m_s2, axis=1).max() <= 2.5


def test_the_unslowed_tower_flight_would_not(tower_flight, tower_scenario, tower_distance):
    trajectory, home = tower_flight.built.trajectory, np.array(tower_scenario.home_m)
    _, touchdown = worst_after_loss(trajectory, Unwarped(trajectory), tower_distance, 3.0, 2.0, home)
    assert touchdown > 1.0


def test_a_flight_in_the_open_is_not_touched():
    trajectory = straight([0, 0, 50], [10, 0, 50], 8.0)
    warp = slow_for_stream_loss(
        trajectory,
        Wall(1000.0),
        timeout_s=3.0,
        deceleration_m_s2=2.0,
        acceleration_m_s2=2.5,
        keep_m=KEEP_M,
        home_m=(0, 0, 0),
    )
    assert warp.duration_s == pytest.approx(8.0)


def test_a_flight_that_would_have_to_stand_still_is_refused_with_the_place():
    trajectory = straight([0, 0, 50], [20, 0, 50], 12.0)
    with pytest.raises(InfeasibleError, match=rf"slower than {SLOWEST_M_S} m/s there.*mission"):
        slow_for_stream_loss(
            trajectory,
            Wall(19.0),
            timeout_s=1.0,
            deceleration_m_s2=2.0,
            acceleration_m_s2=2.5,
            keep_m=KEEP_M,
            home_m=(0, 0, 0),
        )


def test_low_flight_away_from_home_keeps_off_the_ground():
    """Sinking on a slope towards a low point away from home: the ground is an obstacle there."""

    class Ground(Wall):
        ground_m = 0.0

    trajectory = straight([0, 0, 30], [5, 0, 3], 9.5)
    home = np.array([-50.0, 0, 0])
    scene = Ground(1000.0)
    warp = slow_for_stream_loss(
        trajectory, scene, timeout_s=2.0, deceleration_m_s2=2.0, acceleration_m_s2=2.5, keep_m=KEEP_M, home_m=home
    )
    assert worst_after_loss(trajectory, Unwarped(trajectory), scene, 2.0, 2.0, home)[0] < 0
    assert worst_after_loss(trajectory, warp, scene, 2.0, 2.0, home)[0] >= KEEP_M


def test_swept_length_and_speed_are_inverse():
    loss = StreamLoss(3.0, 1.5)
    speeds = np.linspace(0, 8, 30)
    np.testing.assert_allclose(loss.speed_for(loss.swept_m(speeds)), speeds, atol=1e-9)
    assert loss.swept_m(np.array(3.0)) == pytest.approx(9 + 3)
    assert loss.speed_for(np.array([-1.0])) == 0.0


def test_it_stops_when_told():
    class Stop:
        def report(self, stage, fraction):
            raise OperationCancelled("stop")

    with pytest.raises(OperationCancelled):
        slow_for_stream_loss(
            straight([0, 0, 50], [20, 0, 50], 12.0),
            Wall(30.0),
            timeout_s=1.0,
            deceleration_m_s2=2.0,
            acceleration_m_s2=2.5,
            keep_m=KEEP_M,
            home_m=(0, 0, 0),
            progress=Stop(),
        )
