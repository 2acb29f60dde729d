from dataclasses import fields

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.vehicle import Telemetry
from gcs.mavlink.autopilots.px4 import Px4
from gcs.mavlink.framing import FrameParser
from gcs.mavlink.newest_telemetry import NewestTelemetry
from gcs.mavlink.packed_traffic import PackedVehicle
from gcs.mavlink.telemetry_decoder import TelemetryDecoder


def heard(message, component=1):
    [received] = FrameParser().feed(message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=component)))
    return received


def attitude(boot_ms, yaw):
    return heard(mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, yaw, 0.0, 0.0, 0.0))


def test_what_is_read_is_what_decoding_each_message_at_once_would_give():
    vehicle, parser = PackedVehicle(1), FrameParser()
    newest, at_once = NewestTelemetry(TelemetryDecoder(Px4())), Telemetry()
    decoder = TelemetryDecoder(Px4())
    for i in range(300):
        [message] = parser.feed(vehicle.message(1000 + 11 * i))
        newest.take(message, float(i), from_autopilot=True)
        at_once = decoder.apply(at_once, message, float(i))
        if i % 37 == 0 or i == 299:
            read = newest.read()
            for field in fields(Telemetry):
                assert repr(getattr(read, field.name)) == repr(getattr(at_once, field.name)), field.name


def test_the_newest_counts_and_reading_twice_gives_the_same_object():
    newest = NewestTelemetry(TelemetryDecoder(Px4()))
    for i in range(5):
        assert newest.take(attitude(1000 + i, 0.1 * i), 10.0 + i, from_autopilot=True)
    read = newest.read()
    assert read.attitude_rad.at_s == 14.0
    assert read.vehicle_time_s.value == 1.004
    assert newest.read() is read


def test_other_components_attitudes_are_of_no_use():
    newest = NewestTelemetry(TelemetryDecoder(Px4()))
    assert not newest.take(attitude(1000, 0.1), 1.0, from_autopilot=False)
    assert newest.read() == Telemetry()


def test_a_message_that_cannot_be_taken_spoils_no_other(caplog):
    decoder = TelemetryDecoder(Px4())
    newest = NewestTelemetry(decoder)

    def fail(message, now_s):
        raise ValueError("no")

    decoder._readers["SYSTEM_TIME"] = fail
    newest.take(heard(mavlink.MAVLink_system_time_message(1, 2)), 1.0, from_autopilot=True)
    newest.take(attitude(1000, 0.1), 1.0, from_autopilot=True)
    assert newest.read().attitude_rad is not None
    assert "SYSTEM_TIME" in caplog.text
