"""Makes runs in processes of this machine; one whose worker dies is begun again.

A pool of `concurrent.futures` breaks as a whole when a worker dies, and does not tell whose it was.
So the runs that were under way then are made once more, one at a time: what dies alone is at fault
itself, and given up.
"""

from __future__ import annotations

import multiprocessing
import signal
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from typing import Final, NamedTuple

from air_router.errors import EXPECTED
from mocha_link.errors import told
from sitl.experiment.plan import Record, Task

_TICK_S: Final = 1.0

Work = Callable[[Task], Record]
"""Makes one run. Travels to other processes, so it is a module's own function."""


class Outcome(NamedTuple):
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


Outcomes = Generator[Outcome | None, None, None]
"""None: nothing has come for a second."""


def make_runs(work: Work, tasks: Iterable[Task], workers: int) -> Outcomes:
    """Make all runs, in any order; closing the iterator ends the processes at once."""
    waiting = deque(tasks)
    while waiting:
        for suspect in (yield from _made(work, waiting, workers, again=True)):
            yield from _made(work, deque([suspect]), 1, again=False)


def _made(
    work: Work, waiting: deque[Task], workers: int, *, again: bool
) -> Generator[Outcome | None, None, list[Task]]:
    """Make runs until none is left or a worker dies; those that were under way then."""
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"))
    under_way: dict[Future[Record | str], Task] = {}
    lost: list[Task] = []
    try:
        while (waiting or under_way) and not lost:
            while waiting and len(under_way) < workers:
                task = waiting.popleft()
                under_way[_begin(pool, work, task)] = task
            done = wait(under_way, _TICK_S, FIRST_COMPLETED).done
            if not done:
                yield None
            for future in done:
                task = under_way.pop(future)
                error = future.exception()
                if error:
                    lost.append(task)
                    yield Outcome(task, None, str(error), again)
                elif isinstance(made := future.result(), str):
                    yield Outcome(task, None, made)
                else:
                    yield Outcome(task, made)
        for task in under_way.values():
            yield Outcome(task, None, "a worker beside it ended", again)
        return [*lost, *under_way.values()]
    finally:
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        # Its thread joins them. One that both join, each may take for alive.
        pool.shutdown(cancel_futures=True)


def _begin(pool: ProcessPoolExecutor, work: Work, task: Task) -> Future[Record | str]:
    # The parent decides what Ctrl-C means: a worker inherits that it does not hear of it, from its
    # first moment on. The tracker, which the first start would start, lets signals through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return pool.submit(_attempt, work, task)
    except BrokenProcessPool as error:  # before the results of the others said so
        broken: Future[Record | str] = Future()
        broken.set_exception(error)
        return broken
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _attempt(work: Work, task: Task) -> Record | str:
    """The run, or what went wrong in it: not every error travels."""
    try:
        return work(task)
    except EXPECTED as error:
        return told(error)
    except Exception:  # noqa: BLE001 - whatever it is, it is told, and others go on
        return traceback.format_exc()
