"""What worker processes do in tests: it imports little, so that they start quickly."""

import os
import signal
import time
from pathlib import Path


def answer(task):
    return {"row": task.row.label, "number": task.number, "seed": task.seed}


def sometimes_deadly(task):
    """Number 2 kills its worker; number 3 meets a fault of the model; number 4 lacks a file."""
    if task.number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    if task.number == 3:
        raise ZeroDivisionError("the model's own fault")
    if task.number == 4:
        raise FileNotFoundError(2, "No such file or directory", "town.yaml")
    return answer(task)


def leisurely(task):
    """Marks the process that makes it, and takes its time."""
    (Path(task.folder) / f"at-{os.getpid()}").touch()
    time.sleep(0.05)  # the work itself: no test waits for anything here
    return {**answer(task), "pid": os.getpid()}
