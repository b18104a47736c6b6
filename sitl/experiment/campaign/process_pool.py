"""Makes runs in processes of this machine, and notices when one of them dies.

Each worker has a pipe of its own, so it is known which run a dead worker had. A worker whose
parent is gone finds its pipe closed and ends too.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import traceback
from collections import deque
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Final

from air_router.errors import EXPECTED, told
from sitl.experiment.campaign.plan import Task
from sitl.experiment.campaign.worker_pool import (
    MOST_TRIES,
    TICK_S,
    Failed,
    Finished,
    Lost,
    Outcome,
    Record,
    Tick,
    Work,
)

_END_S: Final = 2.0


@dataclass(slots=True)
class _Worker:
    process: SpawnProcess
    line: Connection
    task: Task | None = None


@dataclass(slots=True)
class ProcessPool:
    """A pool of processes.

    Attributes:
        workers: how many.
        most_tries: how often a run is begun whose worker dies.
    """

    workers: int
    most_tries: int = MOST_TRIES
    _tries: dict[Task, int] = field(default_factory=dict)

    def run(self, work: Work, tasks: Sequence[Task]) -> Generator[Outcome, None, None]:
        """Make all runs; closing the iterator ends the processes at once."""
        waiting = deque(tasks)
        context = multiprocessing.get_context("spawn")
        pool = [_hire(context, work) for _ in range(min(self.workers, len(tasks)))]
        try:
            while waiting or any(worker.task for worker in pool):
                for worker in pool:
                    if worker.task is None and waiting:
                        worker.task = waiting.popleft()
                        _send(worker, worker.task)
                ready = _ready(pool)
                if not ready:
                    yield Tick()
                for worker in ready:
                    outcome = self._heard(worker)
                    if isinstance(outcome, Lost):
                        pool[pool.index(worker)] = _hire(context, work)
                        if outcome.again:
                            waiting.append(outcome.task)
                    yield outcome
        finally:
            _dismiss(pool)

    def _heard(self, worker: _Worker) -> Outcome:
        task, worker.task = worker.task, None
        if task is None:
            raise AssertionError("an idle worker says nothing")
        try:
            good, answer = worker.line.recv()
        except (EOFError, OSError):
            _end(worker)
            tries = self._tries[task] = self._tries.get(task, 0) + 1
            why = _last_words(worker.process.exitcode)
            return Lost(task, tries, why, again=tries < self.most_tries)
        return Finished(task, answer) if good else Failed(task, str(answer))


def _hire(context: SpawnContext, work: Work) -> _Worker:
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, work), daemon=True)
    # The parent decides what Ctrl-C means: a worker inherits that it does not hear of it, from its
    # first moment on. The tracker, which the first start would start, lets signals through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    theirs.close()  # so that only the worker's own end keeps the pipe open
    return _Worker(process, ours)


def _ready(pool: Sequence[_Worker]) -> list[_Worker]:
    busy = {worker.line: worker for worker in pool if worker.task is not None}
    return [busy[line] for line in wait(list(busy), TICK_S) if isinstance(line, Connection)]


def _send(worker: _Worker, task: Task) -> None:
    with contextlib.suppress(OSError):  # it is dead: the same pipe tells us next
        worker.line.send(task)


def _serve(line: Connection, work: Work) -> None:
    """The worker: runs until its pipe is closed."""
    answer: tuple[bool, Record | str]
    while True:
        try:
            task = line.recv()
        except EOFError:
            return
        try:
            answer = (True, work(task))
        except EXPECTED as error:
            answer = (False, told(error))
        except Exception:  # noqa: BLE001 - whatever it is, it is told, and others go on
            answer = (False, traceback.format_exc())
        try:
            line.send(answer)
        except OSError:
            return


def _dismiss(pool: Sequence[_Worker]) -> None:
    for worker in pool:
        worker.line.close()
        if worker.task is not None:
            worker.process.terminate()
    for worker in pool:
        _end(worker)


def _end(worker: _Worker) -> None:
    worker.line.close()
    worker.process.join(_END_S)
    if worker.process.is_alive():
        worker.process.kill()
        worker.process.join()


def _last_words(exit_code: int | None) -> str:
    if exit_code is not None and exit_code < 0:
        return f"its process was ended by {signal.Signals(-exit_code).name}"
    return f"its process ended with code {exit_code}"
