import random
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import InputError, LinkError, RefusedError
from gcs.mavlink.parameter_protocol import WINDOW, ParameterRead, ParameterSet
from gcs.mavlink.parameter_values import decode_parameter, encode_parameter

REAL32, INT32 = mavlink.MAV_PARAM_TYPE_REAL32, mavlink.MAV_PARAM_TYPE_INT32


def float_of_int(value):
    return struct.unpack("<f", struct.pack("<i", value))[0]


class ParameterServer:
    """A vehicle's parameters; PX4's whole numbers are bytes in the float, ArduPilot's are cast."""

    def __init__(self, values, *, bytewise, loss=0.0, stubborn=()):
        self.values, self.bytewise, self.loss, self.stubborn = dict(values), bytewise, loss, stubborn
        self.rng = random.Random(8)
        self.now = 0.0
        self.queue = []
        self.most_in_flight = 0

    def send(self, message):
        if self.rng.random() >= self.loss:
            self.queue.append(message)

    def answers(self):
        asked, self.queue = self.queue, []
        self.most_in_flight = max(self.most_in_flight, len(asked))
        for sent in asked:
            # over the wire, as the vehicle would see it
            raw = sent.pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190))
            message = mavlink.MAVLink(None).parse_buffer(raw)[0]
            name = message.param_id
            if name not in self.values:
                continue
            value = self.values[name]
            if message.get_type() == "PARAM_SET" and name not in self.stubborn:
                if isinstance(value, int):
                    wire = message.param_value
                    value = struct.unpack("<i", struct.pack("<f", wire))[0] if self.bytewise else int(wire)
                else:
                    value = message.param_value
                self.values[name] = value
            whole = isinstance(value, int)
            wire = float_of_int(value) if whole and self.bytewise else float(value)
            answer = mavlink.MAVLink_param_value_message(name.encode(), wire, INT32 if whole else REAL32, 900, 1)
            raw = answer.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
            if self.rng.random() >= self.loss:
                yield mavlink.MAVLink(None).parse_buffer(raw)[0]

    def drive(self, transaction):
        transaction.start()
        while not transaction.finished:
            for message in list(self.answers()):
                transaction.handle(message)
            if not transaction.finished and not self.queue:
                self.now = max(self.now, transaction.deadline)
                transaction.on_time()
        return transaction.result()

    def read(self, names):
        reading = ParameterRead(names, target=(1, 1), bytewise=self.bytewise, send=self.send, clock=lambda: self.now)
        return {name: r and r.value for name, r in self.drive(reading).items()}

    def set(self, name, value, kind):
        change = ParameterSet(
            name, value, kind, target=(1, 1), bytewise=self.bytewise, send=self.send, clock=lambda: self.now
        )
        return self.drive(change)


@pytest.mark.parametrize("bytewise", [True, False])
def test_values_of_both_encodings(bytewise):
    server = ParameterServer({"NAV_DLL_ACT": 2, "X_NEG": -7, "BIG": 16_777_217, "MPC_ACC_HOR": 3.25}, bytewise=bytewise)
    read = server.read(["NAV_DLL_ACT", "X_NEG", "MPC_ACC_HOR"])
    assert read == {"NAV_DLL_ACT": 2.0, "X_NEG": -7.0, "MPC_ACC_HOR": 3.25}


def test_bytewise_keeps_whole_numbers_that_a_float_cannot():
    assert ParameterServer({"BIG": 16_777_217}, bytewise=True).read(["BIG"]) == {"BIG": 16_777_217.0}


def test_unknown_names_are_none_in_little_time_because_all_wait_together():
    names = [f"UNKNOWN_{i}" for i in range(20)]
    server = ParameterServer({"KNOWN": 1.0}, bytewise=False)
    read = server.read([*names, "KNOWN"])
    assert read["KNOWN"] == 1.0
    assert all(read[name] is None for name in names)
    assert server.now < 4.0


def test_at_a_fifth_of_loss_everything_is_read_and_the_window_is_kept():
    values = {f"P{i}": float(i) for i in range(100)}
    server = ParameterServer(values, bytewise=False, loss=0.2)
    assert server.read(values) == values
    assert server.most_in_flight <= WINDOW


def test_a_dead_link_is_no_set_of_unknown_parameters():
    with pytest.raises(LinkError):
        ParameterServer({}, bytewise=False, loss=1.0).read(["A", "B"])


def test_a_parameter_error_ends_the_wait_for_a_name():
    reading = ParameterRead(["NOPE"], target=(1, 1), bytewise=True, send=lambda m: None, clock=lambda: 0.0)
    reading.start()
    message = mavlink.MAVLink_param_error_message(255, 190, b"NOPE", -1, 1)
    message._header.srcSystem, message._header.srcComponent = 1, 1
    message.param_id = "NOPE"
    reading.handle(message)
    assert reading.result() == {"NOPE": None}


def test_nothing_to_read():
    assert ParameterServer({}, bytewise=True).read([]) == {}


@pytest.mark.parametrize("bytewise", [True, False])
def test_setting_is_proved_by_the_value_told(bytewise):
    server = ParameterServer({"NAV_DLL_ACT": 0, "SPEED": 5.0}, bytewise=bytewise, loss=0.2)
    assert server.set("NAV_DLL_ACT", 2, INT32) == 2.0
    assert server.set("SPEED", 0.1, REAL32) == pytest.approx(0.1)
    assert server.values["NAV_DLL_ACT"] == 2


def test_a_value_that_is_not_taken_is_refused():
    server = ParameterServer({"SPEED": 5.0}, bytewise=True, stubborn={"SPEED"})
    with pytest.raises(RefusedError, match="keeps 5"):
        server.set("SPEED", 8.0, REAL32)


@pytest.mark.parametrize("value", [2.5, float("nan"), float("inf"), 2**31, 1e39])
def test_values_that_do_not_fit_are_bad_input(value):
    with pytest.raises(InputError):
        encode_parameter("NAV_DLL_ACT", value, INT32, bytewise=True)


def test_bytes_that_look_like_nan_are_numbers_and_real_nan_is_none():
    assert decode_parameter(float_of_int(-1), INT32, bytewise=True) == -1.0
    assert decode_parameter(float("nan"), REAL32, bytewise=True) is None


def test_names_are_checked():
    with pytest.raises(InputError):
        ParameterRead(["A" * 17], target=(1, 1), bytewise=True, send=print, clock=lambda: 0.0)
