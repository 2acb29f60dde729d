"""Options that several commands have, and how a command waits for what takes time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from collections.abc import Coroutine

T = TypeVar("T")

connect_option = click.option(
    "--connect",
    "url",
    required=True,
    metavar="URL",
    help="udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD.",
)
data_option = click.option(
    "--data",
    "data_dir",
    type=click.Path(path_type=Path, file_okay=False),
    envvar="GCS_DATA",
    help="Where flights, plans and images are kept. [default: ~/.local/share/gcs]",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object last.")
vehicle_option = click.option("--vehicle", required=True, metavar="NAME", help="The vehicle's name, such as px4-1.")


def run(job: Coroutine[Any, Any, T]) -> T:
    """Wait for it on an event loop of its own."""
    import asyncio

    return asyncio.run(job)
