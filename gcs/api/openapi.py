"""Writes the OpenAPI document: `python -m gcs.api.openapi > web/openapi.json`."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path


def openapi_text() -> str:
    """The document as it is kept beside the dashboard, which generates its types from it."""
    from gcs.api.app import create_app
    from gcs.api.settings import StationSettings

    with tempfile.TemporaryDirectory() as folder:
        document = create_app(StationSettings(data_dir=Path(folder))).openapi()
    return json.dumps(document, indent=1, sort_keys=False, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    sys.stdout.write(openapi_text())
