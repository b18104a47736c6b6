"""The claims that an experiment declares, decided by its runs. Needs SciPy.

Verdicts follow from the effect and its interval, never from a p-value; beside them stands the
effect that as many runs would show with a power of 0.8. Intervals of the parts of one claim are
simultaneous (Bonferroni). All parts hold: the claim holds; all fail: it fails.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sitl.experiment.analysis.statistics import UNKNOWN, Effect, Interval, Runs, share_above
from sitl.experiment.plan import (
    ClaimRule,
    Experiment,
    PartRule,
    Phase,
    Record,
    Row,
    Term,
    rows_with,
)

Verdict = Literal["holds", "fails", "undecided"]


@dataclass(frozen=True, slots=True)
class Part:
    """One statement of a claim, what the runs say of it, and the numbers."""

    what: str
    verdict: Verdict
    effect: Interval
    because: str


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim with our answer.

    Attributes:
        number: as declared.
        text: what is claimed.
        parts: what it consists of.
        phase: of the runs that it was tested on; only those for confirmation confirm anything.
        declared: whether all runs were made after it was declared as it is now.
    """

    number: int
    text: str
    parts: tuple[Part, ...]
    phase: Phase
    declared: bool

    @property
    def brief(self) -> str:
        """The answer in a word or two, and what it is worth."""
        verdicts = {part.verdict for part in self.parts}
        text = "in part" if "holds" in verdicts else "not shown"
        if len(verdicts) == 1:
            text = self.parts[0].verdict
        if self.phase == "exploration":
            text += ", on exploration seeds"
        return text if self.declared else f"{text}, by rules that changed after runs were made"

    @property
    def verdict(self) -> str:
        """The answer, and which parts hold, fail or are undecided where that differs."""
        parts: dict[Verdict, list[str]] = {"holds": [], "fails": [], "undecided": []}
        for part in self.parts:
            parts[part.verdict].append(part.what)
        told = [f"{verdict}: {'; '.join(what)}" for verdict, what in parts.items() if what]
        return ". ".join([self.brief, *(told if len(told) > 1 else [])])


def claims_of(experiment: Experiment, records: Sequence[Record]) -> list[Claim]:
    """What the runs say about the experiment's claims; none unless all its rows have runs.

    Raises:
        UsageError: a claim is about a measure that runs do not have.
    """
    runs = Runs(experiment, records)
    if not all(runs.numbers(row) for row in experiment.rows):
        return []
    declared = all(record["rules"] == experiment.rules for record in records)
    return [
        Claim(
            rule.number,
            rule.text,
            tuple(_part(runs, rule, part) for part in rule.parts),
            records[0]["phase"],
            declared,
        )
        for rule in experiment.claims
    ]


def _part(runs: Runs, claim: ClaimRule, part: PartRule) -> Part:
    tests, beside = len(claim.parts), ""
    if part.share:
        rows = rows_with(runs.experiment.rows, part.contrast[0].rows)
        won, lost = (
            np.concatenate([runs.values(row, measure, runs.numbers(row)) for row in rows])
            for measure in part.share
        )
        effect, design = share_above(won, lost, part.reference)
        beside = f"; {int(won.sum() + lost.sum())} cases, design effect {design:.1f}"
        effects = [effect]
    else:
        effects = _effects(runs, part)
    if part.each:
        beside = f"; the least of {len(effects)}"
    least = min(effects, key=lambda effect: effect.value)
    verdicts = {_verdict(effect.interval(tests), part) for effect in effects}
    verdict: Verdict = "holds" if verdicts == {"holds"} else "undecided"
    if "fails" in verdicts:
        verdict = "fails"
    shown = Interval(*(math.exp(v) if part.ratio else v for v in least.interval(tests)))
    return Part(part.what, verdict, shown, _because(least, shown, part, tests) + beside)


def _effects(runs: Runs, part: PartRule) -> list[Effect]:
    def weights(term: Term) -> list[tuple[float, Row]]:
        rows = rows_with(runs.experiment.rows, term.rows)
        return [(term.weight / len(rows), row) for row in rows]

    *first, last = map(weights, part.contrast)
    before = [entry for own in first for entry in own]
    contrasts = [[*before, *last]]
    if part.each:
        own = [row for _, row in before]
        weight = part.contrast[-1].weight
        contrasts = [[*before, (weight, row)] for _, row in last if row not in own]
    return [runs.effect(each, part.measure, ratio=part.ratio) for each in contrasts] or [UNKNOWN]


def _verdict(found: Interval, part: PartRule) -> Verdict:
    """Where the whole interval lies; one that is not known lies nowhere."""
    bound = part.more_than if part.less_than is None else part.less_than
    limit = math.log(bound or 1.0) if part.ratio else bound or 0.0
    above, below = found.low > limit, found.high < limit
    if part.less_than is not None:
        above, below = below, above
    return "holds" if above else "fails" if below else "undecided"


def _because(effect: Effect, shown: Interval, part: PartRule, tests: int) -> str:
    """The effect with its interval, what was asked, and what as many runs would have shown."""
    if math.isnan(shown.value):
        return "too few runs"
    detectable = effect.detectable(tests)
    unit, form, told = part.measure.rpartition("_")[2], "+.2f", f"{detectable:.2f}"
    if part.ratio:
        unit, form, told = "times", ".2f", f"a factor of {math.exp(detectable):.2f}"
    elif part.share or unit == "percent":
        unit = "points"
    value, low, high = (format(number, form) for number in shown)
    side, bound = ("more", part.more_than) if part.less_than is None else ("less", part.less_than)
    return f"{value} {unit} [{low}, {high}]; asked: {side} than {bound:g}; detectable: {told}"
