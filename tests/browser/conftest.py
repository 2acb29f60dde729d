"""Headless Chromium, the built dashboard, and a station that plays a script."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import pytest
import uvicorn
from playwright.async_api import Browser, Page, async_playwright, expect
from pydantic import BaseModel
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from gcs.api.schemas.live import HeartbeatMessage

CHROMIUM = Path("/usr/bin/chromium")
ROOT = Path(__file__).resolve().parents[2]
DASHBOARD = ROOT / "gcs" / "api" / "dashboard"
CHROMIUM_ARGUMENTS = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-sandbox",
    "--disable-background-networking",
]
PAGE_CSP = "default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; object-src 'none'"
Reply = BaseModel | list[Any] | dict[str, Any] | bytes | Response


def _absent(reason: str) -> NoReturn:
    """Without its tools a browser test is skipped, but never where everything has to run."""
    if os.environ.get("CI"):
        pytest.fail(reason)
    pytest.skip(reason)


@pytest.fixture
def dashboard_dir() -> Path:
    """The built dashboard."""
    if not (DASHBOARD / "index.html").is_file():
        _absent("the dashboard is not built: run `npm ci` and `npm run build` in web/")
    return DASHBOARD


@pytest.fixture
def chromium_path() -> Path:
    """The system's Chromium."""
    if not CHROMIUM.is_file():
        _absent(f"{CHROMIUM} is missing: install the system's chromium")
    return CHROMIUM


@pytest.fixture
async def browser(chromium_path: Path) -> AsyncIterator[Browser]:
    """Chromium with software WebGL."""
    async with async_playwright() as playwright:
        chromium = await playwright.chromium.launch(executable_path=str(chromium_path), args=CHROMIUM_ARGUMENTS)
        yield chromium
        await chromium.close()


@pytest.fixture
async def page(browser: Browser) -> AsyncIterator[Page]:
    """An empty page; what it complains of or loads from elsewhere fails the test."""
    page = await browser.new_page(viewport={"width": 1280, "height": 800})
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda m: faults.append(m.text) if "Content Security Policy" in m.text else None)
    page.on("request", lambda r: faults.append(r.url) if not r.url.startswith(("http://127.0.0.1", "blob:")) else None)
    yield page
    await page.close()
    assert faults == []


@pytest.fixture
def drawn() -> Callable[[Page], Awaitable[None]]:
    """Waits until the 3D view has drawn again."""

    async def wait(page: Page) -> None:
        scene = page.get_by_test_id("scene")
        before = await scene.get_attribute("data-frames") or "0"
        await page.get_by_test_id("fit").click()
        await expect(scene).not_to_have_attribute("data-frames", before)

    return wait


