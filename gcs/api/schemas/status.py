"""What the station says of itself."""

from __future__ import annotations

from gcs.api.schemas.base import Sent


class Status(Sent):
    """The station in a few words."""

    name: str
    version: str
    started_at: str
    now: str
    data_dir: str
    vehicles: int
    links: int
    jobs_running: int
    flights_open: int
    live_clients: int
