"""Safety rule 10: who may call the station.

Every request must name this station in its Host header (a page that was led here by a forged DNS answer names another),
must come from a page of this station when it says where it comes from (Origin), and needs the session token under
/api. The token is taken from the session cookie or the Authorization header, never from the URL.
"""

from __future__ import annotations

import ipaddress
from http.cookies import CookieError, SimpleCookie
from typing import TYPE_CHECKING

from starlette.datastructures import Headers, MutableHeaders

from gcs.api.problems import problem
from gcs.api.session_token import COOKIE, same_token
from gcs.api.settings import LOOPBACK_NAMES

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

    from gcs.api.settings import StationSettings

PAGE_CSP = "default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; object-src 'none'"
REPORT_CSP = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'; sandbox"
API = "/api"


def split_host(value: str) -> tuple[str, int] | None:
    """Name and port of a Host header (port 80 when it names none); None when it is malformed."""
    name, port = value, "80"
    if value.startswith("["):
        name, bracket, rest = value[1:].partition("]")
        if not bracket or (rest and not rest.startswith(":")):
            return None
        port = rest[1:] if rest else port
    elif ":" in value:
        name, _, port = value.partition(":")
    if not name or not (port.isascii() and port.isdecimal()) or len(port) > 5:
        return None
    return name.lower().rstrip("."), int(port)


class Doors:
    """Checks every request and WebSocket before the application sees it, and adds the pages' security headers.

    Args:
        app: the application behind the doors.
        settings: of the station: its host and port.
        token: the session token.
    """

    def __init__(self, app: ASGIApp, settings: StationSettings, token: str) -> None:
        self._app = app
        self._settings = settings
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let through or refuse."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, self._with_headers(send) if scope["type"] == "http" else send)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": refusal[1]})
        else:
            status, detail, field = refusal
            title = "No session" if status == 401 else "Refused"
            response = problem(status, title, detail, scope["path"], field)
            if status == 401:
                response.headers["WWW-Authenticate"] = "Bearer"
            await response(scope, receive, send)

    def _refusal(self, scope: Scope) -> tuple[int, str, str] | None:
        headers = Headers(scope=scope)
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self._is_own_host(hosts[0], scope):
            return 403, "the request names another host than this station", "Host"
        origins = headers.getlist("origin")
        if origins and origins != [f"http://{hosts[0]}"]:
            return 403, "a page of another origin may not call this station", "Origin"
        path = scope["path"]
        if path != API and not path.startswith(f"{API}/"):
            return None
        if not any(same_token(given, self._token) for given in _given_tokens(headers)):
            detail = "open the dashboard first, or send the token of the data directory as `Authorization: Bearer`"
            return 401, detail, "Authorization"
        return None

    def _is_own_host(self, value: str, scope: Scope) -> bool:
        host = split_host(value)
        if host is None or host[1] != self._settings.port:
            return False
        name = host[0]
        if name in {*LOOPBACK_NAMES, self._settings.host.lower()}:
            return True
        # When it listens on all addresses, the address that was really called is its own; a name could be forged.
        server = scope.get("server")
        return self._settings.host in {"0.0.0.0", "::"} and server is not None and _same_address(name, server[0])

    @staticmethod
    def _with_headers(send: Send) -> Send:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.setdefault("Content-Security-Policy", PAGE_CSP)
                headers.setdefault("X-Content-Type-Options", "nosniff")
                headers.setdefault("Referrer-Policy", "no-referrer")
                headers.setdefault("Cross-Origin-Resource-Policy", "same-origin")
                headers.setdefault("Cross-Origin-Opener-Policy", "same-origin")
            await send(message)

        return send_with_headers


def _given_tokens(headers: Headers) -> list[str]:
    tokens = []
    kind, _, value = headers.get("authorization", "").partition(" ")
    if kind.lower() == "bearer":
        tokens.append(value.strip())
    try:
        cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        cookie = None
    if cookie is not None:
        tokens.append(cookie.value)
    return tokens


def _same_address(a: str, b: str) -> bool:
    try:
        return ipaddress.ip_address(a) == ipaddress.ip_address(b)
    except ValueError:
        return False
