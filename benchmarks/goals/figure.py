"""A measured figure, its goal, and what the same run measured beside it."""

import math
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

HEAD = f"{'':<47}{'goal':>11}{'measured':>11}  {'anchor':<40}{'ratio':>8}"


class UnmeasuredError(Exception):
    """This machine cannot measure it; the message is the reason."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """How it is measured.

    Attributes:
        quick: the smallest sizes, to see that it works; its figures are none to quote.
        busy: beside three busy loops.
        against: another checkout of this project, as one more anchor.
    """

    quick: bool = False
    busy: bool = False
    against: Path | None = None


@dataclass(frozen=True, slots=True)
class Figure:
    """One line of the table.

    Attributes:
        what: is measured.
        value: of it, in `unit`.
        goal: it is to be at most so much, or at least if `at_least`; None: only compared.
        anchors: the same of others, or what it is made of, by name.
    """

    what: str
    value: float
    unit: str
    goal: float | None = None
    at_least: bool = False
    anchors: Mapping[str, float] = field(default_factory=dict)

    @property
    def met(self) -> bool | None:
        """None: there is no goal."""
        if self.goal is None:
            return None
        return self.value >= self.goal if self.at_least else self.value <= self.goal

    def lines(self) -> Iterator[str]:
        """One, and one more for each further anchor."""
        bound = ">=" if self.at_least else "<="
        goal = "-" if self.goal is None else f"{bound} {self.goal:g}"
        verdict = {None: "", True: "", False: "  MISSED"}[self.met]
        first, *others = [*self.anchors.items()] or [("", math.nan)]
        what = f"{self.what}, {self.unit}" if self.unit else self.what
        start = f"{what:<47}{goal:>11}{number(self.value):>11}"
        yield f"{start}  {self._anchor(*first)}{verdict}"
        for other in others:
            yield f"{'':<69}  {self._anchor(*other)}"

    def _anchor(self, name: str, value: float) -> str:
        if not name:
            return ""
        ratio = f"{self.value / value:8.2f}" if value else f"{'-':>8}"
        return f"{f'{name}: {number(value)}':<40}{ratio}"

    def as_row(self) -> dict[str, Any]:
        """For programs; JSON has no infinity."""
        plain = {name: _plain(value) for name, value in self.anchors.items()}
        return {
            "what": self.what,
            "unit": self.unit,
            "goal": self.goal,
            "at_least": self.at_least,
            "value": _plain(self.value),
            "met": self.met,
            "anchors": plain,
            "ratios": {
                name: _plain(self.value / value) if value else None
                for name, value in self.anchors.items()
            },
        }


def number(value: float) -> str:
    """Three digits, and no exponents of ten."""
    if not math.isfinite(value):
        return "none"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def median_ms(
    call: Callable[[], object], times: int, clock: Callable[[], float] = time.perf_counter
) -> float:
    """How long a call takes, by the clock."""
    values = []
    for _ in range(times):
        began_s = clock()
        call()
        values.append((clock() - began_s) * 1e3)
    return statistics.median(values)


def missed(figures: Iterable[Figure]) -> int:
    """How many goals are not met."""
    return sum(figure.met is False for figure in figures)


def _plain(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None
