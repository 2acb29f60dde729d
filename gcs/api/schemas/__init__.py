"""What the API takes and gives: SI with the unit in the name, angles in degrees, scene positions in ENU metres."""
