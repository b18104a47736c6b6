"""Two runs of the conversations side by side, as a Markdown table."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import zip_longest

from sitl.conformance.conversation import Conversation, Outcome


def beside(
    conversations: Iterable[Conversation], ours: Iterable[Outcome], theirs: Iterable[Outcome]
) -> str:
    """The table: every conversation, its fact, how each run ended and what was seen differently."""
    by_name = {outcome.name: outcome for outcome in theirs}
    own = {outcome.name: outcome for outcome in ours}
    lines = [
        "| conversation | fact (recorded in) | ours | PX4 | seen otherwise: ours / PX4 |",
        "|---|---|---|---|---|",
    ]
    for conversation in conversations:
        mine, other = own[conversation.name], by_name.get(conversation.name)
        cells = (
            conversation.name,
            f"{conversation.fact} ({conversation.recorded})",
            _word(mine),
            "not held" if other is None else _word(other),
            _differences(mine, other),
        )
        lines.append(f"| {' | '.join(_cell(text) for text in cells)} |")
    return "\n".join(lines)


def _word(outcome: Outcome) -> str:
    if outcome.held:
        return "held"
    return f"{'left out' if outcome.left_out else '**departs**'}: {outcome.departure}"


def _differences(mine: Outcome, other: Outcome | None) -> str:
    if other is None:
        return "; ".join(mine.notes)
    pairs = zip_longest(mine.notes, other.notes, fillvalue="nothing")
    return "; ".join(f"{one} / {two}" for one, two in pairs if one != two)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
