"""Runs on the workers of a dask.distributed cluster, through the interface of `concurrent.futures`.

    dask scheduler                                  # somewhere
    dask worker ADDRESS --nthreads 1 --nworkers 8   # on each machine, from the same checkout
    sitl experiment table1 --cluster ADDRESS

The scheduler gives a run of a worker that died to another one; a run whose workers died several
times is given up, and the others go on. Workers may come and go meanwhile.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import dataclass
from typing import Any, Final

from air_router.errors import AirRouterError, ExitCode
from mocha_link.errors import needs_extra
from sitl.experiment import Record, Task
from sitl.experiment.campaign.campaign import Outcomes, RunOutcome, Work, attempt
from sitl.experiment.campaign.provenance import program

_TICK_S: Final = 1.0
_WAITING: Final = 2
"""So many runs per thread are with the cluster, so that no worker waits for the next."""


class ClusterError(AirRouterError):
    """The cluster cannot be used."""

    exit_code = ExitCode.REFUSED


@dataclass(frozen=True, slots=True)
class Cluster:
    """A cluster that makes runs.

    Attributes:
        executor: Gives them to its workers.
        most: How many runs to give it at a time, as of now.
    """

    executor: Executor
    most: Callable[[], int]

    def make_runs(
        self,
        work: Work,
        tasks: Iterable[Task],
        may_begin: Callable[[Task], bool] = lambda _task: True,
    ) -> Outcomes:
        """Make all runs, in any order; closing the iterator cancels what is not made yet.

        Args:
            work: Makes one.
            tasks: All of them.
            may_begin: Whether a run may be begun now; else it is left out.
        """
        waiting = deque(tasks)
        under_way: dict[Future[Record | str], Task] = {}
        try:
            while waiting or under_way:
                while waiting and len(under_way) < self.most():
                    task = waiting.popleft()
                    if may_begin(task):
                        under_way[self.executor.submit(attempt, work, task)] = task
                done = wait(under_way, _TICK_S, FIRST_COMPLETED).done if under_way else ()
                if not done:
                    yield None
                for future in done:
                    yield _outcome(under_way.pop(future), future)
        finally:
            for future in under_way:
                future.cancel()


def _outcome(task: Task, future: Future[Record | str]) -> RunOutcome:
    try:
        made = future.result()
    except (Exception, CancelledError) as error:  # noqa: BLE001 - the cluster's, of a dead worker
        return RunOutcome(task, None, f"{type(error).__name__}: {error}")
    if isinstance(made, str):
        return RunOutcome(task, None, made)
    return RunOutcome(task, made)


@contextlib.contextmanager
def cluster_at(
    address: str, *, sources: str | None = None, connect_s: float = 10.0
) -> Iterator[Cluster]:
    """The cluster whose scheduler is at an address, `tcp://HOST:8786`, for as long as it is used.

    Args:
        address: The scheduler's.
        sources: What its workers have to run (`program`); None: the same as this program.
        connect_s: For how long to try.

    Raises:
        MissingExtraError: dask.distributed is not installed.
        ClusterError: no scheduler answers, it has no workers, or these have other sources.
    """
    with needs_extra("a campaign on a cluster", "cluster", "air-router"):
        from distributed import Client  # noqa: PLC0415 - an extra
    try:
        client: Any = Client(address, timeout=connect_s, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterError(f"{address}: no scheduler answers ({error}); `dask scheduler`") from None
    with client:
        _check_workers(address, client.run(program), sources or program())
        executor = client.get_executor(pure=False)

        def most() -> int:
            threads: int = sum(client.nthreads().values())
            return max(1, _WAITING * threads)

        yield Cluster(executor, most)
        executor.shutdown(wait=False)


def _check_workers(address: str, programs: Mapping[str, str], sources: str) -> None:
    """Raises ClusterError: there are none, or runs of them would be of another program."""
    if not programs:
        raise ClusterError(f"{address} has no workers; `dask worker {address} --nthreads 1`")
    others = sorted(worker for worker, own in programs.items() if own != sources)
    if others:
        raise ClusterError(
            f"{', '.join(others)}: a worker of {address} runs {programs[others[0]]}, and this is "
            f"{sources}; start its workers from the same sources"
        )
