"""Collision-free paths between two places."""
