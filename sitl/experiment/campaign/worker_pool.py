"""Who makes the runs of an experiment: a port, and what comes back through it."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from sitl.experiment.campaign.plan import Task

MOST_TRIES = 3
"""How often a run is begun whose worker dies."""

Record = Mapping[str, Any]
"""What is kept of a run, in plain values."""

Work = Callable[[Task], Record]
"""Makes one run. Travels to other processes, so it is a module's own function."""


@dataclass(frozen=True, slots=True)
class Finished:
    """A run has been made."""

    task: Task
    record: Record


@dataclass(frozen=True, slots=True)
class Lost:
    """The worker that made a run is gone; `again`: the run is begun once more."""

    task: Task
    tries: int
    why: str
    again: bool


@dataclass(frozen=True, slots=True)
class Failed:
    """A run ended in an error of the program. The same seed would end in the same one."""

    task: Task
    why: str


@dataclass(frozen=True, slots=True)
class News:
    """Something about the pool that people want to know."""

    text: str


@dataclass(frozen=True, slots=True)
class Tick:
    """Nothing has come, and time goes by."""


TICK_S = 1.0
"""A tick comes so often while nothing else does."""

Outcome = Finished | Lost | Failed | News | Tick


class WorkerPool(Protocol):
    """Makes runs, in any order, as many at a time as it has workers."""

    def run(self, work: Work, tasks: Sequence[Task]) -> Generator[Outcome, None, None]:
        """Make all runs. Closing the iterator stops those that are under way."""

    @property
    def workers(self) -> int:
        """How many runs are under way at a time."""
