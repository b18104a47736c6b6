"""A rehearsal's verdicts as a table, one line for each fault."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from sitl.rehearsal.faults import Fault
from sitl.rehearsal.judge import End, Verdict


def table(verdicts: Iterable[Verdict]) -> str:
    """Markdown."""
    verdicts = list(verdicts)
    ends = [end for end in End if any(v.end is end for v in verdicts)]
    head = [
        "fault",
        "flights",
        *(end.value for end in ends),
        "closest to a zone",
        "not as it should",
    ]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for fault in Fault:
        mine = [v for v in verdicts if v.fault == fault.name]
        if mine:
            lines.append(_row(fault.value, mine, ends))
    lines.append(_row("**all**", verdicts, ends))
    return "\n".join(lines)


def _row(name: str, verdicts: list[Verdict], ends: list[End]) -> str:
    counts = Counter(verdict.end for verdict in verdicts)
    flown = [v.deepest_m for v in verdicts if v.flown_s > 0]
    closest = f"{-max(flown):.1f} m" if flown else ""
    bad = sum(not verdict.good for verdict in verdicts)
    cells = [name, len(verdicts), *(counts[end] or "" for end in ends), closest, bad]
    return f"| {' | '.join(map(str, cells))} |"
