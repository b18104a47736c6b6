"""Carries an experiment out: what is missing is run, and each finished run is kept at once.

Runs are made in processes of this machine; one whose worker dies is begun again.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from functools import partial
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Final, NamedTuple

from air_router.errors import EXPECTED, UsageError
from air_router.flight import StatusLine
from air_router.words import counted, duration_text, progress_text
from mocha_link.errors import error_text
from sitl.experiment import Experiment, Record, Row, Task, value_of

_MOST_FAILURES: Final = 5
"""After so many runs that ended in an error of the program the rest would too."""


class MixedRunsError(UsageError):
    """The finished runs belong to other settings, seeds or a phase other than those requested."""


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
        stop: What may end them early; only confirmation declares that.
        declaration: The hash of the file that declared them.

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
        self.failed: list[RunOutcome] = []
        self.stop = experiment.stop if phase == "confirmation" else None
        self.declaration = experiment.declaration
        self._rows, self._numbers = rows, numbers
        self._finished: dict[tuple[str, int], Record] = {}  # by row's label and seed's number
        known = {row.label: row for row in experiment.rows}
        for record in kept:
            if record["phase"] != phase:
                raise MixedRunsError(
                    f"{folder} holds {record['phase']} runs, and {phase} runs are requested; give "
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
    def begun(self) -> set[int]:
        """The seed numbers of which a run is there."""
        return {number for _, number in self._finished}

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

    def try_out(self, try_out: Callable[[Task], object], status: StatusLine) -> None:
        """Try one missing run of each row, before many are begun; `try_out` raises its errors."""
        for task in {task.row.label: task for task in self.missing}.values():
            status.show(partial("putting a run of '{}' together".format, task.row.label))
            try_out(task)

    def run(self, outcomes: Outcomes, keep: Callable[[Record], None], status: StatusLine) -> None:
        """Take the missing runs as they are made, and `keep` each at once."""
        count, done, began_s = len(self.missing), 0, time.monotonic()
        with closing(outcomes):
            try:
                for outcome in outcomes:
                    if outcome is not None:
                        done += not outcome.again
                        self._take(outcome, keep, status)
                    status.show(
                        partial(progress_text, done, count, "runs", time.monotonic() - began_s)
                    )
                    if len(self.failed) == done >= _MOST_FAILURES:
                        status.print_line("every run fails; the rest is not begun")
                        break
            finally:
                status.end()
        status.print_line(f"{counted(done, 'runs')} in {duration_text(time.monotonic() - began_s)}")

    def _take(
        self, outcome: RunOutcome, keep: Callable[[Record], None], status: StatusLine
    ) -> None:
        if outcome.record is not None:
            keep(outcome.record)
            self._finished[outcome.task.key] = outcome.record
            return
        text = f"{outcome.task.name} failed: {outcome.why.strip().splitlines()[-1]}"
        if outcome.again:
            text += "; it is begun again"
        else:
            self.failed.append(outcome)
        status.print_line(text)


# Processes.

_TICK_S: Final = 1.0

Work = Callable[[Task], Record]
"""Makes one run. Travels to other processes, so it is a module's own function."""


class RunOutcome(NamedTuple):
    """What became of a run.

    Attributes:
        task: which one.
        record: it is made; None: it is not.
        why: then: the error of the program, or how its worker ended.
        again: the worker was lost, and the run is begun once more.
    """

    task: Task
    record: Record | None
    why: str = ""
    again: bool = False


Outcomes = Generator[RunOutcome | None, None, None]
"""None: nothing has come for a second."""


def make_runs(
    work: Work,
    tasks: Iterable[Task],
    workers: int,
    may_begin: Callable[[Task], bool] = lambda _task: True,
) -> Outcomes:
    """Make all runs, in any order; closing the iterator ends the processes at once.

    A pool of `concurrent.futures` breaks as a whole when a worker dies, and does not report whose
    it was. So the runs that were under way then are made once more, one at a time: what dies alone
    is at fault itself, and given up. A run that may not be begun when its turn comes is left out.
    """
    waiting = deque(tasks)
    while waiting:
        for suspect in (yield from _made(work, waiting, workers, may_begin, again=True)):
            yield from _made(work, deque([suspect]), 1, may_begin, again=False)


def _made(
    work: Work,
    waiting: deque[Task],
    workers: int,
    may_begin: Callable[[Task], bool],
    *,
    again: bool,
) -> Generator[RunOutcome | None, None, list[Task]]:
    """Make runs until none is left or a worker dies; those that were under way then."""
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"))
    under_way: dict[Future[Record | str], Task] = {}
    lost: list[Task] = []
    due = _due(waiting, may_begin)
    try:
        while not lost:
            while len(under_way) < workers and (task := next(due, None)):
                under_way[_begin(pool, work, task)] = task
            if not under_way:
                break
            done = wait(under_way, _TICK_S, FIRST_COMPLETED).done
            if not done:
                yield None
            for future in done:
                task = under_way.pop(future)
                error = future.exception()
                if error:
                    lost.append(task)
                    yield RunOutcome(task, None, str(error), again)
                elif isinstance(made := future.result(), str):
                    yield RunOutcome(task, None, made)
                else:
                    yield RunOutcome(task, made)
        for task in under_way.values():
            yield RunOutcome(task, None, "a worker beside it ended", again)
        return [*lost, *under_way.values()]
    finally:
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        # Its thread joins them. One that both join, each may take for alive.
        pool.shutdown(cancel_futures=True)


def _due(waiting: deque[Task], may_begin: Callable[[Task], bool]) -> Iterator[Task]:
    """Take the runs that may be begun when their turn comes."""
    while waiting:
        task = waiting.popleft()
        if may_begin(task):
            yield task


def _begin(pool: ProcessPoolExecutor, work: Work, task: Task) -> Future[Record | str]:
    # The parent decides what Ctrl-C means: a worker inherits a blocked SIGINT, from its first
    # moment on. The tracker, which the first start would start, lets signals through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return pool.submit(attempt, work, task)
    except BrokenProcessPool as error:  # before the results of the others showed it
        broken: Future[Record | str] = Future()
        broken.set_exception(error)
        return broken
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def attempt(work: Work, task: Task) -> Record | str:
    """The run, or what went wrong in it: not every error travels."""
    try:
        return work(task)
    except EXPECTED as error:
        return error_text(error)
    except Exception:  # noqa: BLE001 - whatever it is, it is reported, and others go on
        return traceback.format_exc()
