"""Runs in processes: one that dies is noticed, told and made again; Ctrl-C ends them all."""

import multiprocessing
import os
import signal
from collections import Counter
from multiprocessing.context import SpawnProcess

import light_work

from sitl.experiment.campaign.plan import Row, Task
from sitl.experiment.campaign.process_pool import Failed, Finished, Lost, ProcessPool


def tasks(folder, count=6):
    row = Row("a row", {"ugvs": 3})
    return [Task("try", row, number, 1000 + number, str(folder)) for number in range(count)]


def test_a_run_whose_worker_dies_is_told_and_made_again(tmp_path):
    pool = ProcessPool(2, most_tries=2)
    outcomes = list(pool.run(light_work.sometimes_deadly, tasks(tmp_path)))
    by_kind = {kind: [o for o in outcomes if isinstance(o, kind)] for kind in (Finished, Lost)}
    assert sorted(o.task.number for o in by_kind[Finished]) == [0, 1, 5]
    assert all(o.record["seed"] == o.task.seed for o in by_kind[Finished])
    lost = Counter((o.task.number, o.again) for o in by_kind[Lost])
    assert lost[2, False] == 1
    assert lost[1, True] in {1, 2}  # once more if the other one died first
    assert {number for number, again in lost if not again} == {2}  # no bystander is given up
    assert "terminated abruptly" in by_kind[Lost][0].why
    failed = {o.task.number: o.why for o in outcomes if isinstance(o, Failed)}
    assert failed.keys() == {3, 4}
    assert "in sometimes_deadly" in failed[3]
    assert "ZeroDivisionError: the model's own fault" in failed[3]
    assert failed[4] == "town.yaml: No such file or directory"


def finished(outcomes):
    """The next run that is made, however long its worker takes to start."""
    return next(outcome for outcome in outcomes if isinstance(outcome, Finished))


def test_closing_ends_the_processes_and_nothing_else_does(tmp_path, monkeypatch):
    start = SpawnProcess.start

    def interrupted(process):
        """The terminal's Ctrl-C comes while a worker still starts."""
        start(process)
        os.kill(process.pid, signal.SIGINT)

    monkeypatch.setattr(SpawnProcess, "start", interrupted)
    outcomes = ProcessPool(2).run(light_work.leisurely, tasks(tmp_path, 40))
    assert finished(outcomes)
    workers = multiprocessing.active_children()
    assert len(workers) == 2
    for worker in workers:
        os.kill(worker.pid, signal.SIGINT)  # as the terminal does: they leave it to the parent
    assert finished(outcomes)
    outcomes.close()
    assert multiprocessing.active_children() == []
