"""What the simulator is told on its command line reaches the vehicles, or is refused."""

import pytest

from gcs.planning.dynamics.wind_gusts import WindGusts
from sitl_mocks.command_line import main
from sitl_mocks.simulator import Simulator, SimulatorOptions


@pytest.mark.parametrize(
    "given",
    [
        ("--gusts", "-1"),
        ("--gusts", "nan"),
        ("--body", "brick"),
        ("--hidden", "1,2,3"),
        ("--parameter-count", "-1"),
        ("--mission-items", "40000"),
        ("--sights", "2,1"),
        ("--sights", "1,1"),
        ("--sights", "one,two"),
    ],
)
def test_wrong_values_are_refused(given, capsys):
    try:
        status = main(["--port", "9", *given])
    except SystemExit as ended:
        status = ended.code
    assert status == 2
    assert given[0] in capsys.readouterr().err


def test_body_and_gusts_reach_the_vehicle():
    options = SimulatorOptions(port=9, tcp_base=None, body="sih", gust_m_s=1.5, wind_m_s=(2.0, 0.0, 0.0))
    simulator = Simulator(options)
    try:
        simulator.open()
        (member,) = simulator._members.values()
        airframe = member.vehicle.airframe
        assert airframe.parameters.drag_n_s_m == (3.0, 3.0, 3.0)
        assert airframe._gusts == WindGusts((2.0, 0.0, 0.0), 1.5)
    finally:
        simulator.close()


def test_counts_and_the_slow_start_reach_the_vehicle():
    options = SimulatorOptions(port=9, tcp_base=None, parameter_count=300, mission_items=20, real_start=True)
    simulator = Simulator(options)
    try:
        simulator.open()
        (member,) = simulator._members.values()
        vehicle = member.vehicle
        assert len(vehicle.parameters.table()) == 300
        assert vehicle.missions._kind.capacity == 20
        assert vehicle.ready_after_s == vehicle.real_ready_after_s
    finally:
        simulator.close()
