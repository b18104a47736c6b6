"""The seven claims of the paper, each tested on runs of ours. Needs SciPy.

An answer follows from fixed rules: a part of a claim holds where its p-value is below 0.05,
corrected (Holm) where several tests of a claim ask the same, or, for "does not help", where the
95 % interval of the help ends below five percentage points of the goals. What says that something
is not so (in claims 6 and 7) holds where its test does not find that it is. All parts: confirmed.
None: not confirmed. Some: it depends on what tells them apart.

The rules of claims 1 to 5 are older than the model that they are applied to; that of claim 6 was
changed, and two parts of claim 7 were added, after runs of theirs had been seen
(docs/experiments.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from sitl.experiment.analysis import paper
from sitl.experiment.analysis.statistics import (
    LEVEL,
    Evidence,
    Trend,
    above,
    fewer,
    growing,
    holm,
    paired_above,
    pooled_above,
    share_interval,
)
from sitl.experiment.campaign.plan import Experiment, Phase, Record
from sitl.experiment.campaign.plan_file import load_experiment

GOALS: Final = "goals_found_percent"
TIME: Final = "time_to_goal_mean_min"
WAIT: Final = "wait_mean_s"
MAP_AGE: Final = "map_age_mean_s"
NO_HELP_POINTS: Final = 5.0
"""Less than so many percentage points of goals is no help worth a flight."""

FACTOR: Final = 2.0


@dataclass(frozen=True, slots=True)
class Part:
    """One statement of a claim, whether it holds, and the numbers."""

    what: str
    holds: bool
    because: str


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim of the paper with our answer.

    Attributes:
        number: in the order of the paper.
        text: what is claimed.
        parts: what it consists of.
        figure: which of the experiment's figures shows it.
        phase: of the runs that it was tested on; only those for confirmation confirm anything.
    """

    number: int
    text: str
    parts: tuple[Part, ...]
    figure: str
    phase: Phase = "exploration"

    @property
    def verdict(self) -> str:
        """The answer, and what it is worth."""
        return self.answer + (", on exploration seeds" if self.phase == "exploration" else "")

    @property
    def answer(self) -> str:
        """confirmed, not confirmed, or what it depends on."""
        held = [part.what for part in self.parts if part.holds]
        if len(held) == len(self.parts):
            return "confirmed"
        return f"depends: holds for {'; '.join(held)}" if held else "not confirmed"


def table_claims(records: Sequence[Record]) -> list[Claim]:
    """Claims 1 to 5, from the runs of the paper's table (all 24 rows)."""
    evidence = Evidence(records)
    return [make(evidence) for make in (_most_robots, _radius, _second_uav, _time, _wait)]


def _most_robots(runs: Evidence) -> Claim:
    trends = [growing(s) for s in _each(runs.strata(GOALS, "ugvs", ("radius_m", "uavs")))]
    everywhere = growing(runs.strata(GOALS, "ugvs", ("radius_m", "uavs")))
    significant = sum(p < LEVEL for p in holm([t.p for t in trends]))
    parts = [
        Part(
            "more ground robots find more goals",
            everywhere.p < LEVEL,
            f"{_trend(everywhere)}; alone significant in {significant} of {len(trends)} pairs of "
            "radius and UAVs",
        )
    ]
    tests = []
    for radius_m in runs.levels("radius_m"):
        best = runs.values(GOALS, radius_m=radius_m, uavs=1, ugvs=10)
        for uavs, ugvs in ((1, 3), (1, 5), (2, 3), (2, 5), (2, 10)):
            other = runs.values(GOALS, radius_m=radius_m, uavs=uavs, ugvs=ugvs)
            tests.append((radius_m, f"{uavs}+{ugvs}", above(best, other)))
    corrected = holm([difference.p_greater for _, _, difference in tests])
    for radius_m in runs.levels("radius_m"):
        own = [(n, d, p) for (r, n, d), p in zip(tests, corrected, strict=True) if r == radius_m]
        beaten = [name for name, _, p in own if p < LEVEL]
        closest = min(own, key=lambda entry: entry[1].value)
        parts.append(
            Part(
                f"1 UAV and 10 UGVs are best at {radius_m:g} m",
                len(beaten) == len(own),
                f"significantly better than {', '.join(beaten) or 'none'} of 5 teams; against "
                f"{closest[0]} by {closest[1].value:+.1f} points "
                f"[{closest[1].low:+.1f}, {closest[1].high:+.1f}]",
            )
        )
    return Claim(
        1,
        "More ground robots find more goals; 1 UAV with 10 UGVs is the best team at every radius.",
        tuple(parts),
        "table",
    )


def _radius(runs: Evidence) -> Claim:
    levels = runs.levels("ugvs")
    trends = [
        growing(runs.strata(GOALS, "radius_m", ("uavs",), uavs=1, ugvs=ugvs)) for ugvs in levels
    ]
    corrected = holm([trend.p for trend in trends])
    parts = tuple(
        Part(f"{ugvs} UGVs", p < LEVEL, f"{_trend(trend)}, corrected {_p(p)}")
        for ugvs, trend, p in zip(levels, trends, corrected, strict=True)
    )
    return Claim(
        2, "For one UAV, a larger radius of communication finds more goals.", parts, "table"
    )


