"""The MAVLink side of the station: the only room that imports pymavlink."""
