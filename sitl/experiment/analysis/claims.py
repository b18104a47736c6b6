"""The claims that an experiment declares, decided by its runs; rows compared. Needs SciPy.

Verdicts follow from the effect and its interval, never from a p-value; beside them stands the
effect that as many runs would show with a power of 0.8. Intervals of the parts of one claim are
simultaneous (Bonferroni). All parts hold: the claim holds; all fail: it fails.

Rows that met the same seeds are compared run by run, and so are both simulations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np

from sitl.experiment import (
    ClaimRule,
    Experiment,
    PartRule,
    Phase,
    Record,
    Row,
    canonical,
    rows_with,
    settings_text,
    value_of,
)
from sitl.experiment.analysis.statistics import (
    UNKNOWN,
    Effect,
    Interval,
    Runs,
    Weights,
    share_above,
)

Verdict = Literal["holds", "fails", "undecided"]


@dataclass(frozen=True, slots=True)
class Part:
    """One statement of a claim, the verdict of the runs, and the numbers."""

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
        listed = [f"{verdict}: {'; '.join(what)}" for verdict, what in parts.items() if what]
        return ". ".join([self.brief, *(listed if len(listed) > 1 else [])])


def claims_of(experiment: Experiment, records: Sequence[Record]) -> list[Claim]:
    """What the runs show about the experiment's claims; none unless all its rows have runs.

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


def _mean_of(rows: Sequence[Row], weight: float = 1.0) -> list[tuple[float, Row]]:
    """A term of a contrast: the mean over some rows, so many times."""
    return [(weight / len(rows), row) for row in rows]


def _effects(runs: Runs, part: PartRule) -> list[Effect]:
    every = runs.experiment.rows
    *first, last = (_mean_of(rows_with(every, term.rows), term.weight) for term in part.contrast)
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
    """The effect with its interval, the claim's bound, and what as many runs would have shown."""
    if math.isnan(shown.value):
        return "too few runs"
    detectable = effect.detectable(tests)
    unit, form, least = part.measure.rpartition("_")[2], "+.2f", f"{detectable:.2f}"
    if part.ratio:
        unit, form, least = "times", ".2f", f"a factor of {math.exp(detectable):.2f}"
    elif part.share or unit == "percent":
        unit = "points"
    value, low, high = (format(number, form) for number in shown)
    side, bound = ("more", part.more_than) if part.less_than is None else ("less", part.less_than)
    return f"{value} {unit} [{low}, {high}]; required: {side} than {bound:g}; detectable: {least}"


# Rows compared.

MEASURES: Final = {
    "goals_found_percent": "goals, points",
    "goal_rate_area_percent": "goals over time, points",
    "pose_age_mean_s": "pose age, s",
    "pose_age_peak_s": "pose peak, s",
    "map_age_mean_s": "map age, s",
    "map_age_peak_s": "map peak, s",
    "claims_age_mean_s": "claims age, s",
    "wait_mean_s": "wait, s",
    "service_age_mean_s": "service age, s",
}

WITHIN: Final = 0.1
"""Means that differ by no more than this share of the processes' count as the same."""

FLIGHT_MEASURES: Final = {
    "searches": "searches",
    "found": "robots found by them",
    "uav_contacts": "contacts",
    "uav_contact_s": "time in contact, s",
    "syncs": "syncs, both directions",
    "arrived_kB": "kilobytes, both directions",
    "found_after_mean_s": "wait for a robot that is found, s",
    "comm_mean_s": "time in COMM, s",
    "mission_s": "time until it comes home, s",
    "goals_found": "goals found",
    "pose_age_mean_s": "age of poses at the UAV, s",
    "given_age_mean_s": "age of what robots were given, s",
}


FLOWN_IN: Final = {"mission": "experiments", "processes": "processes", "px4": "real PX4"}
"""What a mission's own world is flown in, as a table has it."""


class Comparison(NamedTuple):
    """A row against the first row that met the same seeds; or several alike, together.

    Attributes:
        row, base: what they are called.
        pairs: how many pairs of runs.
        weights: the contrast.
    """

    row: str
    base: str
    pairs: int
    weights: Weights


