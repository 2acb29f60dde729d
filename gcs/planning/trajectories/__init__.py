"""Smooth curves within limits: minimum snap, corridors, times, and what is sampled from them."""
