"""Cooperative positioning in flight: an observer's sightings make the position of a vehicle that lacks its own fix.

Decides and computes, without clocks or links of its own; `sighted_flight` runs it between two vehicles. Every sighting
is held against what can be before it is used, and what is wrong with one is said once.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.core.frames import enu_from_geodetic
from gcs.mavlink.external_position import ExternalPosition
from gcs.mavlink.sightings import ObserverFix, ObserverPlace, SightingReport
from gcs.planning.local.cooperative_position import PositionFix, Sighting, sighted_position
from gcs.planning.local.sighting_filter import SightingFilter

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.core.frames import GeoPoint
    from gcs.core.vehicle import Telemetry

OWN_FIX = 3
"""GPS_FIX_TYPE from which on a receiver's fix counts."""

USUAL_DEVIATIONS_M = {3: 2.5, 4: 1.0, 5: 0.5, 6: 0.05}
"""Of a fix by its type, horizontal, where the receiver tells none; the height errs 1.5 times as much."""

STALE_S = 0.5
"""Older sightings are not used, and so is an observer's place that is so much apart from them."""

FRESH_S = 5.0
"""What the vehicle tells of its own fix counts so long."""

UNSEEN_S = 1.0
"""After so long without a sighting in need of one it is said."""

SURE = 5.0
"""Standard deviations beyond which nothing is put down to noise."""

DRIFT_M, DRIFT_M_S = 3.0, 1.0
"""By how much the vehicle's own dead reckoning may be off at first, and how much more each second."""

LEAST_RATE_HZ = 5.0
"""Fewer sightings are used too, and said: ArduPilot counts on a fix so often."""


