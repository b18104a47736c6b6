"""docs/robot.md: its schemas are those of the types, and its rover is one that `new` copies.

DOCS_WRITE=1 in the environment writes the schemas anew. The rovers fly in
tests/system/test_rovers.py.
"""

import json
import os
from pathlib import Path

import pytest

from air_router.messages import (
    AnswerMessage,
    GoalsMessage,
    PathMessage,
    PoseMessage,
    SeekMessage,
    SightingsMessage,
)
from air_router.start.new import ROVERS
from tests.docs.blocks import ROOT, blocks

SCHEMAS = ROOT / "docs" / "schemas"
MESSAGES = {
    "pose": PoseMessage,
    "path": PathMessage,
    "sightings": SightingsMessage,
    "seek": SeekMessage,
    "goals": GoalsMessage,
    "answer": AnswerMessage,
}


@pytest.mark.parametrize("name", MESSAGES)
def test_a_schema_is_current(name):
    path, text = SCHEMAS / f"{name}.json", json.dumps(MESSAGES[name].model_json_schema(), indent=1)
    if os.environ.get("DOCS_WRITE"):
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"{text}\n", encoding="utf-8")
    assert path.read_text(encoding="utf-8") == f"{text}\n", (
        "a message has changed: write its schema anew with DOCS_WRITE=1 pytest tests/docs"
    )


def test_the_page_shows_a_rover_that_is_copied_and_names_the_others():
    folder = Path(ROOT, "air_router", "start")
    programs = {file: (folder / file).read_text(encoding="utf-8") for file in ROVERS.values()}
    shown = [block.text for block in blocks() if block.name.startswith("robot.md python")]
    assert shown == [programs[ROVERS["json"]]]
    text = (ROOT / "docs" / "robot.md").read_text(encoding="utf-8")
    assert all(f"`{file}`" in text for file in programs if file != ROVERS["json"])
    assert all(len(program.splitlines()) <= 27 for program in programs.values())
