"""Parameters: the two encodings, unknown names, the list."""

import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import InputError

M = mavlink


def as_int(value):
    return struct.unpack("<i", struct.pack("<f", value))[0]


def test_px4_puts_integers_bytewise_into_the_float(px4):
    value, kind = px4.parameter("NAV_DLL_ACT")
    assert kind == M.MAV_PARAM_TYPE_INT32
    assert as_int(value) == 2
    value, kind = px4.parameter("COM_FLTMODE1")
    assert as_int(value) == -1
    assert px4.parameter("COM_OF_LOSS_T") == (1.0, M.MAV_PARAM_TYPE_REAL32)


def test_ardupilot_casts_integers(ardupilot):
    assert ardupilot.parameter("RTL_ALT") == (1500.0, M.MAV_PARAM_TYPE_INT32)
    assert ardupilot.parameter("FS_GCS_ENABLE") == (1.0, M.MAV_PARAM_TYPE_INT8)
    assert ardupilot.parameter("WPNAV_SPEED") == (1000.0, M.MAV_PARAM_TYPE_REAL32)


def test_unknown_names_get_no_value(either):
    assert either.parameter("NO_SUCH_PARAM") is None
    assert ("unknown param: NO_SUCH_PARAM" in either.texts()) == (either.vehicle.kind == "px4")


def test_setting(either):
    px4 = either.vehicle.kind == "px4"
    name, value, kind = ("RTL_RETURN_ALT", 42.5, 9) if px4 else ("RTL_ALT", 4250.0, 6)
    (answer,) = either.of("PARAM_VALUE", either.send(M.MAVLink_param_set_message(1, 1, name.encode(), value, kind)))
    assert answer.param_value == value
    assert either.vehicle.parameters[name] == value


def test_px4_takes_integers_bytewise_and_refuses_the_wrong_type(px4):
    packed = struct.unpack("<f", struct.pack("<i", 3))[0]
    px4.send(M.MAVLink_param_set_message(1, 1, b"NAV_DLL_ACT", packed, M.MAV_PARAM_TYPE_INT32))
    assert px4.vehicle.parameters["NAV_DLL_ACT"] == 3.0
    px4.send(M.MAVLink_param_set_message(1, 1, b"NAV_DLL_ACT", 1.0, M.MAV_PARAM_TYPE_REAL32))
    assert px4.vehicle.parameters["NAV_DLL_ACT"] == 3.0


def test_px4_clamps_a_speed_of_the_auto_modes_to_the_maximum_with_a_warning(px4):
    """So whoever raises both writes the maximum first."""

    def write(name, value):
        px4.send(M.MAVLink_param_set_message(1, 1, name.encode(), value, M.MAV_PARAM_TYPE_REAL32))
        return px4.vehicle.parameters["MPC_Z_V_AUTO_UP"]

    assert write("MPC_Z_V_AUTO_UP", 8.0) == 5.0
    assert any("MPC_Z_V_AUTO_UP" in text for text in px4.texts())
    write("MPC_Z_VEL_MAX_UP", 8.0)
    assert write("MPC_Z_V_AUTO_UP", 8.0) == 8.0
    assert write("MPC_Z_VEL_MAX_UP", 6.0) == 6.0


def test_the_list_is_complete_and_numbered(either):
    either.send(M.MAVLink_param_request_list_message(1, 1))
    values = either.of("PARAM_VALUE", either.run(1.0))
    assert {v.param_index for v in values} == set(range(values[0].param_count))
    assert len({v.param_id for v in values}) == values[0].param_count


@pytest.mark.parametrize(("kind", "count", "seconds"), [("px4", 908, 0.9), ("ardupilot", 1349, 0.7)])
def test_as_many_as_the_real_one_are_listed_in_its_time(make_ground, kind, count, seconds):
    g = make_ground(kind, parameter_count=count)
    g.send(M.MAVLink_param_request_list_message(1, 1))
    assert 0 < len(g.of("PARAM_VALUE", g.run(0.5 * seconds, heartbeats=False))) < 0.7 * count
    g.run(0.6 * seconds)
    values = g.of("PARAM_VALUE")
    assert [v.param_index for v in values] == list(range(count))
    assert {v.param_count for v in values} == {count}
    assert len({v.param_id for v in values}) == count
    assert g.parameter(values[-1].param_id) is not None


def test_overrides_at_the_start(make_ground):
    g = make_ground("px4", parameters=(("NAV_DLL_ACT", 0.0),))
    assert as_int(g.parameter("NAV_DLL_ACT")[0]) == 0
    with pytest.raises(InputError, match="NOPE"):
        make_ground("px4", parameters=(("NOPE", 1.0),))


def test_the_sample_vehicle_may_fly_five_metres_a_second_in_every_direction(either):
    limits = either.vehicle.base_limits()
    assert min(limits.horizontal_m_s, limits.climb_m_s, limits.descent_m_s) >= 5.0
    assert min(limits.acceleration_m_s2, limits.vertical_acceleration_m_s2) >= 3.0
