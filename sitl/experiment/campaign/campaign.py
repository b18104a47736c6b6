"""Carries an experiment out: what is missing is run, and each finished run is kept at once."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from air_router.counted import counted
from air_router.flight.status import StatusLine
from sitl.experiment.campaign.plan import Experiment, Phase, Record, Row, Task
from sitl.experiment.campaign.process_pool import (
    Failed,
    Finished,
    Lost,
    Outcome,
    ProcessPool,
    Work,
)
from sitl.experiment.campaign.run_log import MixedRunsError, usable
from sitl.experiment.settings import value_of

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


_MOST_FAILURES: Final = 5
"""After so many runs that ended in an error of the program the rest would too."""


@dataclass(slots=True)
class Campaign:
    """An experiment with its rows and seeds, and its finished runs.

    Attributes:
        experiment: all of it.
        rows: those that are wanted now.
        numbers: which seeds of each row; all of one phase.
        kept: all runs that are finished already.
        folder: where they are, for messages.
        status: where the progress is shown.
        failed: runs that ended in an error of the program, or whose workers died too often.
    """

    experiment: Experiment
    rows: tuple[Row, ...]
    numbers: range
    kept: list[Record]
    folder: Path
    status: StatusLine
    failed: list[Failed | Lost] = field(default_factory=list)
    _finished: dict[Any, Record] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Look at what is finished. Raises MixedRunsError."""
        first, last = self.numbers[0], self.numbers[-1]
        if self.experiment.phase(first) != self.phase:
            raise MixedRunsError(
                f"seeds {first} to {last} are of both phases: confirmation begins at "
                f"{self.experiment.confirmation_seed}; give other --seeds or --first-seed"
            )
        self._finished = usable(self.kept, self.experiment, self.phase, self.folder)

    @property
    def phase(self) -> Phase:
        """What the runs are for."""
        return self.experiment.phase(self.numbers[-1])

    @property
    def wanted(self) -> list[Task]:
        """All runs of the chosen rows."""
        labels = {row.label for row in self.rows}
        return [task for task in self.experiment.tasks(self.numbers) if task.row.label in labels]

    @property
    def missing(self) -> list[Task]:
        """The runs that are still to be made, in the order in which to make them."""
        finished = self._finished
        return longest_first(
            task for task in self.wanted if (task.row.label, task.number) not in finished
        )

    @property
    def records(self) -> list[Record]:
        """The finished runs of the chosen rows and seeds, in the order of rows and seeds."""
        order = {row.label: place for place, row in enumerate(self.rows)}
        keys = sorted(
            (order[label], number, label)
            for label, number in self._finished
            if label in order and number in self.numbers
        )
        return [self._finished[label, number] for _, number, label in keys]

    def run(self, pool: ProcessPool, work: Work, keep: Callable[[Record], None]) -> None:
        """Make the missing runs, and `keep` each at once."""
        tasks = self.missing
        progress = Progress(tasks)
        with closing(pool.run(work, tasks)) as outcomes:
            try:
                for outcome in outcomes:
                    self._take(outcome, progress, keep)
                    self.status.show(progress.line)
                    if len(self.failed) >= _MOST_FAILURES and not progress.simulated_s:
                        self.status.say("every run fails; the rest is not begun")
                        break
            finally:
                self.status.end()
        if tasks and progress.simulated_s:
            self.status.say(_told(progress))

    def _take(self, outcome: Outcome, progress: Progress, keep: Callable[[Record], None]) -> None:
        if isinstance(outcome, Finished):
            record, task = outcome.record, outcome.task
            keep(record)
            self._finished[task.row.label, task.number] = record
            measures = record["measures"]
            simulated_s = measures["wall_s"] * (measures["speed_up"] or 0.0)
            progress.over(task, simulated_s)
        elif isinstance(outcome, Failed):
            self.failed.append(outcome)
            progress.over(outcome.task)
            self.status.say(f"{outcome.task.name} failed: {outcome.why.strip().splitlines()[-1]}")
        elif isinstance(outcome, Lost):
            what = "it is begun again" if outcome.again else "given up"
            if not outcome.again:
                self.failed.append(outcome)
                progress.over(outcome.task)
            self.status.say(
                f"{outcome.task.name} lost its worker ({outcome.why}), "
                f"{counted(outcome.tries, 'times')}; {what}"
            )


def _told(progress: Progress) -> str:
    minutes = progress.elapsed_s / 60
    speed = progress.simulated_s / max(progress.elapsed_s, 1e-9)
    return f"{counted(progress.done, 'runs')} in {minutes:.1f} min, {speed:,.0f} x real time"
