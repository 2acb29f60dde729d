"""Which way messages of a vehicle's component come and go, when it is heard over several links.

A *way* is a peer of a link over which a component is heard. One of them is *best*: what is sent goes there. What is
heard is taken

- from all ways, and each packet once, where the ways carry the same packets (a router sends them over radio and LTE):
  known by packets that are the same to the last bit, and none that has only the number of another;
- from the best way alone where each carries a stream of its own (the autopilot's two telemetry ports): the same events
  come on both, and cannot be told from two events.

The best way changes at once when it falls silent for `SILENT_S`, and otherwise when another has been clearly better for
`BETTER_FOR_S`: better by the time that a question and its answer need until both got through.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from gcs.mavlink.command_protocol import command_long
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.link_base import Link, Peer
from gcs.mavlink.link_quality import RoundTripMeter, SequenceMeter
from gcs.mavlink.message_rates import request_call
from gcs.mavlink.received_message import ReceivedMessage
from gcs.mavlink.signing import SigningStatus

Component = tuple[int, int]
"""System and component id."""

SILENT_S = 1.5
BETTER_FOR_S = 3.0
CLEARLY = 0.7
MARGIN_S = 0.02
UNKNOWN_ROUND_TRIP_S = 0.5
UNIT_ASKED = 5
FORGOTTEN_S = 30.0
REPEATED_WITHIN_S = 2.0
REPEATED_WITHIN = 128
"""A packet with the number and content of one that came at most so many packets and seconds before (over another way,
or the same one) is the same packet."""
SAME_PACKETS = 5
SAME_WITHIN_S = 5.0
WAY_ANSWERS = frozenset({"TIMESYNC", "AUTOPILOT_VERSION"})
"""Messages for `Way.hear`."""
MAX_COMPONENTS = 1024
"""Senders that are kept apart; a stranger who makes more of them up is not listened to."""


@dataclass(frozen=True)
class WayInfo:
    """One way to a vehicle, for people.

    Attributes:
        url: of the link.
        peer: address of the other end.
        used: whether messages are sent this way.
        loss: share of the packets that got lost on it lately; None when unknown, or when it is the only way.
        round_trip_s: from a question to its answer; None when unknown.
        age_s: since the last packet on it.
        signing: how its link's signing goes; None when it is not signed.
    """

    url: str
    peer: str
    used: bool
    loss: float | None
    round_trip_s: float | None
    age_s: float
    signing: SigningStatus | None = None


def unit_number(version: Message) -> str | None:
    """The number of the unit that sent an AUTOPILOT_VERSION, in hex; None when it has none."""
    long_number = bytes(version.uid2).rstrip(b"\0")
    return long_number.hex() or (f"{version.uid:016x}" if version.uid else None)


class Way:
    """One way to a component, with what is known of its quality."""

    __slots__ = (
        "better_since_s",
        "clock_read_s",
        "heard_s",
        "link",
        "meter",
        "number",
        "peer",
        "round_trips",
        "unit",
        "unit_asked",
    )

    def __init__(self, link: Link, peer: Peer, heard_s: float) -> None:
        self.link = link
        self.peer = peer
        self.heard_s = heard_s
        self.number: int | None = None
        """Of its last packet."""
        self.clock_read_s = float("-inf")
        """When the vehicle's clock was last read out of one of its messages."""
        self.meter = SequenceMeter()
        self.round_trips = RoundTripMeter()
        self.better_since_s: float | None = None
        self.unit: str | None = None
        self.unit_asked = 0

    def ask(self, target: Component, now_s: float) -> None:
        """Measure its round trip, and ask who is at its end; for the ways of an autopilot that has several."""
        self.peer.send(mavlink.MAVLink_timesync_message(0, self.round_trips.ask(now_s)))
        if self.unit is None and self.unit_asked < UNIT_ASKED:
            self.unit_asked += 1
            version = request_call(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
            self.peer.send(command_long(version, target, 0))

    def hear(self, message: ReceivedMessage, now_s: float) -> None:
        """Take the answers to these questions, and nothing else."""
        kind = message.get_type()
        if kind == "TIMESYNC" and message.tc1 != 0:
            self.round_trips.answered(int(message.ts1), now_s)
        elif kind == "AUTOPILOT_VERSION":
            self.unit = unit_number(message)

    def exchange_s(self, now_s: float) -> float:
        """How long a question and its answer take on average until neither is lost; infinite when it is silent."""
        if now_s - self.heard_s > SILENT_S:
            return float("inf")
        loss = min(self.meter.quality(now_s).loss or 0.0, 0.99)
        round_trip_s = self.round_trips.median_s(now_s)
        return (UNKNOWN_ROUND_TRIP_S if round_trip_s is None else round_trip_s) / (1.0 - loss) ** 2

    def info(self, now_s: float, *, used: bool) -> WayInfo:
        """For people."""
        loss, round_trip_s = self.meter.quality(now_s).loss, self.round_trips.median_s(now_s)
        signing = None if self.link.signing is None else self.link.signing.status()
        return WayInfo(self.link.url, self.peer.name, used, loss, round_trip_s, now_s - self.heard_s, signing)


@dataclass(slots=True)
class _Packet:
    content: int
    count: int
    at_s: float
    peer: Peer
    taken: bool


class _Heard:
    """The last packets of one component, by their numbers."""

    def __init__(self) -> None:
        self._count = 0
        self._packets: list[_Packet | None] = [None] * 256

    def numbered(self, sequence: int, now_s: float) -> _Packet | None:
        """The packet that lately had this number."""
        packet = self._packets[sequence]
        if packet is None or self._count - packet.count >= REPEATED_WITHIN or now_s - packet.at_s > REPEATED_WITHIN_S:
            return None
        return packet

    def keep(self, sequence: int, content: int, now_s: float, peer: Peer, *, taken: bool) -> None:
        """Remember a packet."""
        self._count += 1
        self._packets[sequence] = _Packet(content, self._count, now_s, peer, taken)


class Routes:
    """The ways of all components that are heard.

    Args:
        on_change: told of a component when its best way becomes another one.
    """

    def __init__(self, on_change: Callable[[Component, Way], None]) -> None:
        self._on_change = on_change
        self._ways: dict[Component, tuple[Way, ...]] = {}
        self._heard: dict[Component, _Heard] = {}
        self._same: dict[int, deque[float]] = {}

    def best(self, component: Component) -> Way | None:
        """The way to a component; None when it was never heard."""
        ways = self._ways.get(component)
        return ways[0] if ways else None

    def ways(self, component: Component) -> tuple[Way, ...]:
        """All ways to a component, the best one first."""
        return self._ways.get(component, ())

    def heard(self, peer: Peer) -> bool:
        """Whether the best way of any component leads to a peer."""
        return any(ways[0].peer is peer for ways in self._ways.values())

    def hear(self, link: Link, peer: Peer, component: Component, now_s: float) -> Way | None:
        """The way on which a message of a component came just now.

        None when the link may not speak for it: an unsigned one may not, where the component is heard on a signed one;
        and nobody new may, while there are too many.
        """
        ways = self._ways.get(component, ())
        if ways and ways[0].peer is peer:
            ways[0].heard_s = now_s
            return ways[0]
        if not ways:
            if len(self._ways) >= MAX_COMPONENTS and not self._make_room(now_s):
                return None
        elif link.signing is None and ways[0].link.signing is not None:
            return None
        way = next((way for way in ways if way.peer is peer), None)
        if way is None:
            way = Way(link, peer, now_s)
            self._ways[component] = (*ways, way)
        way.heard_s = now_s
        return way

    def take(self, component: Component, way: Way, message: ReceivedMessage, now_s: float) -> bool:
        """Whether a message that was heard on a way is to be taken.

        Not when it is a repetition, or comes on a way that is not listened to.
        """
        ways = self._ways[component]
        if len(ways) == 1:
            return True
        sequence, content = message.running_number, hash(message.packet)
        way.meter.count(component[1], sequence, now_s)
        heard = self._heard.setdefault(component, _Heard())
        earlier = heard.numbered(sequence, now_s)
        if earlier is not None and self._is_repeated(earlier, content, component[0], way.peer):
            return False
        if way is not ways[0] and now_s - ways[0].heard_s > SILENT_S:
            self._prefer(component, way)
        taken = way is self._ways[component][0] or self.carry_the_same(component[0], now_s)
        heard.keep(sequence, content, now_s, way.peer, taken=taken)
        return taken

    def _is_repeated(self, earlier: _Packet, content: int, system_id: int, peer: Peer) -> bool:
        """Whether a packet was taken before; learns from it whether the ways carry the same packets."""
        same = earlier.content == content
        if earlier.peer is peer:
            return same and earlier.taken
        if same:
            self._same.setdefault(system_id, deque(maxlen=SAME_PACKETS)).append(earlier.at_s)
        else:  # two packets with one number: two counts
            self._same.pop(system_id, None)
        return same and earlier.taken

    def carry_the_same(self, system_id: int, now_s: float) -> bool:
        """Whether the ways of a system carry the same packets."""
        same = self._same.get(system_id)
        return same is not None and len(same) == SAME_PACKETS and now_s - same[0] < SAME_WITHIN_S

    def compare(self, now_s: float) -> None:
        """Change to better ways and forget dead ones; to be called about once a second."""
        for component, ways in list(self._ways.items()):
            if len(ways) == 1:
                continue
            best, *others = ways
            others = [way for way in others if now_s - way.heard_s < FORGOTTEN_S]
            self._ways[component] = (best, *others)
            if not others:
                self._heard.pop(component, None)
            for way in others:
                if way.exchange_s(now_s) > CLEARLY * best.exchange_s(now_s) - MARGIN_S:
                    way.better_since_s = None
                elif way.better_since_s is None:
                    way.better_since_s = now_s
                elif now_s - way.better_since_s >= BETTER_FOR_S:
                    self._prefer(component, way)
                    break

    def drop(self, gone: Callable[[Way], bool]) -> None:
        """Forget ways, of a link that was closed, or that are not to be used."""
        for component, ways in list(self._ways.items()):
            left = tuple(way for way in ways if not gone(way))
            if not left:
                self._forget(component)
                continue
            changed = left[0] is not ways[0]
            self._ways[component] = left
            if changed:
                self._on_change(component, left[0])

    def _make_room(self, now_s: float) -> bool:
        for component, ways in list(self._ways.items()):
            if now_s - ways[0].heard_s > FORGOTTEN_S:
                self._forget(component)
        return len(self._ways) < MAX_COMPONENTS

    def _forget(self, component: Component) -> None:
        del self._ways[component]
        self._heard.pop(component, None)

    def _prefer(self, component: Component, way: Way) -> None:
        ways = self._ways[component] = (way, *(other for other in self._ways[component] if other is not way))
        for each in ways:
            each.better_since_s = None
        self._on_change(component, way)
