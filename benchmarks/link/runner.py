"""Runs many measurements at once; they mostly wait."""

import os
import signal
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from benchmarks.link.cell import PROCESSES, Task, measure
from benchmarks.link.namespaces import EmulationError, end_with_parent
from benchmarks.link.score import Score

# What a link asks of the machine while it is up, in shares of what we let run at once: found by
# looking at how late the emulators are. 10 Mbit/s are 830 packets a second each way.
_WEIGHTS = {10e6: 4.0, 1e6: 1.5, 0.25e6: 1.0}
PER_CORE = 14.0


@dataclass(slots=True)
class _Cell:
    task: Task
    process: Any
    result: Connection


def run(
    tasks: Sequence[Task],
    *,
    weight: float | None = None,
    failed: Callable[[Task, str], None],
) -> Iterator[tuple[Task, Score]]:
    """Measure all tasks, the longest first, as many at once as the machine bears.

    Raises:
        EmulationError: this machine does not let us emulate links.
    """
    room = weight or PER_CORE * (os.cpu_count() or 1)
    waiting = sorted(tasks, key=lambda task: -task.link.duration_s)
    cells: list[_Cell] = []
    try:
        while waiting or cells:
            used = sum(_weight(cell.task) for cell in cells)
            fits = (n for n, task in enumerate(waiting) if used + _weight(task) <= room)
            number = next(fits, None if cells else 0)
            if number is not None and waiting:
                cells.append(_begin(waiting.pop(number)))
                time.sleep(0.05)  # not all contacts at the same moments
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


def _weight(task: Task) -> float:
    if task.small:
        return 1.0
    return _WEIGHTS.get(task.link.rate_bit_s, 4.0)


def _begin(task: Task) -> _Cell:
    result, theirs = PROCESSES.Pipe(duplex=False)
    process = PROCESSES.Process(target=_cell, args=(task, theirs))
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


def _cell(task: Task, result: Connection) -> None:
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the command itself says so to all
    try:
        result.send(measure(task))
    except EmulationError as error:
        result.send(error)
    except Exception:  # noqa: BLE001 - the runner tells it
        result.send(traceback.format_exc())
