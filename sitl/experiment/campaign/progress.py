"""How far an experiment is, and about how long the rest takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from sitl.experiment.campaign.plan import Task
from sitl.experiment.model.settings import value_of

_BAR = 24


@dataclass(slots=True)
class Progress:
    """Counts finished runs.

    The rest is taken to cost as much per weight as what is done.

    Attributes:
        tasks: those that are to be made.
        monotonic: a steady clock, in seconds.
        done: how many are over.
        simulated_s: of those that were made, together.
    """

    tasks: Sequence[Task]
    monotonic: Callable[[], float] = time.monotonic
    done: int = 0
    simulated_s: float = 0.0
    _began_s: float = 0.0
    _done_weight: float = 0.0

    def __post_init__(self) -> None:
        self._began_s = self.monotonic()

    def over(self, task: Task, simulated_s: float = 0.0) -> None:
        """A run is made, or given up."""
        self.done += 1
        self.simulated_s += simulated_s
        self._done_weight += weight(task)

    @property
    def elapsed_s(self) -> float:
        """Since the beginning."""
        return self.monotonic() - self._began_s

    @property
    def left_s(self) -> float | None:
        """How long the rest takes; None before anything is known."""
        if not self._done_weight:
            return None
        return self.elapsed_s * (sum(map(weight, self.tasks)) / self._done_weight - 1.0)

    def line(self) -> str:
        """The state of things in one line."""
        count, left_s = len(self.tasks), self.left_s
        full = round(_BAR * self.done / max(count, 1))
        left = ", time left not known yet" if left_s is None else f", about {in_words(left_s)} left"
        speed = ""
        if self.simulated_s and self.elapsed_s > 0:
            speed = f", {self.simulated_s / self.elapsed_s:,.0f} x real time"
        bar = "#" * full + "." * (_BAR - full)
        return f"[{bar}] {self.done} of {count} runs{left if self.done < count else ''}{speed}"


def weight(task: Task) -> float:
    """What a run costs compared with others: each robot may meet each."""
    robots = sum(value_of(task.row.settings, key) for key in ("uavs", "ugvs"))
    return float(max(robots, 1) ** 2)


def longest_first(tasks: Iterable[Task]) -> list[Task]:
    """Each round of seeds with its longest runs first, so that no long one is left to the end."""
    return sorted(tasks, key=lambda task: (task.number, -weight(task)))


def in_words(time_s: float) -> str:
    """A time as people say it."""
    if time_s < 90:
        return f"{time_s:.0f} s"
    if time_s < 5400:
        return f"{time_s / 60:.0f} min"
    return f"{time_s / 3600:.1f} h"
