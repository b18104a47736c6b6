"""docs/records.md: the schemas that it links are those of the types that records are made of.

DOCS_WRITE=1 in the environment writes the schemas anew. Where one changes so that records of before
cannot be read any more, `SCHEMA_VERSION` counts on.
"""

import json
import os

import pytest

from air_router.controller.flight_status import FlightStatus
from air_router.controller.model.actions import Action
from air_router.controller.model.events import Event
from air_router.record.serialization import SCHEMA_VERSION, json_schema
from tests.docs.blocks import ROOT

SCHEMAS = {
    "record-events": ("Record events", Event),
    "record-actions": ("Record actions", Action),
    "flight-status": ("Flight status", FlightStatus),
}


@pytest.mark.parametrize("name", SCHEMAS)
def test_a_schema_is_current(name):
    path = ROOT / "docs" / "schemas" / f"{name}.json"
    text = json.dumps(json_schema(*SCHEMAS[name]), indent=1)
    if os.environ.get("DOCS_WRITE"):
        path.write_text(f"{text}\n", encoding="utf-8")
    assert path.read_text(encoding="utf-8") == f"{text}\n", (
        "what is recorded has changed: write its schema anew with DOCS_WRITE=1 pytest tests/docs"
    )


def test_the_page_links_each_schema_and_names_the_version():
    text = (ROOT / "docs" / "records.md").read_text(encoding="utf-8")
    assert all(f"(schemas/{name}.json)" in text for name in SCHEMAS)
    assert f"version {SCHEMA_VERSION}" in text
