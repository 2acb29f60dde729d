"""Errors as RFC 9457 problem documents: one sentence, the field it is about, never a stack trace."""

from __future__ import annotations

import logging
from http import HTTPStatus
from typing import TYPE_CHECKING

from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse

from gcs.core.errors import (
    ConflictError,
    GcsError,
    IncompleteError,
    InfeasibleError,
    InputError,
    LinkError,
    NotFoundError,
    OperationCancelled,
    RefusedError,
    StorageError,
)

if TYPE_CHECKING:
    from fastapi import FastAPI
    from starlette.requests import Request
    from starlette.responses import Response

MEDIA_TYPE = "application/problem+json"
log = logging.getLogger(__name__)

STATUS_OF: tuple[tuple[type[GcsError], int], ...] = (
    (NotFoundError, 404),
    (InputError, 422),
    (InfeasibleError, 422),
    (LinkError, 504),
    (ConflictError, 409),
    (RefusedError, 403),
    (IncompleteError, 409),
    (OperationCancelled, 409),
    (StorageError, 507),
    (GcsError, 500),
)
"""The first that fits counts."""


def problem(status: int, title: str, detail: str, instance: str, field: str | None = None) -> JSONResponse:
    """A problem document as a response."""
    body = {
        "type": f"urn:gcs:problem:{title.lower().replace(' ', '-')}",
        "title": title,
        "status": status,
        "detail": detail,
        "instance": instance,
        "field": field,
    }
    return JSONResponse(body, status_code=status, media_type=MEDIA_TYPE)


def _gcs_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, GcsError)
    status = next(status for kind, status in STATUS_OF if isinstance(error, kind))
    return problem(status, error.title, error.message, request.url.path, error.field)


def _validation_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    errors = error.errors()
    where = [str(part) for part in errors[0]["loc"]]
    field = ".".join(where[1:]) or where[0]
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return problem(422, "Bad input", f"{errors[0]['msg']}{more}", request.url.path, field)


def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    title = HTTPStatus(error.status_code).phrase
    response = problem(error.status_code, title, str(error.detail), request.url.path)
    response.headers.update(error.headers or {})
    return response


def _fault(request: Request, error: Exception) -> Response:
    log.error("fault while answering %s %s", request.method, request.url.path, exc_info=error)
    detail = "the station has a fault; its log says more"
    return problem(500, "Internal fault", detail, request.url.path)


def add_problem_handlers(app: FastAPI) -> None:
    """Answer every error with a problem document."""
    app.add_exception_handler(GcsError, _gcs_error)
    app.add_exception_handler(RequestValidationError, _validation_error)
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(Exception, _fault)
