"""The figures as a table of a documentation page, from the file that a measurement wrote."""

from pathlib import Path
from typing import Any

from benchmarks.goals.figure import number
from benchmarks.goals.groups import GROUPS

BEGIN, END = "<!-- figures: written by --docs -->\n", "<!-- end of figures -->\n"
WHERE = ("idle", "busy")


def write(page: Path, measured: dict[str, dict[str, Any]]) -> None:
    """Put the table where the page has its marks.

    Raises:
        ValueError: it has none.
    """
    before, begin, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"{page} has no line {BEGIN.strip()} with {END.strip()} behind it")
    page.write_text(before + BEGIN + table(measured) + END + after, encoding="utf-8")


def table(measured: dict[str, dict[str, Any]]) -> str:
    """A row for each figure: goal, measured on an idle and a busy machine, ratios to anchors."""
    lines = [
        "",
        "| | goal | idle | busy | by the anchors of the same run: idle, busy |",
        "|---|---:|---:|---:|---|",
    ]
    for name in GROUPS:
        groups = [measured.get(where, {}).get(name, {"figures": []}) for where in WHERE]
        if any(group.get("quick") for group in groups):
            raise ValueError(f"{name} was measured with --quick: those figures are none to quote")
        rows = [{row["what"]: row for row in group["figures"]} for group in groups]
        names = dict.fromkeys(key for each in rows for key in each)
        lines += [_line([each.get(what) for each in rows]) for what in names]
    return "\n".join([*lines, "", ""])


def _line(rows: list[dict[str, Any] | None]) -> str:
    first: dict[str, Any] = next(row for row in rows if row)
    bound = "≥" if first["at_least"] else "≤"
    goal = "" if first["goal"] is None else f"{bound} {first['goal']:g}"
    values = [_value(row) for row in rows]
    ratios = [
        f"{anchor}: {', '.join(_ratio(row, anchor) for row in rows)}" for anchor in first["anchors"]
    ]
    unit = f", {first['unit']}" if first["unit"] else ""
    return f"| {first['what']}{unit} | {goal} | {' | '.join(values)} | {'; '.join(ratios)} |"


def _value(row: dict[str, Any] | None) -> str:
    if row is None:
        return "-"
    text = "none" if row["value"] is None else number(row["value"])
    return f"**{text}**" if row["met"] is False else text


def _ratio(row: dict[str, Any] | None, anchor: str) -> str:
    ratio = row and row["ratios"].get(anchor)
    return "-" if ratio is None else f"{ratio:.2f}"
