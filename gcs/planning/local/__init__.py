"""Local planning on board: ways round what is not in the plan's scene, and back to the planned trajectory."""
