"""Runs on a dask.distributed cluster on loopback: what a dead worker had is made by another."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import light_work
import pytest

from mocha_link.errors import MissingExtraError
from sitl.experiment.campaign.cluster import ClusterError, cluster_at
from sitl.experiment.plan import Row, Task
from tests.distributions import ROOT

distributed = pytest.importorskip("distributed")
HERE = str(Path(__file__).parent)
pytestmark = [pytest.mark.foreign_process, pytest.mark.xdist_group("cluster")]


def tasks(folder, numbers):
    row = Row("a row", {"ugvs": 3})
    return [Task("try", row, number, 1000 + number, str(folder)) for number in numbers]


@contextlib.contextmanager
def programs(folder, workers):
    """A scheduler and workers, as a user starts them; yields address and the workers' processes."""
    path = os.pathsep.join([str(ROOT), HERE])
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONWARNINGS": "ignore"}
    address = folder / "scheduler.json"
    with contextlib.ExitStack() as stack:

        def start(*arguments):
            process = subprocess.Popen(
                [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]],
                env=environment,
                cwd=folder,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            stack.callback(process.wait, 30)
            stack.callback(process.kill)
            return process

        file = ("--scheduler-file", str(address))
        start("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", *file)
        quiet = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")
        started = [start("dask_worker", *quiet, *file) for _ in range(workers)]
        with distributed.Client(scheduler_file=str(address), set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=60)
            yield client.scheduler.address, started


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    """Address and workers of a cluster of two."""
    with programs(tmp_path_factory.mktemp("cluster"), 2) as found:
        yield found


def test_a_fault_of_a_run_is_its_own(started, tmp_path):
    with cluster_at(started[0]) as many:
        made = many.make_runs(light_work.sometimes_deadly, tasks(tmp_path, (3, 4, 5)))
        found = {outcome.task.number: outcome for outcome in filter(None, made)}
    assert "ZeroDivisionError: the model's own fault" in found[3].why
    assert found[4].why == "town.yaml: No such file or directory"
    assert found[5].record["seed"] == 1005


def test_a_run_that_may_not_be_begun_is_left_out(started, tmp_path):
    with cluster_at(started[0]) as many:
        wanted = tasks(tmp_path, (7, 8))
        made = many.make_runs(light_work.answer, wanted, lambda task: task.number == 8)
        assert [outcome.task.number for outcome in filter(None, made)] == [8]


def test_workers_of_other_sources_are_refused(started):
    with (
        pytest.raises(ClusterError, match="start its workers from the same sources"),
        cluster_at(started[0], sources="another"),
    ):
        pass


def test_a_dead_worker_loses_nothing(started, tmp_path):
    address, workers = started
    wanted = tasks(tmp_path, range(40))
    with cluster_at(address) as many:
        made, pids = {}, set()
        for outcome in filter(None, many.make_runs(light_work.leisurely, wanted)):
            assert outcome.record, outcome.why
            made[outcome.task.number] = outcome.record["seed"]
            pids.add(outcome.record["pid"])
            if len(made) == 5:
                workers[0].send_signal(signal.SIGKILL)
    assert made == {task.number: task.seed for task in wanted}
    assert workers[1].pid in pids


def test_without_a_scheduler_there_is_one_clear_error():
    with (
        pytest.raises(ClusterError, match="no scheduler answers"),
        cluster_at("tcp://127.0.0.1:1", connect_s=0.5),
    ):
        pass


def test_without_the_package_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match="cluster"), cluster_at("tcp://127.0.0.1:1"):
        pass
