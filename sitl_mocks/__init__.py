"""Simulated vehicles that speak MAVLink: `python -m sitl_mocks --help`.

They share no protocol code with the station, so that a misreading of MAVLink on one side shows on the other.
"""