def compared(runs: Runs) -> list[Comparison]:
    """Every row against the first one with the same seeds; then all that differ alike together."""
    experiment = runs.experiment
    bases: dict[int, Row] = {}
    alike: dict[str, list[tuple[Row, Row]]] = {}
    found = []

    def compare(row: str, base: str, both: Sequence[tuple[Row, Row]]) -> None:
        pairs = sum(len(runs.numbers(*pair)) for pair in both)
        share = 1 / len(both)
        weights = [entry for one, other in both for entry in ((share, one), (-share, other))]
        found.append(Comparison(row, base, pairs, weights))

    for row in experiment.rows:
        base = bases.setdefault(experiment.seed(row, 0), row)
        if base is not row and len(runs.numbers(row, base)) > 1:
            compare(row.label, base.label, [(row, base)])
            change = [[value_of(own.settings, k) for k in experiment.paired] for own in (row, base)]
            alike.setdefault(canonical(change), []).append((row, base))
    keys = [key for key in experiment.varied if key in experiment.paired]
    for both in alike.values():
        if len(both) > 1:
            name, base_name = (f"{settings_text(own.settings, keys)}, all" for own in both[0])
            compare(name, base_name, both)
    return found


def comparisons(runs: Runs) -> list[list[str]]:
    """The comparisons as they are read: the heads, then the cells of each.

    A difference with its interval, which holds together with those of the other rows, and how large
    one is that so many pairs distinguish from 0.
    """
    found = compared(runs)
    measures = {key: head for key, head in MEASURES.items() if runs.has(key)}
    rows = [["row", "against", "pairs", *measures.values()]]
    for one in found:
        cells = [one.row, one.base, str(one.pairs)]
        for measure in measures:
            effect = runs.effect(one.weights, measure)
            value, low, high = effect.interval(len(found))
            text = f"{value:+.1f} [{low:+.1f}, {high:+.1f}]; detectable: "
            known = not math.isnan(value)
            cells.append(f"{text}{effect.detectable(len(found)):.1f}" if known else "unknown")
        rows.append(cells)
    return rows


def within(ratio: Interval) -> Literal["yes", "no", "open"]:
    """Whether a ratio is `WITHIN` of 1; "open": its interval is neither within nor outside."""
    _, low, high = ratio
    if low >= 1 - WITHIN and high <= 1 + WITHIN:
        return "yes"
    return "no" if low > 1 + WITHIN or high < 1 - WITHIN else "open"


class Likeness(NamedTuple):
    """A measure of the same missions by experiments and by what flies.

    Attributes:
        name: what it is called.
        means: geometric means, of both.
        ratio: of experiments to what flies.
    """

    name: str
    means: tuple[float, float]
    ratio: Interval


def flown_beside(runs: Runs) -> tuple[str, list[Likeness]]:
    """What missions were flown in beside experiments, and how alike each measure is.

    Flights of one seed meet the same patrols and fading, so they are compared in pairs. Empty where
    no missions were flown in both.
    """
    flown = {
        world: [
            row for row in rows_with(runs.experiment.rows, {"world": world}) if runs.numbers(row)
        ]
        for world in FLOWN_IN
    }
    here = flown.pop("mission")
    other, there = next(((world, rows) for world, rows in flown.items() if rows), ("", []))
    if not here or not there:
        return "", []

    def factor(key: str, weights: Weights) -> Interval:
        found = runs.effect(weights, key, ratio=True).interval()
        return Interval(*map(math.exp, found))

    ours, theirs = _mean_of(here), _mean_of(there)
    apart = [*ours, *_mean_of(there, -1.0)]
    return FLOWN_IN[other], [
        Likeness(
            name,
            (factor(key, ours).value, factor(key, theirs).value),
            factor(key, apart),
        )
        for key, name in FLIGHT_MEASURES.items()
        if runs.has(key)
    ]


def likeness(runs: Runs) -> str:
    """Whether experiments come to what processes do, or a real PX4: side by side, for a document.

    Empty where no missions were flown in both.
    """
    other, found = flown_beside(runs)
    if not found:
        return ""
    lines = [
        f"| per mission, geometric means | {FLOWN_IN['mission']} | {other} | ratio | within 10 % |",
        "|---|---:|---:|---:|---|",
    ]
    for one in found:
        means = " | ".join(f"{mean:.1f}" for mean in one.means)
        value, low, high = (f"{number:.2f}" for number in one.ratio)
        lines.append(f"| {one.name} | {means} | {value} ({low} to {high}) | {within(one.ratio)} |")
    return "\n".join(lines)
