"""What an offboard flight learns of its vehicle while it flies, and gives back to its stream of setpoints."""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.core.learned_dynamics import NOTHING_LEARNED, LearnedDynamics
from gcs.planning.dynamics.feed_forward import (
    NO_FEED_FORWARD,
    DragEstimator,
    FeedForward,
    LagEstimator,
    TiltLagEstimator,
    carried_over,
    eased,
    known,
    usable,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.motion import MotionSample

SENT_KEPT = 512
"""Setpoints that are remembered: ten seconds of a stream, of which some are ahead."""

MOST_APART_S = 0.3
"""A sample of the vehicle's motion this long after the last setpoint says nothing about how that is followed."""

WORTH_SAYING_DRAG_S, WORTH_SAYING_LAG_S = 0.1, 0.05


class StreamFeedForward:
    """Learns drag and lag from setpoints and motion, and tells what the next setpoint may use of it.

    `learn` and `news` are for the event loop; `at` and `sent` are for the thread that streams.

    Args:
        accelerates: whether the vehicle takes another acceleration than that of the setpoints' own motion.
        learned: what the vehicle's last flight ended with; the stream starts with it.
    """

    def __init__(self, *, accelerates: bool, learned: LearnedDynamics = NOTHING_LEARNED) -> None:
        self._accelerates = accelerates
        start = carried_over(learned)
        self._drag = DragEstimator(start.drag)
        self._lag = LagEstimator(start.lag)
        self._tilt_lag = TiltLagEstimator(start.tilt_lag)
        self._lock = threading.Lock()
        self._sent: deque[tuple[float, NDArray[np.float64], NDArray[np.float64]]] = deque(maxlen=SENT_KEPT)
        self._wanted = self._usable()
        self._present = NO_FEED_FORWARD
        self._at_s: float | None = None
        self._said = NO_FEED_FORWARD

    @property
    def learned(self) -> LearnedDynamics:
        """What is known of the vehicle by now."""
        return known(self._drag.estimate, self._lag.estimate, self._tilt_lag.estimate)

    @property
    def present(self) -> FeedForward:
        """What the last setpoint used."""
        return self._present

    def at(self, vehicle_s: float) -> FeedForward:
        """What the setpoint of a time of the vehicle's clock is to use: what was learned, eased in."""
        step = 0.0 if self._at_s is None else vehicle_s - self._at_s
        self._at_s = vehicle_s
        self._present = eased(self._present, self._wanted, step)
        return self._present

    def sent(self, vehicle_s: float, position_m: NDArray[np.float64], velocity_m_s: NDArray[np.float64]) -> None:
        """A setpoint is to go out, and none that was told of for a later time.

        Args:
            vehicle_s: on the vehicle's clock.
            position_m: local ENU about the estimator's origin, shape (3,).
            velocity_m_s: likewise.
        """
        with self._lock:
            while self._sent and self._sent[-1][0] >= vehicle_s:
                self._sent.pop()
            self._sent.append((vehicle_s, position_m, velocity_m_s))

    def learn(self, sample: MotionSample) -> None:
        """The vehicle tells how it moves."""
        self._drag.add(sample)
        self._tilt_lag.add(sample)
        asked = self._asked_at(sample.vehicle_s)
        if asked is not None:
            self._lag.add(sample.vehicle_s, sample.position_m, *asked)
        self._wanted = self._usable()

    def _usable(self) -> FeedForward:
        wanted = usable(self.learned)
        return wanted if self._accelerates else FeedForward(lead_s=wanted.lead_s)

    def news(self) -> tuple[str, dict[str, Any]] | None:
        """A line for the flight's log when what is learned has changed by something, and its numbers."""
        wanted, said = self._wanted, self._said
        lags = (wanted.lead_s - said.lead_s, wanted.tilt_lead_s - said.tilt_lead_s)
        if abs(wanted.drag_s - said.drag_s) < WORTH_SAYING_DRAG_S and max(map(abs, lags)) < WORTH_SAYING_LAG_S:
            return None
        self._said = wanted
        learned, words = self.learned, []
        if learned.drag is not None:
            e = learned.drag
            words.append(f"drag {e.value:.2f} ± {e.sigma:.2f} m/s² per m/s, {wanted.drag_s:.2f} fed forward")
        if learned.lag is not None:
            words.append(f"{learned.lag.value:.2f} ± {learned.lag.sigma:.2f} s behind its setpoints")
        if learned.tilt_lag is not None:
            e = learned.tilt_lag
            words.append(f"tilt {e.value:.2f} ± {e.sigma:.2f} s behind what is asked for")
        text = "learned in flight: " + ("; ".join(words) or "nothing is certain any more")
        numbers = {"drag_used_s": wanted.drag_s, "lead_s": wanted.lead_s, "tilt_lead_s": wanted.tilt_lead_s}
        estimates = (("drag", self._drag), ("lag", self._lag), ("tilt_lag", self._tilt_lag))
        for name, estimate in ((name, estimator.estimate) for name, estimator in estimates):
            numbers |= {f"{name}_s": estimate.value, f"{name}_sigma_s": estimate.sigma}
        return text, numbers

    def _asked_at(self, vehicle_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Position and velocity of the setpoint at a time; None when none went out about then."""
        with self._lock:
            sent = next((s for s in reversed(self._sent) if s[0] <= vehicle_s), None)
        if sent is None or vehicle_s - sent[0] > MOST_APART_S:
            return None
        at_s, position, velocity = sent
        return position + (vehicle_s - at_s) * velocity, velocity