def _second_uav(runs: Evidence) -> Claim:
    def both(**settings: Any) -> Any:
        return tuple(runs.values(GOALS, uavs=uavs, **settings) for uavs in (2, 1))

    short = [radius_m for radius_m in runs.levels("radius_m") if radius_m < 30]
    helped = {
        ugvs: pooled_above([both(radius_m=radius_m, ugvs=ugvs) for radius_m in short])
        for ugvs in (3, 5)
    }
    corrected = holm([difference.p_greater for difference in helped.values()])
    parts = [
        Part(f"it helps {ugvs} UGVs below 30 m", p < LEVEL, f"{_points(d)}, corrected {_p(p)}")
        for (ugvs, d), p in zip(helped.items(), corrected, strict=True)
    ]
    ten = pooled_above([both(radius_m=radius_m, ugvs=10) for radius_m in short])
    far = pooled_above([both(radius_m=30, ugvs=ugvs) for ugvs in runs.levels("ugvs")])
    parts += [
        Part("it does not help 10 UGVs", ten.high < NO_HELP_POINTS, _points(ten)),
        Part("it does not help at 30 m", far.high < NO_HELP_POINTS, _points(far)),
    ]
    return Claim(
        3,
        "A second UAV helps teams of 3 and 5 UGVs, not teams of 10, and not at 30 m.",
        tuple(parts),
        "table",
    )


def _time(runs: Evidence) -> Claim:
    trends = {
        "the team": _shrinking(runs.strata(TIME, "ugvs", ("radius_m", "uavs"))),
        "the radius": _shrinking(runs.strata(TIME, "radius_m", ("uavs", "ugvs"))),
    }
    return Claim(
        4,
        "The time to a goal shrinks with the team and with the radius.",
        _with_each("it shrinks with", trends),
        "table",
    )


def _wait(runs: Evidence) -> Claim:
    trends = {
        "the team": growing(runs.strata(WAIT, "ugvs", ("radius_m", "uavs"))),
        "the radius": growing(runs.strata(WAIT, "radius_m", ("uavs", "ugvs"))),
        "the number of UAVs": growing(runs.strata(WAIT, "uavs", ("radius_m", "ugvs"))),
    }
    return Claim(
        5,
        "Messages wait longer with a larger team, a larger radius and more UAVs.",
        _with_each("it grows with", trends),
        "table",
    )


def near_paper(records: Sequence[Record]) -> list[tuple[str, float]]:
    """For each row of the paper's table: our mean wait as a multiple of the paper's."""
    evidence, found = Evidence(records), []
    for row in paper.TABLE:
        key = {"radius_m": row.radius_m, "uavs": row.uavs, "ugvs": row.ugvs}
        waits = evidence.values("waits", **key)
        if len(waits) and waits.sum():
            mean_s = float(np.nansum(waits * evidence.values(WAIT, **key)) / waits.sum())
            name = f"{row.radius_m:g} m, {row.uavs}+{row.ugvs}"
            found.append((name, mean_s / row.wait_mean_s))
    return found


def within_factor(ratios: Sequence[tuple[str, float]]) -> int:
    """How many of the rows lie within a factor of two of the paper's."""
    return sum(1 / FACTOR <= ratio <= FACTOR for _, ratio in ratios)