@dataclass
class ScriptedStation:
    """Answers as it is told to and keeps what it was asked; the contract is that of the real one's schemas.

    Attributes:
        replies: `METHOD /path` (below /api) -> what is answered.
        snapshot: the first message of every live stream.
        asked: every call that changes something, as (`METHOD /path`, body).
    """

    dashboard: Path
    snapshot: BaseModel | None = None
    replies: dict[str, Reply] = field(default_factory=dict)
    asked: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    sockets: set[WebSocket] = field(default_factory=set)
    port: int = 0

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    async def _heartbeats(self) -> None:
        while True:
            await asyncio.sleep(1.0)
            await self.push(HeartbeatMessage(at="2026-11-22T10:00:00Z"))

    async def push(self, *messages: BaseModel) -> None:
        """Send live messages to all open dashboards."""
        for message in messages:
            for socket_ in list(self.sockets):
                await socket_.send_text(message.model_dump_json())

    @asynccontextmanager
    async def running(self) -> AsyncIterator[ScriptedStation]:
        """Serve until the block ends; entered again, it serves on the same port."""
        listener = socket.create_server(("127.0.0.1", self.port))
        self.port = listener.getsockname()[1]
        config = uvicorn.Config(self._app(), log_level="error", lifespan="off", timeout_graceful_shutdown=1)
        server = uvicorn.Server(config)
        serving = asyncio.create_task(server.serve([listener]))
        beating = asyncio.create_task(self._heartbeats())
        try:
            yield self
        finally:
            beating.cancel()
            for socket_ in list(self.sockets):
                await socket_.close()
            server.should_exit = True
            await serving
            listener.close()

    def _app(self) -> Starlette:
        methods = ["GET", "POST", "DELETE"]
        return Starlette(
            routes=[
                WebSocketRoute("/api/live", self._live),
                Route("/api/{path:path}", self._rest, methods=methods),
                Route("/", self._page),
                Mount("/", StaticFiles(directory=self.dashboard)),
            ]
        )

    def _page(self, _: Request) -> Response:
        text = (self.dashboard / "index.html").read_text()
        return Response(text, media_type="text/html", headers={"Content-Security-Policy": PAGE_CSP})

    async def _rest(self, request: Request) -> Response:
        key = f"{request.method} /{request.path_params['path']}"
        body = await request.json() if request.method == "POST" else {}
        if request.method != "GET":
            self.asked.append((key, body))
        reply = self.replies.get(key)
        if reply is None:
            return self.problem(404, "Not found", f"{key} is not part of the script")
        if isinstance(reply, Response):
            return reply
        if isinstance(reply, bytes):
            return Response(reply, media_type="image/jpeg" if key.startswith("GET /images") else None)
        if isinstance(reply, BaseModel):
            return Response(reply.model_dump_json(), media_type="application/json")
        return JSONResponse(
            [r.model_dump(mode="json") if isinstance(r, BaseModel) else r for r in reply]
            if isinstance(reply, list)
            else reply
        )

    async def _live(self, websocket: WebSocket) -> None:
        await websocket.accept()
        if self.snapshot is not None:
            await websocket.send_text(self.snapshot.model_dump_json())
        self.sockets.add(websocket)
        try:
            while True:
                await websocket.receive_text()
        except WebSocketDisconnect:
            pass
        finally:
            self.sockets.discard(websocket)

    @staticmethod
    def problem(status: int, title: str, detail: str, about: str | None = None) -> Response:
        """A refusal as the station gives it."""
        body = {
            "type": "about:blank",
            "title": title,
            "status": status,
            "detail": detail,
            "instance": "",
            "field": about,
        }
        return JSONResponse(body, status_code=status, media_type="application/problem+json")


@pytest.fixture
async def station(dashboard_dir: Path) -> ScriptedStation:
    """A scripted station that is not serving yet."""
    return ScriptedStation(dashboard_dir)


@pytest.fixture
def mavlink_port() -> int:
    """A UDP port that nobody uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@asynccontextmanager
async def _process(*arguments: str, ready: str) -> AsyncIterator[str]:
    """A Python process until the block ends; gives the line by which it says that it is ready."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, *arguments, cwd=ROOT, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    assert process.stdout is not None
    said: list[str] = []
    try:
        async with asyncio.timeout(60):
            while not said or ready not in said[-1]:
                line = await process.stdout.readline()
                assert line, "ended early: " + "".join(said)
                said.append(line.decode())
        draining = asyncio.create_task(process.stdout.read())
        yield said[-1]
        draining.cancel()
    finally:
        if process.returncode is None:
            process.terminate()
        await process.wait()


@pytest.fixture
async def real_station(dashboard_dir: Path, tmp_path: Path) -> AsyncIterator[str]:
    """The URL of a station of its own, with an empty data directory."""
    command = "import sys; from gcs.cli import main; main()"
    async with _process("-c", command, "serve", "--port", "0", "--data", str(tmp_path / "data"), ready="ready") as line:
        yield line.rsplit(" ", 1)[-1].strip()


@pytest.fixture
async def simulated_vehicle(mavlink_port: int) -> AsyncIterator[str]:
    """The URL at which a simulated PX4-like vehicle is heard that leaves the path once and reports it."""
    arguments = ["-m", "gcs.cli", "simulate", "--port", str(mavlink_port), "--speedup", "8", "--replan"]
    async with _process(*arguments, ready="ready"):
        yield f"udpin:127.0.0.1:{mavlink_port}"
