"""Carries an experiment out: what is missing is run, and each finished run is kept at once."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from air_router.counted import counted
from air_router.flight.terminal import StatusLine
from sitl.experiment.campaign.process_pool import Failed, Finished, Lost, Outcome, ProcessPool, Work
from sitl.experiment.campaign.runs import MixedRunsError, usable
from sitl.experiment.plan import Experiment, Phase, Record, Row, Task
from sitl.experiment.settings import value_of

_BAR: Final = 24
_MOST_FAILURES: Final = 5
"""After so many runs that ended in an error of the program the rest would too."""


@dataclass(slots=True)
class Progress:
    """Counts finished runs; the rest is taken to cost as much each as what is done.

    Attributes:
        count: how many are to be made.
        monotonic: a steady clock, in seconds.
        done: how many are over.
        simulated_s: of those that were made, together.
    """

    count: int
    monotonic: Callable[[], float] = time.monotonic
    done: int = 0
    simulated_s: float = 0.0
    _began_s: float = field(init=False)

    def __post_init__(self) -> None:
        self._began_s = self.monotonic()

    def over(self, simulated_s: float = 0.0) -> None:
        """A run is made, or given up."""
        self.done += 1
        self.simulated_s += simulated_s

    def line(self) -> str:
        """The state of things in one line."""
        full = round(_BAR * self.done / max(self.count, 1))
        text = f"[{'#' * full}{'.' * (_BAR - full)}] {self.done} of {self.count} runs"
        elapsed_s = self.monotonic() - self._began_s
        if 0 < self.done < self.count:
            text += f", about {in_words(elapsed_s * (self.count / self.done - 1))} left"
        speed = f", {self.simulated_s / max(elapsed_s, 1e-9):,.0f} x real time"
        return text + (speed if self.simulated_s else "")

    def result(self) -> str:
        """What was made, and how fast."""
        elapsed_s = max(self.monotonic() - self._began_s, 1e-9)
        made = f"{counted(self.done, 'runs')} in {elapsed_s / 60:.1f} min"
        return f"{made}, {self.simulated_s / elapsed_s:,.0f} x real time"


def in_words(time_s: float) -> str:
    """A time as people say it."""
    if time_s < 90:
        return f"{time_s:.0f} s"
    if time_s < 5400:
        return f"{time_s / 60:.0f} min"
    return f"{time_s / 3600:.1f} h"


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
        failed: runs that ended in an error of the program, or whose workers died.

    Raises:
        MixedRunsError: the numbers are of both phases, or what is kept is of other settings.
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
        """The runs that are still to be made.

        Each round of seeds has its largest teams first, so that no long run is left to the end.
        """

        def robots(task: Task) -> int:
            return sum(value_of(task.row.settings, key) for key in ("uavs", "ugvs"))

        missing = [t for t in self.wanted if (t.row.label, t.number) not in self._finished]
        return sorted(missing, key=lambda task: (task.number, -robots(task)))

    @property
    def records(self) -> list[Record]:
        """The finished runs of the chosen rows and seeds, in the order of rows and seeds."""
        keys = [(row.label, number) for row in self.rows for number in self.numbers]
        return [self._finished[key] for key in keys if key in self._finished]

    def run(self, pool: ProcessPool, work: Work, keep: Callable[[Record], None]) -> None:
        """Make the missing runs, and `keep` each at once."""
        tasks = self.missing
        progress = Progress(len(tasks))
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
        if progress.simulated_s:
            self.status.say(progress.result())

    def _take(self, outcome: Outcome, progress: Progress, keep: Callable[[Record], None]) -> None:
        match outcome:
            case Finished(task, record):
                keep(record)
                self._finished[task.row.label, task.number] = record
                measures = record["measures"]
                progress.over(measures["wall_s"] * (measures["speed_up"] or 0.0))
            case Lost(task, why, again=True):
                self.status.say(f"{task.name} lost its worker ({why}); it is begun again")
            case Lost(task, why):
                self.failed.append(outcome)
                progress.over()
                self.status.say(f"{task.name} lost its worker ({why}) again; given up")
            case Failed(task, why):
                self.failed.append(outcome)
                progress.over()
                self.status.say(f"{task.name} failed: {why.strip().splitlines()[-1]}")
