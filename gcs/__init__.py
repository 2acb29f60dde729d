"""gcs: a MAVLink ground station that plans, proves, flies and accounts for structure inspections."""

__version__ = "0.3.0"
