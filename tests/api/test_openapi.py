import json
from pathlib import Path

from gcs.api.openapi import openapi_text
from gcs.api.schemas.live import LiveMessage

COMMITTED = Path(__file__).resolve().parents[2] / "web" / "openapi.json"


def test_the_document_that_the_dashboard_is_built_from_is_current():
    assert COMMITTED.read_text() == openapi_text(), "run: python -m gcs.api.openapi > web/openapi.json"


def test_errors_are_problem_documents():
    document = json.loads(openapi_text())
    for operations in document["paths"].values():
        for operation in operations.values():
            content = operation["responses"]["default"]["content"]
            assert content == {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}


def test_every_reference_leads_somewhere():
    text = openapi_text()
    names = json.loads(text)["components"]["schemas"].keys()
    named = {part.split('"')[0] for part in text.split("#/components/schemas/")[1:]}
    assert named <= names


def test_every_live_message_is_told_apart_by_its_type():
    document = json.loads(openapi_text())
    mapping = document["components"]["schemas"]["LiveMessage"]["discriminator"]["mapping"]
    assert {"snapshot", "telemetry", "job", "flight", "event", "image", "replan", "heartbeat"} <= mapping.keys()
    assert type(LiveMessage.model_validate({"type": "heartbeat", "at": "now"}).root).__name__ == "HeartbeatMessage"
