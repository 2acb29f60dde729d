"""How a station is set up."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True)
class StationSettings:
    """Settings of one station process.

    Attributes:
        data_dir: where everything that must last is kept.
        host: the address it listens on; loopback unless the operator said otherwise.
        port: its TCP port.
        links: links to open besides those of the database, as URLs.
        dashboard_dir: the built dashboard.
    """

    data_dir: Path
    host: str = "127.0.0.1"
    port: int = 8080
    links: tuple[str, ...] = ()
    dashboard_dir: Path = field(default=Path(__file__).parent / "dashboard")

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach it."""
        return self.host in LOOPBACK_NAMES or self.host.startswith("127.")

    @property
    def url(self) -> str:
        """Where a browser on this machine finds the dashboard."""
        host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(self.host, self.host)
        host = f"[{host}]" if ":" in host and not host.startswith("[") else host
        return f"http://{host}:{self.port}"
