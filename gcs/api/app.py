"""The station as an ASGI application: doors, routes, live stream, dashboard."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic import TypeAdapter
from starlette.staticfiles import StaticFiles

import gcs
from gcs.api import live
from gcs.api.doors import Doors
from gcs.api.pages import pages_router
from gcs.api.problems import MEDIA_TYPE, add_problem_handlers
from gcs.api.routes import flights, images, offers, plans, status, structures, vehicles
from gcs.api.schemas.base import Problem
from gcs.api.schemas.live import LiveMessage
from gcs.api.session_token import session_token
from gcs.api.settings import StationSettings
from gcs.services.station import StationServices
from gcs.storage.data_directory import make_data_directory


def default_services(settings: StationSettings) -> StationServices:
    """The services of a real station."""
    return StationServices(settings.data_dir, links=settings.links)


def create_app(settings: StationSettings, services: StationServices | None = None) -> FastAPI:
    """Build the application.

    Its lifespan opens and closes the services; a server that opens them itself runs it without lifespan.

    Args:
        settings: of the station. `port` must be the one that it really listens on.
        services: what the routes work with; those of a real station by default.

    Raises:
        StorageError: the data directory cannot be used.
    """
    used = services or default_services(settings)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        del app
        async with used.running(live.render_live):
            yield

    make_data_directory(settings.data_dir)
    token = session_token(settings.data_dir)
    app = FastAPI(
        title="gcs",
        version=gcs.__version__,
        description="Ground station: plans, proves, flies and accounts for structure inspections.",
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        openapi_url="/api/openapi.json",
    )
    app.state.services = used
    add_problem_handlers(app)
    for group in (status, structures, plans, vehicles, flights, images, offers):
        app.include_router(group.router, prefix="/api", responses={"default": {"model": Problem}})
    app.include_router(live.router, prefix="/api")
    app.include_router(pages_router(settings, token))
    app.mount("/", StaticFiles(directory=settings.dashboard_dir, check_dir=False))
    app.add_middleware(Doors, settings=settings, token=token)
    app.openapi = lambda: openapi_document(app)  # type: ignore[method-assign]  # as FastAPI's documentation has it
    return app


def openapi_document(app: FastAPI) -> dict[str, Any]:
    """The OpenAPI document, with problem documents as errors and the live stream's messages among the components."""
    if app.openapi_schema:
        return app.openapi_schema
    document = get_openapi(
        title=app.title, version=app.version, description=app.description, routes=app.routes, openapi_version="3.1.0"
    )
    for path in document["paths"].values():
        for operation in path.values():
            error = operation["responses"]["default"]
            error["description"] = "What went wrong."
            error["content"] = {MEDIA_TYPE: error["content"].pop("application/json")}
    components: dict[str, Any] = document["components"]["schemas"]
    messages = TypeAdapter(LiveMessage).json_schema(mode="serialization", ref_template="#/components/schemas/{model}")
    for name, schema in messages.pop("$defs").items():
        components.setdefault(name, schema)
    components["LiveMessage"] = messages
    document["components"]["schemas"] = dict(sorted(components.items()))
    app.openapi_schema = document
    return document
