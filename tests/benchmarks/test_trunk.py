from textwrap import dedent

import pytest

from benchmarks.trunk import DEFINED, ROOT, measured

FILES = {
    "geo/__init__.py": "",
    "geo/frame.py": "",
    "air_router/__init__.py": "",
    "air_router/controller/__init__.py": "",
    "air_router/controller/limits.py": "STOP_S = 4.0\n",
    "air_router/controller/gate.py": """
        from air_router.vehicle.port import Telemetry
        from geo.frame import Point

        RETRY_S, NAME = 3.0, "gate"
        FAR_M = 5.0


        class Gate:
            def __init__(self, context):
                self.context, self.last = context, None

            def send(self, motion):
                self.last = motion
                self.context.pending = motion
        """,
    "air_router/controller/context.py": """
        from dataclasses import dataclass


        @dataclass
        class MissionContext:
            pending: object = None
            state: str = ""

            def enter(self, state):
                self.state = state
                self.pending = None
        """,
    "air_router/vehicle/__init__.py": "",
    "air_router/vehicle/port.py": """
        from dataclasses import dataclass


        @dataclass(frozen=True)
        class Telemetry:
            pending: object = None
        """,
}


@pytest.fixture
def figures(tmp_path):
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(dedent(text))
    return measured(tmp_path)


def test_an_attribute_changes_that_is_assigned_after_construction(figures):
    assert figures["classes"] == {
        "Gate": {"attributes": 1, "several_writers": 0, "files": 1},
        "MissionContext": {"attributes": 2, "several_writers": 1, "files": 2},
    }
    assert figures["assigned_from_outside"] == 1


def test_rooms_are_entered_past_their_doors_and_numbers_stand_outside_limits(figures):
    assert figures["names_past_doors"] == 1  # a package's root has modules that are doors
    assert figures["numbers"] == {"air_router/controller/gate.py": 1}


@pytest.mark.parametrize("number", DEFINED)
def test_a_number_that_tunes_nothing_is_there(number):
    path, _, name = number.partition(":")
    assert f"\n{name}" in (ROOT / path).read_text("utf-8")
