"""How setpoints are followed: what is fed forward is followed, what exceeds a limit is left behind."""

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.core.flight_law import Airframe, ArduPilotLaw, Px4Law
from gcs.planning.dynamics.predicted_flight import SetpointStream
from gcs.planning.dynamics.setpoint_following import predict_ardupilot_stream, predict_px4_stream

RADIUS, SPEED = 20.0, 3.0


def stream(position, velocity=None, acceleration=None, hz=20.0, seconds=60.0):
    t = np.arange(0.0, seconds, 1 / hz)
    zero = np.zeros((len(t), 3))
    return SetpointStream(
        t,
        np.array([position(x) for x in t], float),
        zero if velocity is None else np.array([velocity(x) for x in t], float),
        zero if acceleration is None else np.array([acceleration(x) for x in t], float),
    )


def angle(t):
    """Along a circle, speeding up over the first ten seconds."""
    w = SPEED / RADIUS
    return (w * t * t / 20, w * t / 10, w / 10) if t < 10 else (w * (t - 5), w, 0.0)


def circle(order):
    def at(t):
        a, w, dw = angle(t)
        c, s = np.cos(a), np.sin(a)
        if order == 0:
            return RADIUS * c, RADIUS * s, 20.0
        if order == 1:
            return -RADIUS * w * s, RADIUS * w * c, 0.0
        return -RADIUS * (w * w * c + dw * s), RADIUS * (dw * c - w * w * s), 0.0

    return at


def off(flight):
    return abs(np.linalg.norm(flight.position_m[:, :2], axis=1) - RADIUS)[300:].max()


def test_without_drag_a_whole_setpoint_is_followed_closely():
    whole = stream(*(circle(k) for k in range(3)))
    assert off(predict_px4_stream(whole, Px4Law(), Airframe(0.0, 0.03))) < 0.05
    assert off(predict_ardupilot_stream(whole, ArduPilotLaw(), Airframe(0.0, 0.03))) < 0.05


def test_drag_carries_it_out_and_feeding_it_forward_brings_it_back():
    plain = stream(*(circle(k) for k in range(3)))
    fed = stream(circle(0), circle(1), lambda t: np.add(circle(2)(t), np.array(circle(1)(t))))
    without = off(predict_px4_stream(plain, Px4Law(), Airframe(1.0, 0.05)))
    assert without > 0.3
    assert off(predict_px4_stream(fed, Px4Law(), Airframe(1.0, 0.05))) < 0.25 * without


def test_without_acceleration_ardupilot_is_as_far_out_as_measured():
    # a circle of 20 m at 3 m/s: 0.18 m with and 0.42 m without acceleration, measured on a real one
    airframe = Airframe(0.35, 0.1)
    whole = off(predict_ardupilot_stream(stream(*(circle(k) for k in range(3))), ArduPilotLaw(), airframe))
    less = off(predict_ardupilot_stream(stream(circle(0), circle(1)), ArduPilotLaw(), airframe))
    assert whole == pytest.approx(0.18, abs=0.1)
    assert less == pytest.approx(0.42, abs=0.1)


def test_a_climb_beyond_px4s_limit_is_left_behind():
    climb = stream(lambda t: (0, 0, 4 * t), lambda t: (0, 0, 4.0), seconds=20.0)
    law = Px4Law(max_climb_m_s=3.0)
    z = predict_px4_stream(climb, law, Airframe(0.0)).position_m[-1, 2]
    assert z == pytest.approx(3.0 * 19.95, abs=2.0)
    # ArduPilot does not bound what is fed forward.
    assert predict_ardupilot_stream(climb, ArduPilotLaw(), Airframe(0.0)).position_m[-1, 2] > 4 * 19.95 - 2.0


def test_it_starts_and_stays_at_rest():
    still = stream(lambda t: (1.0, 2.0, 3.0), seconds=3.0)
    for predict, law in ((predict_px4_stream, Px4Law()), (predict_ardupilot_stream, ArduPilotLaw())):
        assert np.allclose(predict(still, law, Airframe()).position_m, [1.0, 2.0, 3.0])


def test_bad_streams_and_limits_are_refused():
    with pytest.raises(InputError, match="order of time"):
        SetpointStream(np.array([0.0, 0.0]), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(InputError, match="three finite numbers") as caught:
        SetpointStream(np.array([0.0, 1.0]), np.zeros((2, 3)), np.full((2, 3), np.nan), np.zeros((2, 3)))
    assert caught.value.field == "velocity_m_s"
    still = stream(lambda t: (1.0, 2.0, 3.0), seconds=1.0)
    with pytest.raises(InputError, match="positive number"):
        predict_px4_stream(still, Px4Law(max_climb_m_s=0.0), Airframe())
    with pytest.raises(InputError, match="positive number"):
        predict_ardupilot_stream(still, ArduPilotLaw(stream_jerk_m_s3=-1.0), Airframe())
