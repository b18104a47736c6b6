"""What draws with matplotlib, which the workers that only collect these tests do without."""

import importlib

import pytest


@pytest.fixture(scope="module")
def map_sheet():
    return importlib.import_module("air_router.report.map_sheet")


@pytest.fixture(scope="module")
def draw_mission():
    return importlib.import_module("air_router.report.picture").draw_mission