def field_claim(records: Sequence[Record]) -> Claim:
    """Claim 6, from the runs of the experiment that is like the field.

    The claim is about the paper's protocol, so that of ours is only told beside it.
    """
    runs = Evidence(records)
    theirs, ours = runs.of(protocol="original"), runs.of(protocol="ours")
    complete, broken = _exchanges(theirs)
    low, high = share_interval(complete, max(complete + broken, 1))
    field = (paper.FIELD_INTERACTIONS - paper.FIELD_INTERRUPTED, paper.FIELD_INTERRUPTED)
    p = fewer((complete, broken), field)
    bins = [np.array(record["curves"]["bin_bytes"], dtype=np.float64) for record in theirs]
    shares = [float(np.sort(own)[::-1][: len(own) // 10].sum() / own.sum()) for own in bins]
    silent = float(np.mean([np.mean(own == 0) for own in bins]))
    beside = f"; with our protocol {_percent(_exchanges(ours))}" if ours else ""
    return Claim(
        6,
        "In the field 99.5 % of interactions are complete, and bandwidth comes in rare spikes.",
        (
            Part(
                "as many interactions are complete as in the field, or more",
                p >= LEVEL,
                f"{_percent((complete, broken))} [{100 * low:.2f}, {100 * high:.2f}], in the field "
                f"{_percent(field)}; Fisher's exact test that it is less: {_p(p)}{beside}",
            ),
            Part(
                "bandwidth comes in spikes",
                float(np.mean(shares)) > 0.5,
                f"the busiest tenth of the time carries {100 * np.mean(shares):.0f} % of bytes; "
                f"{100 * silent:.0f} % of the time is silent",
            ),
        ),
        "bandwidth",
    )


def _exchanges(records: Sequence[Record]) -> tuple[int, int]:
    """How many came to their end, and how many were broken off."""
    complete, broken = (
        sum(record["measures"][key] for record in records)
        for key in ("exchanges_complete", "exchanges_broken")
    )
    return complete, broken


def _percent(exchanges: tuple[int, int]) -> str:
    complete, broken = exchanges
    return f"{100 * complete / max(complete + broken, 1):.2f} % of {complete + broken}"


def passive_claim(records: Sequence[Record]) -> Claim:
    """Claim 7, from runs with and without seeking at several team sizes."""
    runs = Evidence(records)
    sizes = runs.levels("ugvs")
    few, some, many = sizes[0], sizes[len(sizes) // 2], sizes[-1]

    def returns(passive: bool) -> Any:
        """Per run: goals per robot that was added last, less those per robot added first."""
        goals = {n: runs.values("goals_found", passive=passive, ugvs=n) for n in (few, some, many)}
        least = min(len(values) for values in goals.values())
        goals = {n: values[:least] for n, values in goals.items()}
        late = (goals[many] - goals[some]) / (many - some)
        return late - (goals[some] - goals[few]) / (some - few)

    passive, seeking = (above_zero(returns(flag)) for flag in (True, False))
    gain = {n: _gain(runs, n) for n in sizes}
    return Claim(
        7,
        "Passive communication gives diminishing returns with more robots; seeking them does not.",
        (
            Part("returns diminish without seeking", passive.p_less < LEVEL, _per_robot(passive)),
            Part("they do not with seeking", seeking.high >= 0, _per_robot(seeking)),
            *_map_parts(runs),
            Part(
                f"seeking finds more goals with {many} UGVs",
                gain[many].p_greater < LEVEL,
                "; ".join(f"{n} UGVs: {_points(d)}" for n, d in gain.items()),
            ),
        ),
        "compare",
    )


def _map_parts(runs: Evidence) -> tuple[Part, Part]:
    """The cause that the paper gives: maps come back to ground robots too rarely."""
    passive, seeking = (
        growing(runs.strata(MAP_AGE, "ugvs", (), passive=flag)) for flag in (True, False)
    )
    return (
        Part(
            "without seeking, the map that ground robots hold is older where they are more",
            passive.p < LEVEL,
            _trend(passive),
        ),
        Part("with seeking it is not", seeking.p >= LEVEL, _trend(seeking)),
    )


def _gain(runs: Evidence, ugvs: int) -> Any:
    return paired_above(*runs.pairs(GOALS, "passive", (False, True), ugvs=ugvs).T)


def above_zero(values: Any) -> Any:
    """Whether the mean of values is more or less than nothing."""
    return paired_above(values, np.zeros(len(values)))


def _each(strata: list[Any]) -> list[list[Any]]:
    return [[stratum] for stratum in strata]


def _shrinking(strata: list[list[tuple[float, Any]]]) -> Trend:
    trend = growing([[(level, -values) for level, values in stratum] for stratum in strata])
    return Trend(-trend.tau, trend.p)


def _with_each(words: str, trends: Mapping[str, Trend]) -> tuple[Part, ...]:
    corrected = holm([trend.p for trend in trends.values()])
    return tuple(
        Part(f"{words} {what}", p < LEVEL, f"{_trend(trend)}, corrected {_p(p)}")
        for (what, trend), p in zip(trends.items(), corrected, strict=True)
    )


def _trend(trend: Trend) -> str:
    return f"Kendall's tau {trend.tau:+.2f}, {_p(trend.p)}"


def _p(p: float) -> str:
    if math.isnan(p):
        return "p unknown"
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}"


def _points(difference: Any) -> str:
    return f"{difference.value:+.1f} points [{difference.low:+.1f}, {difference.high:+.1f}]"


def _per_robot(difference: Any) -> str:
    return (
        f"goals per added robot change by {difference.value:+.2f} "
        f"[{difference.low:+.2f}, {difference.high:+.2f}] from the first to the last added"
    )


CLAIMS: Final[Mapping[str, Callable[[Sequence[Record]], list[Claim]]]] = {
    "table1": table_claims,
    "field": lambda records: [field_claim(records)],
    "passive": lambda records: [passive_claim(records)],
}
"""Which experiments say something about which claims."""


def claims_of(experiment: Experiment, records: Sequence[Record]) -> list[Claim]:
    """What the runs of an experiment say about the paper's claims; all its rows must have some.

    It has the name and the rows of a shipped one, and may differ in what all rows share.
    """
    make = CLAIMS.get(experiment.name)
    if make is None:
        return []
    shipped, _ = load_experiment(experiment.name)
    asked = {row.label for row in shipped.rows}
    same = asked == {row.label for row in experiment.rows}
    if not same or asked != {record["row"] for record in records}:
        return []
    return [replace(claim, phase=records[0]["phase"]) for claim in make(records)]
