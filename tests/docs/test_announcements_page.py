"""Every warning and alarm has an instruction, and stands in docs/watching.md."""

import ast

from air_router.vehicle.px4.mavlink_values import STATUSTEXT_BYTES
from tests.docs.announcements_page import KNOWN, ROOT, name_of, rows, table
from tests.printed import assert_printed

FILES = sorted((ROOT / "air_router").rglob("*.py"))


def calls(path):
    tree = ast.parse(path.read_text("utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.Call)]


def test_the_table_is_current():
    assert_printed("watching.md", "announcements", table())


def test_instructions_are_made_in_one_place():
    """So that mypy finds a warning without one: `warn` and `alarm` take nothing else."""
    makers = {path for path in FILES for call in calls(path) if name_of(call.func) == "Instruction"}
    assert makers == {ROOT / "air_router" / "vehicle" / "instructions.py"}
    assert len(KNOWN) > 20
    for text in KNOWN.values():
        assert text.startswith(("Pilot: ", "Operator: "))
        assert len(text) > len("Operator: ")
        assert len(text.encode()) <= 2 * STATUSTEXT_BYTES  # read aloud while it happens


def test_an_announcement_that_requires_something_has_an_instruction():
    """Where one is made without `warn` or `alarm`: it is INFO, or it has an instruction."""
    context = ROOT / "air_router" / "controller" / "model" / "mission_context.py"
    for path in FILES:
        for call in calls(path):
            if name_of(call.func) == "Announce" and path != context:
                assert not call.keywords, path
                is_typed = len(call.args) > 2 and name_of(call.args[2]) in {"instruction", *KNOWN}
                assert len(call.args) == 1 or is_typed, path


def test_every_instruction_is_in_the_table_and_every_warning_has_one():
    found = rows()
    listed = {row.instruction for row in found}
    assert {name for name, text in KNOWN.items() if text not in listed} == set()
    assert {row.severity.split(";")[0] for row in found} == {"warning", "alarm"}
    assert [row for row in found if row.text.strip("… :") == ""] == []


def test_every_warning_is_handed_an_instruction_that_is_typed_so():
    """A cast, or a type that mypy ignores, would get around it."""
    makers, owners = {"warn", "alarm", "alarm_until_over"}, {"self", "context"}
    for path in FILES:
        for call in calls(path):
            owner = name_of(getattr(call.func, "value", call.func)).strip("_")
            if name_of(call.func) in makers and owner in owners:
                assert isinstance(call.args[-1], ast.Name | ast.Attribute), f"{path}:{call.lineno}"
