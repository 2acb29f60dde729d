from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.framing import FrameParser
from gcs.mavlink.routing import FORGOTTEN_S, MAX_COMPONENTS, SILENT_S, Routes

VEHICLE = (1, 1)


class Sender:
    """Packs a vehicle's messages with numbers of its own."""

    def __init__(self, system_id=1):
        self.codec = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=1)

    def say(self, text):
        raw = mavlink.MAVLink_statustext_message(6, text.encode(), 0, 0).pack(self.codec)
        self.codec.seq = (self.codec.seq + 1) % 256
        [message] = FrameParser().feed(raw)
        return message


class FakePeer:
    def __init__(self, name):
        self.name = name
        self.sent = []

    def send(self, message):
        self.sent.append(message)


@pytest.fixture
def routes():
    routes = Routes(lambda component, way: routes.changes.append((component, way.peer.name)))
    routes.changes = []
    return routes


RADIO = SimpleNamespace(url="serial:radio:57600", signing=None)
LTE = SimpleNamespace(url="udpin:lte:14550", signing=None)
SIGNED = SimpleNamespace(url="udpin:signed:14550", signing=object())


def test_a_router_sends_the_same_packets_over_two_links_and_each_is_taken_once(routes):
    radio, lte, sender = FakePeer("radio"), FakePeer("lte"), Sender()
    taken = []
    for i in range(300):
        message, now = sender.say(f"text {i}"), i * 0.02
        if i % 3:  # the radio loses every third
            taken += [i] if take(routes, RADIO, radio, message, now) else []
        if i % 5:  # LTE loses every fifth, and is late
            taken += [i] if take(routes, LTE, lte, message, now + 0.01) else []
    assert len(taken) == len(set(taken))
    arrived = {i for i in range(300) if i % 3 or i % 5}
    missing = arrived - set(taken)
    assert all(i < 20 for i in missing)  # until it was clear that both carry the same


def test_two_telemetry_ports_number_for_themselves_and_only_one_is_listened_to(routes):
    radio, lte = FakePeer("radio"), FakePeer("lte")
    one, two = Sender(), Sender()
    two.codec.seq = 100
    for i in range(300):
        assert take(routes, RADIO, radio, one.say(f"text {i // 10}"), i * 0.02)
        assert not take(routes, LTE, lte, two.say(f"text {i // 10}"), i * 0.02)
    assert routes.best(VEHICLE).peer is radio
    assert not routes.carry_the_same(1, 6.0)


def test_counters_that_run_in_step_are_not_taken_for_one(routes):
    radio, lte = FakePeer("radio"), FakePeer("lte")
    one, two = Sender(), Sender()
    for i in range(300):  # same numbers; every second text is the same too
        take(routes, RADIO, radio, one.say("fine" if i % 2 else f"radio {i}"), i * 0.02)
        assert not take(routes, LTE, lte, two.say("fine" if i % 2 else f"lte {i}"), i * 0.02)


def test_a_way_that_falls_silent_is_left_at_once(routes):
    radio, lte = FakePeer("radio"), FakePeer("lte")
    one, two = Sender(), Sender()
    two.codec.seq = 100
    for i in range(20):
        take(routes, RADIO, radio, one.say("x"), i * 0.1)
        take(routes, LTE, lte, two.say("x"), i * 0.1)
    silent_from = 2.0
    assert not take(routes, LTE, lte, two.say("x"), silent_from + SILENT_S - 0.2)
    assert take(routes, LTE, lte, two.say("x"), silent_from + SILENT_S)
    assert routes.changes == [(VEHICLE, "lte")]
    assert routes.best(VEHICLE).peer is lte


def take(routes, link, peer, message, now):
    component = (message.from_system, message.from_component)
    way = routes.hear(link, peer, component, now)
    return way is not None and routes.take(component, way, message, now)


def drive(routes, peers, round_trips_s, losses, seconds, start_s=0.0):
    """Both ways are heard and asked; every k-th packet of a way is lost where `losses` says k."""
    senders = {name: Sender() for name in peers}
    for i in range(int(seconds * 20)):
        now = start_s + i * 0.05
        for k, (name, peer) in enumerate(peers.items()):
            message = senders[name].say(f"{name} {i}")
            if losses[name] == 0 or i % losses[name]:
                take(routes, (RADIO, LTE)[k], peer, message, now)
        if i % 20 == 0:
            for way in routes.ways(VEHICLE):
                stamp = way.round_trips.ask(now)
                way.round_trips.answered(stamp, now + round_trips_s[way.peer.name])
            routes.compare(now)


def test_a_clearly_better_way_is_taken_after_some_seconds_and_kept(routes):
    peers = {"radio": FakePeer("radio"), "lte": FakePeer("lte")}
    drive(routes, peers, {"radio": 0.4, "lte": 0.08}, {"radio": 0, "lte": 0}, 3.0)
    assert routes.changes == []
    drive(routes, peers, {"radio": 0.4, "lte": 0.08}, {"radio": 0, "lte": 0}, 6.0, 3.0)
    assert routes.changes == [(VEHICLE, "lte")]
    drive(routes, peers, {"radio": 0.07, "lte": 0.08}, {"radio": 0, "lte": 0}, 30.0, 9.0)
    assert routes.changes == [(VEHICLE, "lte")]  # a little better is not better


def test_loss_counts_as_much_as_time(routes):
    peers = {"radio": FakePeer("radio"), "lte": FakePeer("lte")}
    drive(routes, peers, {"radio": 0.15, "lte": 0.2}, {"radio": 2, "lte": 0}, 15.0)
    assert routes.best(VEHICLE).peer.name == "lte"
    used, other = (way.info(15.0, used=way is routes.best(VEHICLE)) for way in routes.ways(VEHICLE))
    assert (used.peer, used.used, used.loss) == ("lte", True, 0.0)
    assert (other.peer, other.used, other.loss) == ("radio", False, pytest.approx(0.5, abs=0.02))


def test_ways_of_a_closed_link_are_dropped(routes):
    radio, lte, sender = FakePeer("radio"), FakePeer("lte"), Sender()
    take(routes, RADIO, radio, sender.say("a"), 0.0)
    take(routes, LTE, lte, sender.say("b"), 0.1)
    routes.drop(lambda way: way.link is RADIO)
    assert routes.changes == [(VEHICLE, "lte")]
    routes.drop(lambda way: way.link is LTE)
    assert routes.best(VEHICLE) is None


def test_made_up_senders_do_not_eat_the_memory_and_are_forgotten(routes):
    peer = FakePeer("stranger")
    for system in range(1, 256):
        for component in range(1, 256):
            codec = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
            if system * component > 5000:
                break
            [message] = FrameParser().feed(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(codec))
            take(routes, LTE, peer, message, 1.0)
    assert len(routes._ways) == MAX_COMPONENTS
    assert not take(routes, RADIO, FakePeer("radio"), Sender(254).say("x"), 1.0 + FORGOTTEN_S)
    assert take(routes, RADIO, FakePeer("radio"), Sender(254).say("x"), 1.1 + FORGOTTEN_S)


def test_an_unsigned_link_does_not_speak_for_a_vehicle_on_a_signed_one(routes):
    assert take(routes, SIGNED, FakePeer("signed"), Sender().say("x"), 0.0)
    assert not take(routes, LTE, FakePeer("lte"), Sender().say("y"), 0.0)
    assert len(routes.ways(VEHICLE)) == 1
    assert take(routes, LTE, FakePeer("lte"), Sender(2).say("x"), 0.0)
