"""The tables that decide on telemetry are printed in the docs."""

from air_router.controller.telemetry_handler import FINDINGS, STEPS
from tests.printed import assert_printed


def findings():
    yield "| | condition | response | why here |"
    yield "|---|---|---|---|"
    for finding in FINDINGS:
        yield f"| `{finding.name}` | {finding.shows} | {finding.does} | {finding.why} |"


def steps():
    yield "| step | what it does | it blocks the steps below if | why here |"
    yield "|---|---|---|---|"
    for step in STEPS:
        what = step.waits.__doc__.splitlines()[0].removesuffix(".")
        yield f"| `{step.name}` | {what} | {step.when or '-'} | {step.why} |"


def test_the_tables_in_the_docs_are_those_that_decide():
    assert_printed("state-machine.md", "findings", findings())
    assert_printed("state-machine.md", "steps", steps())


def test_each_row_has_the_reason_of_its_place():
    assert all(row.why for row in (*FINDINGS, *STEPS))
    assert len({row.name for row in (*FINDINGS, *STEPS)}) == len(FINDINGS) + len(STEPS)
