"""Runs a station until it is interrupted."""

from __future__ import annotations

import asyncio
import errno
import socket
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.api.session_token import session_token
from gcs.api.settings import StationSettings
from gcs.core.errors import InputError
from gcs.core.garbage import spare_what_is_loaded
from gcs.storage.data_directory import default_data_directory

if TYPE_CHECKING:
    from collections.abc import Callable

    import uvicorn

    from gcs.services.station import StationServices

SHUTDOWN_TIMEOUT_S = 5


def listening_socket(host: str, port: int) -> socket.socket:
    """Take the port; 0 takes any free one.

    Raises:
        InputError: the port is taken, or the address is not one of this machine.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except OSError as error:
        raise InputError(f"{host} is not an address: {error.strerror}", field="--host") from None
    taken = socket.socket(family, kind, protocol)
    try:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind(address)
        taken.listen(128)
    except OSError as error:
        taken.close()
        if error.errno == errno.EADDRINUSE:
            message = f"port {port} is taken by another program: end it, or give another port"
            raise InputError(message, field="--port") from None
        field = "--port" if error.errno == errno.EACCES else "--host"
        raise InputError(f"cannot listen on {host}:{port}: {error.strerror}", field=field) from None
    return taken


async def run_station(
    settings: StationSettings,
    *,
    ready: Callable[[StationSettings], None],
    stop: asyncio.Event | None = None,
    services: StationServices | None = None,
) -> None:
    """Run a station until it is interrupted or `stop` is set.

    Args:
        settings: port 0 takes any free port.
        services: what it works with; those of a real station by default.
        ready: called once with the settings that hold when the station answers.
        stop: ends the station when set.

    Raises:
        InputError: the port is taken.
        GcsError: the station cannot start; the reason.
    """
    import uvicorn

    from gcs.api.app import create_app, default_services
    from gcs.api.live import render_live

    with listening_socket(settings.host, settings.port) as taken:
        settings = replace(settings, port=taken.getsockname()[1])
        services = services or default_services(settings)
        async with services.running(render_live):
            config = uvicorn.Config(
                create_app(settings, services),
                log_level="warning",
                lifespan="off",
                server_header=False,
                ws_max_size=1 << 16,
                timeout_graceful_shutdown=SHUTDOWN_TIMEOUT_S,
            )
            server = uvicorn.Server(config)
            watching = asyncio.create_task(_watch(server, lambda: ready(settings), stop))
            try:
                await server.serve(sockets=[taken])
            finally:
                watching.cancel()
                await asyncio.gather(watching, return_exceptions=True)


async def _watch(server: uvicorn.Server, ready: Callable[[], None], stop: asyncio.Event | None) -> None:
    while not server.started:  # noqa: ASYNC110 - uvicorn tells it in no other way
        await asyncio.sleep(0.02)
    ready()
    if stop is not None:
        await stop.wait()
        server.should_exit = True


def serve(
    host: str,
    port: int,
    data_dir: Path | None,
    *,
    links: tuple[str, ...] = (),
    ready: Callable[[StationSettings], None] | None = None,
) -> None:
    """`gcs serve`: run a station until it is interrupted, and say where it is.

    Args:
        host: address to listen on.
        port: TCP port; 0 takes any free one.
        data_dir: where everything is kept; None for the default.
        links: MAVLink URLs to open besides those kept from earlier runs.
        ready: called when the station answers; by default it is said on standard output.
    """
    settings = StationSettings(data_dir=data_dir or default_data_directory(), host=host, port=port, links=links)

    def up(settings: StationSettings) -> None:
        spare_what_is_loaded()
        (ready or announce)(settings)

    with suppress(KeyboardInterrupt):
        asyncio.run(run_station(settings, ready=up))


def announce(settings: StationSettings) -> None:
    """Say on standard output where the station is."""
    lines = [
        f"gcs is ready: {settings.url}",
        f"data: {settings.data_dir}",
        f"token for scripts and other machines: {session_token(settings.data_dir)}",
    ]
    if not settings.is_loopback:
        lines.append(
            f"{settings.host} can be reached from other machines: they need the token, and nothing is encrypted"
        )
    sys.stdout.write("\n".join(lines) + "\n")
    sys.stdout.flush()
