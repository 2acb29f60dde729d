"""The companion on fake time, beside a whole simulated vehicle: orders, the pilot, the station, the sensors."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.core.errors import LinkError, NotFoundError, RefusedError
from gcs.core.replanning import ReplanReason
from gcs.core.vehicle import FlightMode
from gcs.mavlink.companion_lease import LeaseState, OrderKind
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.mavlink.tunnel_carrier import replanning, tunnelled

TRUCK = {"kind": "vehicle", "radius_m": 1.0, "height_m": 20.0, "path_m": [[6.0, 0.3]]}


def flying(make_world, autopilot="px4", **options):
    """A world in which the companion leads, on its way to the first viewpoint."""
    world = make_world(autopilot, **options)
    world.take_off()
    world.order()
    assert world.run(20.0, lambda: world.core.status.plan_time_s > 9.0)
    return world


def test_a_plan_is_flown_with_its_pictures_and_the_vehicle_lands(make_world, autopilot):
    world = make_world(autopilot)
    world.take_off()
    assert world.order().state is LeaseState.LEADING
    assert world.fly_until(LeaseState.FINISHED).reports_pending == 0
    world.run(30.0)
    truth = world.world.truth()
    assert not truth["armed"], "landed"
    assert np.hypot(*truth["position_m"][:2]) < 0.5, "over home"
    assert truth["longest_setpoint_gap_s"] < 0.1
    shots = np.array([shot["position_m"] for shot in truth["shots"]])
    viewpoints = world.plans.plans[next(iter(world.plans.plans))].plan.viewpoints
    assert np.abs(shots - [v.position_m for v in viewpoints]).max() < 0.3
    assert {status.plan_hash for status in world.states[-5:]} == {next(iter(world.plans.plans))}


def test_what_is_in_the_way_is_flown_round_and_reported(make_world, autopilot):
    world = make_world(autopilot, obstacles=[TRUCK], loss=0.05)
    world.take_off()
    world.order()
    world.fly_until(LeaseState.FINISHED)
    truth = world.world.truth()
    assert truth["obstacles"]["touched"] == {}
    assert truth["captures"] >= 2
    report = world.outbox.reports[0]
    assert report.reason is ReplanReason.STANDING_OBSTACLE
    assert report.boot_id == world.outbox.boot_id
    assert report.rejoined_at_s > report.left_at_s
    assert len(report.path) >= 3
    assert all(place.altitude_m == pytest.approx(10.0, abs=0.7) for place in report.path), "in the lidar's slab"


@pytest.mark.parametrize(("kind", "switch"), [("px4", "POSCTL"), ("px4", "AUTO.RTL"), ("ardupilot", "LOITER")])
def test_the_pilots_switch_ends_it_at_once_and_only_a_new_order_goes_on(make_world, kind, switch):
    world = flying(make_world, kind)
    assert world.vehicle.set_mode_by_name(switch)
    assert world.run(1.0, lambda: world.core.status.state is LeaseState.TAKEN_OVER)
    ended_s = world.now_s
    world.run(3.0)
    assert world.setpoints_since(ended_s) == 0
    assert world.world.truth()["mode"] == switch
    assert world.order(lease=1).state is LeaseState.TAKEN_OVER, "an old order is no new one"
    with pytest.raises(RefusedError, match="not held"):
        world.order(lease=2)
    assert world.world.truth()["mode"] == switch, "the companion never leaves a pilot's mode"


def test_after_a_hold_by_hand_a_new_order_goes_on_where_it_ended(make_world):
    world = flying(make_world)
    assert world.run(60.0, lambda: world.core._vehicle.pictures == 1)
    world.run(1.0)
    world.station.guard.take_back()
    world.do(world.station.stack.pause(world.station.commands(lambda: None)))
    assert world.fly_until(LeaseState.TAKEN_OVER, timeout_s=2.0)
    world.run(2.0)
    assert world.order(lease=2).state is LeaseState.LEADING
    world.fly_until(LeaseState.FINISHED)
    assert world.world.truth()["captures"] == 2, "no picture twice"


def test_moved_sticks_end_it(make_world, autopilot):
    world = flying(make_world, autopilot)
    world.vehicle.streams.sticks_us[2] = 1600  # trembling hands
    world.run(1.0)
    assert world.core.status.state is LeaseState.LEADING
    world.vehicle.streams.sticks_us[2] = 1800
    assert world.run(1.0, lambda: world.core.status.state is LeaseState.TAKEN_OVER)
    assert "sticks" in world.core.status.text


@pytest.mark.parametrize("before_us", [None, 0])
def test_sticks_count_from_where_they_are_first_heard(make_world, before_us):
    """Nothing is heard of them, or no positions are told, until the transmitter is switched on in the air."""
    world = make_world()
    if before_us is None:
        world.drop = lambda message: message.get_type() == "RC_CHANNELS"
    else:
        world.vehicle.streams.sticks_us[:] = [before_us] * 4
    world.take_off()
    world.order()
    world.run(3.0)
    world.drop = lambda message: False
    world.vehicle.streams.sticks_us[:] = [1500, 1500, 1100, 1500]
    world.run(1.0)
    assert world.core.status.state is LeaseState.LEADING
    world.vehicle.streams.sticks_us[2] = 1500
    assert world.run(1.0, lambda: world.core.status.state is LeaseState.TAKEN_OVER)


@pytest.mark.parametrize(("system_id", "component_id"), [(2, 191), (2, 0), (1, 100)])
def test_orders_for_somebody_else_are_nothing_to_it(make_world, system_id, component_id):
    world = make_world()
    world.take_off()
    (plan_hash,) = world.plans.plans

    def give(system_id, component_id):
        inner = replanning.MAVLink_lease_order_message(9, OrderKind.FLY, list(bytes.fromhex(plan_hash)))
        packet = FramePacker(255, 190).pack(tunnelled(inner, system_id, component_id))
        for message in FrameParser().feed(packet):
            world.core.handle(message)

    give(system_id, component_id)
    world.run(2.0)
    assert world.core.status.lease == 0
    give(1, 0)
    world.run(2.0)
    assert world.core.status.lease == 9


def test_orders_are_refused_with_the_reason(make_world):
    world = make_world()
    with pytest.raises(RefusedError, match="does not fly"):
        world.order(lease=1)
    world.take_off()
    world.plans.error = NotFoundError("the station knows no plan of this hash")
    with pytest.raises(RefusedError, match="no plan of this hash"):
        world.order(lease=2)
    world.plans.error = None
    world.vehicle.lidar.state = "silent"
    world.run(2.0)
    with pytest.raises(RefusedError, match="lidar is silent"):
        world.order(lease=3)
    world.vehicle.lidar.state = "clear"
    world.run(1.0)
    assert world.order(lease=4).state is LeaseState.LEADING
    with pytest.raises(RefusedError, match="another lease"):
        world.order(lease=5)
    assert world.core.status.lease == 4


def test_far_from_the_start_it_does_not_begin(make_world):
    world = make_world()
    world.take_off()
    flyable = next(iter(world.plans.plans.values()))
    flyable.curve.coefficients[:, 0, 0] += 30.0
    with pytest.raises(RefusedError, match="30 m away"):
        world.order()


def test_without_a_companion_the_station_is_told_so(make_world):
    world = make_world()
    world.take_off()
    world.drop = lambda message: message.get_type() == "TUNNEL"
    with pytest.raises(LinkError, match="no companion"):
        world.order()


def test_pause_resume_and_end_by_order(make_world):
    world = flying(make_world)
    assert world.order(OrderKind.PAUSE).state is LeaseState.PAUSED
    world.run(5.0)
    place = world.station.poses.newest.position_m
    world.run(3.0)
    assert np.linalg.norm(world.station.poses.newest.position_m - place) < 0.3
    assert world.station.mode is FlightMode.OFFBOARD
    assert world.order(OrderKind.RESUME).state is LeaseState.LEADING
    assert world.run(30.0, lambda: world.core._vehicle.pictures == 1)
    assert world.order(OrderKind.END).state is LeaseState.ENDED
    assert world.core.status.text == "ended by order"
    world.run(2.0)
    assert world.station.mode is FlightMode.HOLD


def test_it_goes_on_without_the_station(make_world):
    world = make_world(obstacles=[TRUCK], parameters={"NAV_DLL_ACT": 0})
    world.take_off()
    world.order()
    world.station_is_away = True
    world.fly_until(LeaseState.FINISHED)
    assert world.outbox.pending >= 1, "told later"


def test_a_silent_lidar_halts_it_and_it_goes_on_when_it_sees_again(make_world):
    world = flying(make_world)
    world.vehicle.lidar.state = "silent"
    world.run(5.0)
    assert np.linalg.norm(world.station.poses.newest.velocity_m_s) < 0.3
    assert world.core.status.state is LeaseState.LEADING
    assert any("lidar is silent" in text for text in world.texts)
    world.vehicle.lidar.state = "clear"
    world.fly_until(LeaseState.FINISHED)


@pytest.mark.parametrize("state", ["silent", "covered"])
def test_a_lidar_that_stays_away_ends_the_lease_in_a_hold(make_world, autopilot, state):
    world = flying(make_world, autopilot)
    world.vehicle.lidar.state = state
    assert "lidar" in world.fly_until(LeaseState.ENDED, timeout_s=20.0).text
    world.run(3.0)
    assert world.station.mode is FlightMode.HOLD
    if state == "covered":
        assert sum("every range is 0" in text for text in world.texts) == 1, "said once"


def test_failed_odometry_halts_it(make_world):
    world = flying(make_world)
    world.vehicle.lidar.odometry_state = "failed"
    world.run(4.0)
    assert np.linalg.norm(world.station.poses.newest.velocity_m_s) < 0.3
    assert world.core.status.odometry_quality == -1
    assert any("odometry has failed" in text for text in world.texts)
    world.vehicle.lidar.odometry_state = "tracking"
    world.fly_until(LeaseState.FINISHED)


def test_pictures_that_nobody_announces_are_taken_again_and_said(make_world):
    world = flying(make_world)
    world.drop = lambda message: message.get_type().startswith("CAMERA_")
    world.fly_until(LeaseState.FINISHED)
    assert world.world.truth()["captures"] == 6, "three tries at each of two viewpoints"
    assert sum("no picture was announced" in text for text in world.texts) == 2


def test_a_lost_stream_of_orders_is_not_followed_late(make_world):
    world = make_world()
    world.take_off()
    world.plans.plans, kept = {}, world.plans.plans
    with pytest.raises(TimeoutError):
        world.order(timeout_s=8.0)
    world.run(10.0)
    world.plans.plans = kept
    world.run(5.0)
    assert world.core.status.state is LeaseState.REFUSED
    assert world.station.mode is FlightMode.HOLD
