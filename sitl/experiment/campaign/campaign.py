"""Carries an experiment out: what is missing is run, and each finished run is kept at once."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Final

from air_router.counted import counted
from air_router.errors import UsageError
from air_router.flight.terminal import StatusLine
from sitl.experiment.campaign.process_pool import Outcome, Outcomes
from sitl.experiment.plan import Experiment, Record, Row, Task
from sitl.experiment.settings import value_of

_BAR: Final = 24
_MOST_FAILURES: Final = 5
"""After so many runs that ended in an error of the program the rest would too."""


class MixedRunsError(UsageError):
    """The finished runs belong to other settings, seeds or a phase other than what is asked for."""


class Campaign:
    """An experiment with its rows and seeds, and its finished runs.

    Args:
        experiment: All of it.
        rows: Those that are wanted now.
        numbers: Which seeds of each row; all of one phase.
        kept: All runs that are finished already.
        folder: Where they are, for messages.

    Attributes:
        wanted: All runs of the chosen rows.
        failed: Runs that ended in an error of the program, or whose workers died.

    Raises:
        MixedRunsError: the numbers are of both phases; what is kept is of the other one; or rows of
            the same name were run with other settings, or with other seeds: what the file's rows
            differ in, what is paired, or where confirmation begins has changed.
    """

    def __init__(
        self,
        experiment: Experiment,
        rows: tuple[Row, ...],
        numbers: range,
        kept: list[Record],
        folder: Path,
    ) -> None:
        first, last = numbers[0], numbers[-1]
        phase = experiment.phase(last)
        if experiment.phase(first) != phase:
            raise MixedRunsError(
                f"seeds {first} to {last} are of both phases: confirmation begins at "
                f"{experiment.confirmation_seed}; give other --seeds or --first-seed"
            )
        labels = {row.label for row in rows}
        self.wanted = [task for task in experiment.tasks(numbers) if task.row.label in labels]
        self.failed: list[Outcome] = []
        self._rows, self._numbers = rows, numbers
        self._finished: dict[tuple[str, int], Record] = {}  # by row's label and seed's number
        known = {row.label: row for row in experiment.rows}
        for record in kept:
            if record["phase"] != phase:
                raise MixedRunsError(
                    f"{folder} holds {record['phase']} runs, and {phase} runs are asked for; give "
                    "another --out"
                )
            if row := known.get(record["row"]):
                task = experiment.task(row, record["number"])
                if any(record[key] != own for key, own in task.identity.items()):
                    raise MixedRunsError(
                        f"{folder} holds runs of row '{row.label}' with other settings or seeds; "
                        "give another --out, or begin anew with --fresh"
                    )
                self._finished[row.label, task.number] = record

    @property
    def missing(self) -> list[Task]:
        """The runs that are still to be made.

        Each round of seeds has its largest teams first, so that no long run is left to the end.
        """

        def robots(task: Task) -> int:
            return sum(value_of(task.row.settings, key) for key in ("uavs", "ugvs"))

        missing = [task for task in self.wanted if task.key not in self._finished]
        return sorted(missing, key=lambda task: (task.number, -robots(task)))

    @property
    def records(self) -> list[Record]:
        """The finished runs of the chosen rows and seeds, in the order of rows and seeds."""
        keys = [(row.label, number) for row in self._rows for number in self._numbers]
        return [self._finished[key] for key in keys if key in self._finished]

    def run(self, outcomes: Outcomes, keep: Callable[[Record], None], status: StatusLine) -> None:
        """Take the missing runs as they are made, and `keep` each at once."""
        count, done, began_s = len(self.missing), 0, time.monotonic()
        with closing(outcomes):
            try:
                for outcome in outcomes:
                    if outcome is not None:
                        done += not outcome.again
                        self._take(outcome, keep, status)
                    status.show(partial(progress, done, count, time.monotonic() - began_s))
                    if len(self.failed) == done >= _MOST_FAILURES:
                        status.say("every run fails; the rest is not begun")
                        break
            finally:
                status.end()
        status.say(f"{counted(done, 'runs')} in {in_words(time.monotonic() - began_s)}")

    def _take(self, outcome: Outcome, keep: Callable[[Record], None], status: StatusLine) -> None:
        if outcome.record is not None:
            keep(outcome.record)
            self._finished[outcome.task.key] = outcome.record
            return
        told = f"{outcome.task.name} failed: {outcome.why.strip().splitlines()[-1]}"
        if outcome.again:
            told += "; it is begun again"
        else:
            self.failed.append(outcome)
        status.say(told)


def progress(done: int, count: int, elapsed_s: float) -> str:
    """How far it is, in one line; the rest is taken to cost as much each as what is done."""
    full = round(_BAR * done / max(count, 1))
    text = f"[{'#' * full}{'.' * (_BAR - full)}] {done} of {counted(count, 'runs')}"
    left = f", about {in_words(elapsed_s * (count / done - 1))} left" if 0 < done < count else ""
    return text + left


def in_words(time_s: float) -> str:
    """A time as people say it."""
    if time_s < 90:
        return f"{time_s:.0f} s"
    if time_s < 5400:
        return f"{time_s / 60:.0f} min"
    return f"{time_s / 3600:.1f} h"
