"""The tables that say what follows from a telemetry: in the docs as they decide."""

from pathlib import Path

from air_router.controller.telemetry_handler import MATTERS, STEPS

PAGE = Path(__file__).parents[3] / "docs" / "state-machine.md"


def matters():
    yield "| | a telemetry shows that | so | why here |"
    yield "|---|---|---|---|"
    for matter in MATTERS:
        yield f"| `{matter.name}` | {matter.shows} | {matter.does} | {matter.why} |"


def steps():
    yield "| step | what | the steps below wait while | why here |"
    yield "|---|---|---|---|"
    for step in STEPS:
        what = step.waits.__doc__.splitlines()[0].removesuffix(".")
        yield f"| `{step.name}` | {what} | {step.when or '-'} | {step.why} |"


def test_the_tables_in_the_docs_are_those_that_decide():
    text = PAGE.read_text(encoding="utf-8")
    for lines in (matters(), steps()):
        assert "\n".join(lines) in text


def test_each_row_says_why_it_stands_where_it_stands():
    assert all(row.why for row in (*MATTERS, *STEPS))
    assert len({row.name for row in (*MATTERS, *STEPS)}) == len(MATTERS) + len(STEPS)
