"""The tables that say what follows from a telemetry: in the docs as they decide."""

from air_router.controller.telemetry_handler import FINDINGS, STEPS
from tests.printed import assert_printed


def matters():
    yield "| | condition | reaction | why here |"
    yield "|---|---|---|---|"
    for matter in FINDINGS:
        yield f"| `{matter.name}` | {matter.shows} | {matter.does} | {matter.why} |"


def steps():
    yield "| step | what | the steps below wait while | why here |"
    yield "|---|---|---|---|"
    for step in STEPS:
        what = step.waits.__doc__.splitlines()[0].removesuffix(".")
        yield f"| `{step.name}` | {what} | {step.when or '-'} | {step.why} |"


def test_the_tables_in_the_docs_are_those_that_decide():
    assert_printed("state-machine.md", "matters", matters())
    assert_printed("state-machine.md", "steps", steps())


def test_each_row_says_why_it_stands_where_it_stands():
    assert all(row.why for row in (*FINDINGS, *STEPS))
    assert len({row.name for row in (*FINDINGS, *STEPS)}) == len(FINDINGS) + len(STEPS)