class CooperativePositioning:
    """Makes positions for one vehicle of what one observer tells.

    Args:
        observer: name of the vehicle that looks.
        seen: name of the vehicle that is looked at.
        seen_system: its system id.
        say: takes lines for the operator.
    """

    def __init__(self, observer: str, seen: str, seen_system: int, say: Callable[[str], None]) -> None:
        self._observer = observer
        self._seen = seen
        self._seen_system = seen_system
        self._say = say
        self._said: set[str] = set()
        self._filter = SightingFilter()
        self._place: ObserverPlace | None = None
        self._fix: ObserverFix | None = None
        self._newest: tuple[float, PositionFix] | None = None
        self._last_s = -math.inf
        self._blocked_since_s: float | None = None
        self._used_s: float | None = None
        self._deviation_m: float | None = None
        self._interval_s: float | None = None
        self._resets = 0

    @property
    def source(self) -> str | None:
        """Where the vehicle has its position from, in words; None while it has its own."""
        if self._blocked_since_s is None:
            return None
        if self._deviation_m is None:
            return "dead reckoning"
        return f"sighted by {self._observer}, ±{self._deviation_m:.2f} m"

    def watch(self, seen: Telemetry, now_s: float) -> None:
        """Look at what the vehicle tells of its own fix; to be called often.

        Args:
            seen: its telemetry.
            now_s: the station's clock.
        """
        fix = seen.gps_fix
        if fix is None or fix.age_s(now_s) > FRESH_S:
            return
        if fix.value >= OWN_FIX:
            if self._blocked_since_s is not None:
                self._say(f"{self._seen} has its own position fix again: {self._observer}'s sightings are not needed")
            self._blocked_since_s = self._used_s = self._deviation_m = None
            return
        if self._blocked_since_s is None:
            self._blocked_since_s = now_s
            self._resets += 1
            self._say(f"{self._seen} has lost its own position fix: {self._observer}'s sightings take its place")
        if now_s - self._unaided_since_s > UNSEEN_S:
            self._deviation_m = None
            self._tell("unseen", f"{self._seen} is told no position: no sighting of {self._observer} can be used")

    def take(
        self,
        heard: ObserverPlace | ObserverFix | SightingReport,
        observer_now_s: float,
        seen: Telemetry,
        now_s: float,
    ) -> PositionFix | None:
        """Take what the observer tells.

        Args:
            heard: it.
            observer_now_s: the observer's clock.
            seen: the other vehicle's telemetry.
            now_s: the station's clock.

        Returns:
            The sighted position in ENU about the other vehicle's origin, when there is a new one and it is needed.
        """
        if isinstance(heard, ObserverPlace):
            self._place = heard
        elif isinstance(heard, ObserverFix):
            self._fix = heard
        elif self._blocked_since_s is not None:
            try:
                return self._sighted(heard, observer_now_s, seen, now_s)
            except InputError as error:
                self._tell(error.field or "sighting", f"a sighting of {self._observer} is not used: {error.message}")
        return None

    def position(
        self, observer_now_s: float, ahead_s: float, origin: GeoPoint, vehicle_now_s: float, unix_s: float
    ) -> ExternalPosition:
        """What the vehicle is told now: the last sighting, moved on by the velocity that all of them show.

        The place is not averaged over time, as the velocity is: the vehicle's own estimator does that better, and takes
        what it is told for independent. Both ways were flown; they are equally good.

        Args:
            observer_now_s: the observer's clock.
            ahead_s: the moment that the vehicle takes the position for, from now on.
            origin: of the vehicle's local frame.
            vehicle_now_s: the vehicle's clock.
            unix_s: UTC.

        Raises:
            InputError: nothing was sighted yet.
        """
        if self._newest is None:
            raise InputError("nothing was sighted yet", field="sighting")
        at_s, fix = self._newest
        motion = self._filter.motion(observer_now_s + ahead_s)
        moved_s = observer_now_s + ahead_s - at_s
        return ExternalPosition(
            fix.position_m + moved_s * motion.velocity_m_s,
            motion.velocity_m_s,
            fix.covariance_m2 + moved_s**2 * motion.velocity_covariance_m2_s2,
            motion.velocity_covariance_m2_s2,
            origin,
            vehicle_now_s + ahead_s,
            unix_s,
            self._resets,
        )

    def _sighted(
        self, report: SightingReport, observer_now_s: float, seen: Telemetry, now_s: float
    ) -> PositionFix | None:
        if report.seen_system != self._seen_system:
            raise InputError(
                f"it is of system {report.seen_system}, and {self._seen} is {self._seen_system}", field="seen_system"
            )
        age_s = observer_now_s - report.at_s
        if not -STALE_S < age_s < STALE_S:
            raise InputError(f"it is {age_s:.2f} s old by the observer's own clock", field="time_boot_ms")
        if report.at_s <= self._last_s < report.at_s + FRESH_S:
            raise InputError("it came before, or another one that is newer", field="time_boot_ms repeated")
        interval_s, self._last_s = report.at_s - self._last_s, report.at_s
        sighting = Sighting(report.range_m, report.pitch_rad, report.azimuth_rad, *report.deviations)
        own = seen.local_position_m
        if seen.origin is None or own is None or own.age_s(now_s) > FRESH_S:
            raise InputError(f"{self._seen} does not tell its origin and local position", field="origin")
        observer = self._observer_fix(report.at_s, seen.origin.value)
        fix = sighted_position(observer, sighting)
        self._demand_likely(fix, own.value, now_s)
        self._filter.add(report.at_s, fix, observer)
        self._watch_rate(interval_s)
        self._newest, self._used_s = (report.at_s, fix), now_s
        self._deviation_m = math.sqrt(float(np.linalg.eigvalsh(fix.covariance_m2)[-1]))
        return fix

    @property
    def _unaided_since_s(self) -> float:
        """Since when (station's clock) the vehicle that lacks a fix has not been told where it is."""
        since_s = self._blocked_since_s if self._used_s is None else self._used_s
        return math.inf if since_s is None else since_s

    def _observer_fix(self, at_s: float, origin: GeoPoint) -> PositionFix:
        """Where the observer was, about the other vehicle's origin."""
        place, fix = self._place, self._fix
        if fix is None or fix.fix_type < OWN_FIX:
            raise InputError("the observer has no position fix itself", field="observer's fix")
        if place is None or not abs(at_s - place.at_s) < STALE_S:
            raise InputError("the observer does not tell where it was then", field="observer's place")
        there = place.place
        position = enu_from_geodetic(there.latitude_deg, there.longitude_deg, there.altitude_m, origin)
        usual = USUAL_DEVIATIONS_M[min(fix.fix_type, max(USUAL_DEVIATIONS_M))]
        horizontal = usual if fix.horizontal_m is None else fix.horizontal_m
        vertical = 1.5 * usual if fix.vertical_m is None else fix.vertical_m
        moved = position + place.velocity_m_s * (at_s - place.at_s)
        return PositionFix(moved, np.diag([horizontal, horizontal, vertical]) ** 2)

    def _demand_likely(self, fix: PositionFix, own_m: NDArray[np.float64], now_s: float) -> None:
        """Refuse what is further from the vehicle's own estimate than that can be off."""
        since_s = now_s - self._unaided_since_s
        sure_m = SURE * math.sqrt(float(np.linalg.eigvalsh(fix.covariance_m2)[-1]))
        allowed_m = sure_m + DRIFT_M + DRIFT_M_S * since_s
        off_m = float(np.linalg.norm(fix.position_m - own_m))
        if off_m > allowed_m:
            raise InputError(
                f"it is {off_m:.1f} m from where {self._seen} takes itself to be, and {allowed_m:.1f} m are likely",
                field="range",
            )

    def _watch_rate(self, interval_s: float) -> None:
        before_s, self._interval_s = self._interval_s, interval_s
        if before_s is not None and min(before_s, interval_s) > 1.0 / LEAST_RATE_HZ:
            rate = 1.0 / interval_s
            self._tell("rate", f"{self._observer} sights {self._seen} {rate:.1f} times a second; 5 are wanted")

    def _tell(self, about: str, text: str) -> None:
        if about not in self._said:
            self._said.add(about)
            self._say(text)
