"""The simulated lidar and its odometry, as a companion hears them; and the truth about encounters."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl_mocks.lidar import LidarOptions
from sitl_mocks.obstacles import Obstacle

HOME = (-20.0, -20.0)
FREE, REACH = 3001, 3000


def beside(east, north, radius=1.0, base=-1.0, height=20.0):
    """An obstacle in metres from home."""
    return Obstacle("it", ((HOME[0] + east, HOME[1] + north),), radius, base, height)


@pytest.fixture
def scans_of(make_ground):
    """What a companion hears in a second with some obstacles; the vehicle faces north."""

    def scans(*obstacles, state="clear", **options):
        ground = make_ground("px4", obstacles=obstacles, lidar=LidarOptions(noise_m=0.0, **options))
        ground.channel.leads_to_companion = True
        ground.vehicle.lidar.state = state
        heard = ground.run(1.0)
        return ground.of("OBSTACLE_DISTANCE", heard), ground.of("OBSTACLE_DISTANCE_3D", heard), ground

    return scans


def test_a_circle_is_seen_where_it_is_ten_times_a_second(scans_of):
    scans, points, _ = scans_of(beside(6.0, 0.0))
    assert 9 <= len(scans) <= 11 and not points
    scan = scans[-1]
    assert (scan.frame, scan.increment_f, scan.angle_offset, scan.max_distance) == (12, 5.0, 0.0, REACH)
    half = math.asin(1.0 / 6.0)
    for sector, told in enumerate(scan.distances):
        off = abs((math.radians(5.0 * sector) - math.pi / 2 + math.pi) % (2 * math.pi) - math.pi)
        edge = max(off - math.radians(2.5), 0.0)
        if edge < half - 0.01:
            least = 6.0 * math.cos(edge) - math.sqrt(1.0 - (6.0 * math.sin(edge)) ** 2)
            assert told == pytest.approx(100 * least, abs=6), sector
        elif edge > half:
            assert told == FREE


def test_what_does_not_cross_the_plane_is_not_seen(scans_of):
    below, above = beside(6.0, 0.0, height=1.0), beside(0.0, 6.0, base=1.0)
    _, _, ground = scans_of(below, above)
    ground.in_air(5.0)
    (scan, *_) = ground.of("OBSTACLE_DISTANCE", ground.run(0.2))
    assert [sector for sector, told in enumerate(scan.distances) if told != FREE] == [0, 1, 2, 70, 71]


def test_an_obstacle_on_the_vehicle_and_a_covered_lidar_give_zeros_and_a_silent_one_nothing(scans_of):
    on_it, _, ground = scans_of(beside(0.2, 0.0))
    assert set(on_it[-1].distances) == {0}
    assert set(scans_of(state="covered")[0][-1].distances) == {0}
    assert not scans_of(state="silent")[0]
    assert ground.of("ODOMETRY")


def test_3d_tells_the_same_places(scans_of):
    scans, points, _ = scans_of(beside(6.0, 0.0), tells_3d=True)
    hits = sum(told != FREE for told in scans[-1].distances)
    last = points[-hits:]
    assert {p.time_boot_ms for p in last} == {round(scans[-1].time_usec / 1e3)}
    nearest = min(last, key=lambda p: math.hypot(p.x, p.y))
    assert (nearest.x, nearest.y, nearest.z) == pytest.approx((0.0, 5.0, 0.0), abs=0.03)


def test_only_the_companions_link_carries_the_lidar(make_ground):
    ground = make_ground("px4", obstacles=(beside(6.0, 0.0),))
    assert not ground.of("OBSTACLE_DISTANCE", ground.run(1.0))


def test_odometry_is_within_what_it_says_of_itself(make_ground):
    ground = make_ground("px4")
    ground.channel.leads_to_companion = True
    ground.in_air(8.0)
    told = ground.of("ODOMETRY", ground.run(0.2))[-1]
    deviation = math.sqrt(told.pose_covariance[0])
    # The frame looked along the nose, to its right, and down at the start; the vehicle has climbed straight up.
    assert (told.x, told.y, told.z + ground.vehicle.airframe.height_m) == pytest.approx((0, 0, 0), abs=4 * deviation)
    assert told.quality > 50 and told.frame_id == 20 and told.estimator_type == mavlink.MAV_ESTIMATOR_TYPE_LIDAR
    ground.vehicle.lidar.odometry_state = "failed"
    failed = ground.of("ODOMETRY", ground.run(0.2))[-1]
    assert failed.quality == -1 and math.isnan(failed.pose_covariance[0])
    ground.vehicle.lidar.odometry_state = "silent"
    assert not ground.of("ODOMETRY", ground.run(0.5))


def test_the_least_distance_is_taken_at_every_step_in_the_air(make_ground):
    passes = Obstacle("car", ((-30.0, -20.0), (-10.0, -20.0)), 0.5, 0.0, 3.0, speed_m_s=4.0, start_s=1.0)
    ground = make_ground("px4", obstacles=(passes, beside(3.0, 0.0, base=9.0, height=1.0)))
    ground.run(6.0)
    assert ground.vehicle.encounters.state()["nearest"] is None  # it stood on the ground
    ground.in_air(8.0)
    truth = ground.vehicle.encounters
    assert truth.nearest == "it" and not truth.touched
    height = ground.vehicle.airframe.position_m[2]
    assert truth.least_m == pytest.approx(math.hypot(2.0, 9.0 - max(height, 8.0)) - 0.5, abs=0.1)


def test_what_is_hit_is_named_with_its_time(make_ground):
    above = Obstacle("crate", ((-20.0, -20.0),), 1.0, 6.0, 1.0)
    ground = make_ground("px4", obstacles=(above,))
    ground.in_air(8.0)
    (name, when) = next(iter(ground.vehicle.encounters.touched.items()))
    assert name == "crate" and 3.0 < when < ground.vehicle.time_s
    assert ground.vehicle.encounters.least_m < -0.9
