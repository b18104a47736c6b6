"""Missions to edit: copies of the ones that are flown, in YAML and as a plan."""

import shutil
from pathlib import Path

import pytest

from air_router.editor.session import EditSession, MissionFile

ROOT = Path(__file__).parents[3]


@pytest.fixture
def path(tmp_path):
    shutil.copytree(ROOT / "missions" / "pennovation", tmp_path / "pennovation")
    return tmp_path / "pennovation" / "mission.yaml"


@pytest.fixture
def session(path):
    return EditSession(MissionFile(path))


@pytest.fixture
def plan(tmp_path):
    shutil.copy(ROOT / "tests" / "data" / "pennovation.plan", tmp_path)
    return EditSession(MissionFile(tmp_path / "pennovation.plan"))
