"""Runs many measurements at once; they mostly wait."""

import signal
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from benchmarks.link.budget import Budget
from benchmarks.link.cell import PROCESSES, Task, measure
from benchmarks.link.namespaces import EmulationError, end_with_parent
from benchmarks.link.score import Score

AT_ONCE = 40  # links; a process for each and one for each of its nodes


@dataclass(slots=True)
class _Cell:
    task: Task
    process: Any
    result: Connection


def run(
    tasks: Sequence[Task],
    *,
    cores: float | None = None,
    failed: Callable[[Task, str], None],
) -> Iterator[tuple[Task, Score]]:
    """Measure all tasks, the longest first, as many at once as the machine bears.

    Raises:
        EmulationError: this machine does not let us emulate links.
    """
    budget = Budget(PROCESSES, cores)
    waiting = sorted(tasks, key=lambda task: task.link.duration_s)
    cells: list[_Cell] = []
    try:
        while waiting or cells:
            if waiting and len(cells) < AT_ONCE:
                cells.append(_begin(waiting.pop(), budget))
                continue
            ready = wait([cell.result for cell in cells])
            for cell in [cell for cell in cells if cell.result in ready]:
                cells.remove(cell)
                outcome = _end(cell)
                if isinstance(outcome, Score):
                    yield cell.task, outcome
                else:
                    failed(cell.task, outcome)
    finally:
        for cell in cells:
            cell.process.terminate()
            cell.process.join()


def _begin(task: Task, budget: Budget) -> _Cell:
    result, theirs = PROCESSES.Pipe(duplex=False)
    process = PROCESSES.Process(target=_cell, args=(task, budget, theirs))
    process.start()
    theirs.close()
    return _Cell(task, process, result)


def _end(cell: _Cell) -> Score | str:
    try:
        outcome = cell.result.recv()
    except EOFError:
        outcome = "the measuring process is gone"
    cell.result.close()
    cell.process.join()
    if isinstance(outcome, EmulationError):
        raise outcome
    return outcome if isinstance(outcome, Score) else str(outcome)


def _cell(task: Task, budget: Budget, result: Connection) -> None:
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the command itself ends all
    try:
        result.send(measure(task, budget))
    except EmulationError as error:
        result.send(error)
    except Exception:  # noqa: BLE001 - the runner reports it
        result.send(traceback.format_exc())
