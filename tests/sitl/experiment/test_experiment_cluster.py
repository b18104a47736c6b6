"""Two workers of a Dask scheduler on this machine; one is killed in the middle, no run is lost."""

import contextlib
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import light_work
import pytest

from air_router.errors import ExitCode, exit_code
from sitl.experiment.campaign.plan import Row, Task
from sitl.experiment.campaign.worker_pool import Failed, Finished, News, Tick

pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")

from distributed.scheduler import KilledWorker

from sitl.experiment.campaign.dask_pool import ClusterError, DaskPool

pytestmark = pytest.mark.foreign_process

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
PATHS = {"PYTHONPATH": f"{ROOT}{os.pathsep}{HERE}"}


@contextlib.contextmanager
def started(module, *words):
    """A program of Dask's; ended at the end."""
    with subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.{module}", *words, "--no-dashboard"],
        env={**os.environ, **PATHS},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture(scope="module")
def address():
    """Of a scheduler with two workers."""
    with contextlib.ExitStack() as stack:
        words = ("dask_scheduler", "--host", "127.0.0.1", "--port", "0")
        scheduler = stack.enter_context(started(*words))
        found = (re.search(r"Scheduler at: *(tcp://\S+)", line) for line in scheduler.stderr)
        tcp = next(match[1] for match in found if match)
        for _ in range(2):
            stack.enter_context(started("dask_worker", tcp, "--no-nanny", "--nthreads", "1"))
        yield tcp


def tasks(folder, count):
    row = Row("a row", {"ugvs": 3})
    return [Task("try", row, number, 1000 + number, str(folder)) for number in range(count)]


def test_no_run_is_lost_when_a_worker_is_killed(address, tmp_path):
    pool = DaskPool(address)
    finished, killed = [], None
    try:
        pool._client.wait_for_workers(2, timeout=60)
        for outcome in pool.run(light_work.leisurely, tasks(tmp_path, 40)):
            assert isinstance(outcome, Finished | News | Tick), outcome
            if isinstance(outcome, Finished):
                finished.append(outcome)
            if len(finished) == 10 and killed is None:
                killed = finished[-1].record["pid"]
                os.kill(killed, signal.SIGKILL)
    finally:
        pool.close()
    assert sorted(outcome.task.number for outcome in finished) == list(range(40))
    assert all(outcome.record["seed"] == outcome.task.seed for outcome in finished)
    pids = [outcome.record["pid"] for outcome in finished]
    assert len(set(pids)) == 2
    assert killed not in pids[-5:]


def test_a_run_that_fails_is_told(address, tmp_path):
    pool = DaskPool(address)
    try:
        outcomes = list(pool.run(light_work.sometimes_deadly, tasks(tmp_path, 4)[3:]))
    finally:
        pool.close()
    (failed,) = [o for o in outcomes if isinstance(o, Failed)]
    assert "ZeroDivisionError: the model's own fault" in failed.why


def test_a_run_that_dask_gives_up_is_told_and_not_begun_again(address, tmp_path):
    pool = DaskPool(address)
    (task,) = tasks(tmp_path, 1)
    pool._client.submit = lambda *_, **__: Ended("error")
    deadly = list(pool.run(light_work.answer, [task]))
    pool._client.submit = lambda *_, **__: Ended("lost")
    with pytest.raises(ClusterError, match="is gone; begin again when it is back"):
        list(pool.run(light_work.answer, [task]))
    pool.close()
    (lost,) = deadly
    assert (lost.task, lost.tries, lost.again) == (task, 4, False)
    assert "tcp://10.0.0.7:1" in lost.why


class Ended:
    """What became of a run that killed four workers."""

    def __init__(self, status):
        self.status = status

    def add_done_callback(self, tell):
        tell(self)

    def exception(self):
        return KilledWorker("run-1", SimpleNamespace(address="tcp://10.0.0.7:1"), 3)


def test_a_scheduler_that_is_not_there_is_told():
    with pytest.raises(ClusterError, match="no Dask scheduler answers at tcp://127") as error:
        DaskPool("tcp://127.0.0.1:9", connect_s=0.3)
    assert exit_code(error.value) is ExitCode.NO_VEHICLE
