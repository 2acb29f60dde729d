"""What a flight learns reaches its stream slowly, is said, and never changes where the setpoints lead."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.core.motion import MotionSample
from gcs.planning.dynamics.feed_forward import DRAG_SLEW_S2, NO_FEED_FORWARD
from gcs.services.stream_feed_forward import StreamFeedForward

LAG, TILT_LAG, DRAG = 0.2, 0.15, 0.9


def velocity(t):
    return np.array([3.0 * math.sin(0.7 * t), 2.0 * math.sin(0.45 * t), 0.0])


def place(t):
    return np.array([-3.0 / 0.7 * math.cos(0.7 * t), -2.0 / 0.45 * math.cos(0.45 * t), 20.0])


def axis(t):
    acceleration = np.array([2.1 * math.cos(0.7 * t), 0.9 * math.cos(0.45 * t), 9.80665])
    force = acceleration + DRAG * velocity(t)
    return force / np.linalg.norm(force)


def flown(learner, seconds, from_s=0.0):
    """A vehicle that is `LAG` behind its setpoints, and whose tilt is behind what it asks for; what the stream used."""
    used = []
    for i in range(round(seconds * 50)):
        t = from_s + i * 0.02
        used.append(learner.at(t))
        learner.sent(t, place(t), velocity(t))
        if i % 5 == 0:
            late = t - LAG
            turning = (axis(late + 0.01) - axis(late - 0.01)) / 0.02
            learner.learn(MotionSample(t, place(late), velocity(late), axis(late), axis(late) + TILT_LAG * turning))
    return used


def test_it_learns_and_eases_in_what_it_learned():
    learner = StreamFeedForward(accelerates=True)
    assert learner.at(0.0) == NO_FEED_FORWARD
    used = flown(learner, 60.0)
    drag = np.array([u.drag_s for u in used])
    assert np.abs(np.diff(drag)).max() <= DRAG_SLEW_S2 * 0.02 + 1e-9
    assert DRAG - 0.1 < drag[-1] <= DRAG, "what is certain of it"
    assert used[-1].lead_s == pytest.approx(LAG, abs=0.02)
    assert used[-1].tilt_lead_s == pytest.approx(TILT_LAG, abs=0.02)
    assert learner.present == used[-1]


def test_what_it_learned_is_said_with_its_numbers_and_not_again_and_again():
    learner = StreamFeedForward(accelerates=True)
    assert learner.news() is None
    said = []
    for k in range(120):
        flown(learner, 0.5, 0.5 * k)
        said += [learner.news()]
    told = [news for news in said if news is not None]
    assert 1 <= len(told) <= 12
    text, numbers = told[-1]
    assert text.startswith("learned in flight: drag 0.9")
    assert "behind its setpoints" in text
    assert numbers["drag_used_s"] <= numbers["drag_s"] == pytest.approx(DRAG, abs=0.05)
    assert all(math.isfinite(number) for number in numbers.values())
    assert all(news is None for news in said[-30:])


def test_the_next_flight_starts_with_what_the_last_one_learned():
    first = StreamFeedForward(accelerates=True)
    flown(first, 60.0)
    following = StreamFeedForward(accelerates=True, learned=first.learned)
    used = [following.at(0.02 * i) for i in range(200)]
    assert np.abs(np.diff([u.drag_s for u in used])).max() <= DRAG_SLEW_S2 * 0.02 + 1e-9
    # Less is certain of it than at the end of that flight, so less is used.
    assert DRAG - 0.35 < used[-1].drag_s < first.present.drag_s
    assert used[-1].lead_s == pytest.approx(LAG, abs=0.02)
    assert used[-1].tilt_lead_s == pytest.approx(TILT_LAG, abs=0.02)


def test_a_vehicle_whose_setpoints_run_on_by_themselves_gets_no_acceleration():
    learner = StreamFeedForward(accelerates=False)
    used = flown(learner, 60.0)
    assert {(u.drag_s, u.tilt_lead_s) for u in used} == {(0.0, 0.0)}
    assert used[-1].lead_s == pytest.approx(LAG, abs=0.02)


def test_motion_without_setpoints_or_long_after_them_tells_no_lag():
    learner = StreamFeedForward(accelerates=True)
    for i in range(300):
        t = 0.1 * i
        learner.learn(MotionSample(t, place(t - 3.0), velocity(t), axis(t)))
    learner.sent(0.0, place(0.0), velocity(0.0))
    for i in range(300):
        t = 5.0 + 0.1 * i
        learner.learn(MotionSample(t, place(t - 3.0), velocity(t), axis(t)))
    assert learner.at(100.0).lead_s == 0.0
