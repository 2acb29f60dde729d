"""What stands there, how far away it is, what can be seen past it, and where a vehicle may be."""
