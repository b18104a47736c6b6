"""A rehearsal's verdicts as a table, one line for each fault."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from sitl.rehearsal.judge.acceptance import End
from sitl.rehearsal.judge.judge_flight import Verdict
from sitl.rehearsal.judge.judge_track import By


def table(verdicts: Iterable[tuple[str, Verdict]], words: Mapping[str, str]) -> str:
    """Markdown.

    Args:
        verdicts: Of every flight, with the name of the fault that it counts for.
        words: A line for each fault, in the order of the table.
    """
    verdicts = list(verdicts)
    ends = [end for end in End if any(v.end is end for _, v in verdicts)]
    head = [
        "fault",
        "flights",
        *(end.value for end in ends),
        "closest to a zone or fence",
        "not as it should",
    ]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for fault, line in words.items():
        mine = [verdict for name, verdict in verdicts if name == fault]
        if mine:
            lines.append(_row(line, mine, ends))
    lines.append(_row("**all**", [verdict for _, verdict in verdicts], ends))
    return "\n".join(lines)


def _row(name: str, verdicts: list[Verdict], ends: list[End]) -> str:
    counts = Counter(verdict.end for verdict in verdicts)
    nearest = [v.nearest_m[By.OURS] for v in verdicts if By.OURS in v.nearest_m]
    closest = f"{min(nearest):.1f} m" if nearest else ""
    bad = sum(not verdict.good for verdict in verdicts)
    cells = [name, len(verdicts), *(counts[end] or "" for end in ends), closest, bad]
    return f"| {' | '.join(map(str, cells))} |"
