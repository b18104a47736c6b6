"""How far an experiment is, and how long the rest takes as far as can be known."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from sitl.experiment.campaign.plan import Row, Task
from sitl.experiment.model.settings import value_of

_BAR = 24


@dataclass(slots=True)
class Progress:
    """Counts finished runs and what each row's cost.

    A row's runs are taken to cost what its finished ones did on average. A row of which nothing is
    finished is taken to cost as much per weight as the others: the square of how many robots there
    are, since each may meet each.
    """

    tasks: tuple[Task, ...]
    workers: int
    monotonic: Callable[[], float] = time.monotonic
    done: int = 0
    simulated_s: float = 0.0
    _left: dict[str, int] = field(default_factory=dict)
    _rows: dict[str, Row] = field(default_factory=dict)
    _costs: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    _began_s: float = 0.0
    _heard_s: float = 0.0

    def __post_init__(self) -> None:
        self._began_s = self._heard_s = self.monotonic()
        for task in self.tasks:
            self._left[task.row.label] = self._left.get(task.row.label, 0) + 1
            self._rows[task.row.label] = task.row

    def finished(self, task: Task, cost_s: float, simulated_s: float) -> None:
        """A run is made; it took `cost_s` of its worker's time."""
        self._costs[task.row.label].append(cost_s)
        self.simulated_s += simulated_s
        self.gone(task)

    def gone(self, task: Task) -> None:
        """A run is made, or given up."""
        self.done += 1
        self._left[task.row.label] -= 1
        self._heard_s = self.monotonic()

    @property
    def elapsed_s(self) -> float:
        """Since the beginning."""
        return self.monotonic() - self._began_s

    @property
    def left_s(self) -> float | None:
        """How long the rest takes; None before anything is known.

        Below zero: what is under way takes longer than such runs did.
        """
        known = {label: _mean(costs) for label, costs in self._costs.items()}
        if not known:
            return None
        per_weight = sum(known.values()) / sum(weight(self._rows[label]) for label in known)
        costs = {
            label: known.get(label, per_weight * weight(row)) for label, row in self._rows.items()
        }
        total_s = sum(costs[label] * count for label, count in self._left.items())
        longest_s = max((costs[label] for label, n in self._left.items() if n), default=0.0)
        since_s = self.monotonic() - self._heard_s
        return max(total_s / max(self.workers, 1), longest_s / 2) - since_s

    def line(self) -> str:
        """The state of things in one line."""
        count = len(self.tasks)
        full = round(_BAR * self.done / max(count, 1))
        left_s = self.left_s
        left = "" if self.done == count else ", time left not known yet"
        if left_s is not None and self.done < count:
            left = f", about {in_words(left_s)} left" if left_s > 0 else ", longer than expected"
        speed = ""
        if self.simulated_s and self.elapsed_s > 0:
            speed = f", {self.simulated_s / self.elapsed_s:,.0f} x real time"
        bar = "#" * full + "." * (_BAR - full)
        return f"[{bar}] {self.done} of {count} runs{left}{speed}"


def weight(row: Row) -> float:
    """What a row's run costs compared with others, before it is known."""
    robots = sum(value_of(row.settings, key) for key in ("uavs", "ugvs"))
    return float(max(robots, 1) ** 2)


def longest_first(tasks: Iterable[Task]) -> list[Task]:
    """Each round of seeds with its longest runs first, so that no long one is left to the end."""
    return sorted(tasks, key=lambda task: (task.number, -weight(task.row)))


def in_words(time_s: float) -> str:
    """A time as people say it."""
    if time_s < 90:
        return f"{time_s:.0f} s"
    if time_s < 5400:
        return f"{time_s / 60:.0f} min"
    return f"{time_s / 3600:.1f} h"


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)
