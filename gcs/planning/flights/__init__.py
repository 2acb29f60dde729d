"""A tour shared between batteries and vehicles, and the ways home."""
