"""The dashboard's page and files, and the session that comes with the page."""

from __future__ import annotations

import ipaddress
from urllib.parse import parse_qs

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse
from starlette.responses import Response

from gcs.api.session_token import COOKIE, same_token
from gcs.api.settings import StationSettings

MAX_FORM_BYTES = 1000

NOT_BUILT = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>gcs</title></head><body>
<h1>The dashboard is not built</h1>
<p>The station runs, and its API answers under /api. To build the dashboard, run <code>make run</code> (or
<code>npm ci</code> and <code>npm run build</code> in <code>web/</code>) and load this page again.</p>
</body></html>"""

ASK_FOR_TOKEN = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>gcs</title></head><body>
<h1>Session token</h1>
<p>This station is called from another machine. Give the token that it printed at its start.</p>
<form method="post" action="/session"><label>Token <input name="token" type="password" autofocus></label>
<button>Open</button></form></body></html>"""


def pages_router(settings: StationSettings, token: str) -> APIRouter:
    """Routes of the pages.

    Args:
        settings: of the station; the dashboard's folder is looked at with every call.
        token: the session token, given as a cookie with the page to a browser on this machine.
    """
    router = APIRouter(include_in_schema=False)

    def page() -> Response:
        index = settings.dashboard_dir / "index.html"
        if not index.is_file():
            return HTMLResponse(NOT_BUILT, status_code=503)
        return FileResponse(index, headers={"Cache-Control": "no-cache"})

    @router.get("/")
    def dashboard(request: Request) -> Response:
        """The dashboard. From this machine the session comes with it; from elsewhere the token is asked for."""
        if same_token(request.cookies.get(COOKIE), token):
            return page()
        if not _from_this_machine(request):
            return HTMLResponse(ASK_FOR_TOKEN)
        return _with_session(page(), token)

    @router.post("/session")
    async def open_session(request: Request) -> Response:
        """Take the token from the form of a browser on another machine."""
        body = bytearray()
        async for chunk in request.stream():
            body += chunk
            if len(body) > MAX_FORM_BYTES:
                return HTMLResponse(ASK_FOR_TOKEN, status_code=413)
        given = parse_qs(body.decode("utf-8", "replace")).get("token", [""])[0].strip()
        if not same_token(given, token):
            return HTMLResponse(ASK_FOR_TOKEN, status_code=403)
        return _with_session(RedirectResponse("/", status_code=303), token)

    return router


def _with_session(response: Response, token: str) -> Response:
    response.set_cookie(COOKIE, token, httponly=True, samesite="strict", path="/")
    return response


def _from_this_machine(request: Request) -> bool:
    try:
        return request.client is not None and ipaddress.ip_address(request.client.host).is_loopback
    except ValueError:
        return False
