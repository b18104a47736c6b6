"""Runs in processes: one that dies is noticed, reported and made again; Ctrl-C ends them all."""

import multiprocessing
import os
import signal
from multiprocessing.context import SpawnProcess

import light_work

from sitl.experiment.campaign.campaign import make_runs
from sitl.experiment.plan import Row, Task


def tasks(folder, numbers):
    row = Row("a row", {"ugvs": 3})
    return [Task("try", row, number, 1000 + number, str(folder)) for number in numbers]


def test_a_run_whose_worker_dies_is_made_once_more_and_those_beside_it_are_made_after_all(tmp_path):
    outcomes = list(
        filter(None, make_runs(light_work.sometimes_deadly, tasks(tmp_path, (2, 0, 3, 4)), 2))
    )
    assert [outcome.record["seed"] for outcome in outcomes if outcome.record] == [1000]
    lost = [outcome for outcome in outcomes if outcome.again]
    failed = {o.task.number: o.why for o in outcomes if not (o.record or o.again)}
    assert 2 in {outcome.task.number for outcome in lost}
    assert failed.keys() == {2, 3, 4}  # no bystander is given up
    assert "terminated abruptly" in failed[2]
    assert "in sometimes_deadly" in failed[3]
    assert "ZeroDivisionError: the model's own fault" in failed[3]
    assert failed[4] == "town.yaml: No such file or directory"


def finished(outcomes):
    """The next run that is made, however long its worker takes to start."""
    return next(outcome for outcome in outcomes if outcome and outcome.record)


def test_closing_ends_the_processes_and_nothing_else_does(tmp_path, monkeypatch):
    start = SpawnProcess.start

    def interrupted(process):
        """The terminal's Ctrl-C comes while a worker still starts."""
        start(process)
        os.kill(process.pid, signal.SIGINT)

    monkeypatch.setattr(SpawnProcess, "start", interrupted)
    outcomes = make_runs(light_work.leisurely, tasks(tmp_path, range(40)), 2)
    assert finished(outcomes)
    workers = multiprocessing.active_children()
    assert len(workers) == 2
    for worker in workers:
        os.kill(worker.pid, signal.SIGINT)  # as the terminal does: they leave it to the parent
    assert finished(outcomes)
    outcomes.close()
    assert multiprocessing.active_children() == []
