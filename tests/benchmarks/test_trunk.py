import ast
from textwrap import dedent, indent

import pytest

from benchmarks.silence import HANDLER, HANDLES, REQUESTED, silences
from benchmarks.trunk import DEFINED, ROOT, files_of, measured

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


HANDLERS = """
class Gate:
    def _go(self):
        if self.near:
            return self.navigator.fly_to(self.goal)
        self.navigator.fly_to(self.goal)
        return True

    def _announce_once(self):
        if not self.announced:
            self.context.say("once")


class State(StateHandler):
    def begin(self):
"""


@pytest.mark.parametrize(
    ("body", "silent"),
    [
        ("self.navigator.fly_to(self.goal)", []),
        ("self.gate.stop()", ["self.gate.stop()"]),
        ("if self.near:\n    self.context.signal(1)", ["self.context.signal(1)"]),
        ("if self.near:\n    return\nself.context.say('x')", ["return"]),
        ("if self.near:\n    return self.verdict\nself.context.say('x')", []),
        ("if self.near:\n    self.retry()\nelse:\n    self.context.warn('x', Y)", []),
        ("for each in self.goals:\n    self.gate.send(each)", ["self.gate.send(each)"]),
        ("match self.x:\n    case 1:\n        return\n    case _:\n        raise E", ["return"]),
        ("self._go()", []),
        ("self._announce_once()\nreturn None", ["return None"]),
        ("try:\n    self._go()\nexcept E:\n    pass", ["pass"]),
        ("self.context.actions.append(motion)", []),
    ],
)
def test_a_return_is_silent_unless_every_way_to_it_reports_something(body, silent):
    text = HANDLERS + indent(body, " " * 8)
    lines = text.splitlines()
    found = silences({"a.py": ast.parse(text)})
    assert [lines[each.line - 1].strip() for each in found] == silent
    assert {each.function for each in found} <= {"State.begin"}


def test_the_methods_from_which_a_motion_is_requested_exist():
    """Else nothing that it does would be silent."""
    found = {
        node.name: ({each.name for each in node.body if isinstance(each, ast.FunctionDef)}, node)
        for tree in files_of(ROOT).values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }
    assert [name for name, names in REQUESTED.items() if not {*names} <= found[name][0]] == []
    heirs = [node for _, node in found.values() if HANDLER in map(ast.unparse, node.bases)]
    assert len(heirs) > 5
    assert {*HANDLES} <= found[HANDLER][0]
