"""Makes runs on the workers of a Dask scheduler: one machine or many.

Needs `distributed` (extra `cluster`). Every worker has this program installed in the same version.
Dask gives the runs of a worker that dies to others. It gives up a run that too many have died of:
the scheduler's setting `distributed.scheduler.allowed-failures`.
"""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from air_router.errors import AirRouterError, ExitCode
from sitl.experiment.campaign.plan import Task
from sitl.experiment.campaign.worker_pool import (
    TICK_S,
    Failed,
    Finished,
    Lost,
    News,
    Outcome,
    Tick,
    Work,
)

try:
    import distributed
except ImportError as error:
    raise AirRouterError(
        "--cluster needs Dask, which is not installed; pip install 'air-router[cluster]'"
    ) from error

_LOOK_S: Final = 1.0
"""How often it is looked who is still there."""


class ClusterError(AirRouterError):
    """No scheduler answers at the address, or it has gone away."""

    exit_code = ExitCode.NO_VEHICLE


@dataclass(slots=True)
class DaskPool:
    """A pool of Dask workers.

    Attributes:
        address: of the scheduler, as `tcp://10.0.0.1:8786`.
        connect_s: how long to wait for it.
    """

    address: str
    connect_s: float = 10.0
    _client: Any = None
    _known: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Connect. Raises ClusterError."""
        try:
            self._client = distributed.Client(
                self.address, timeout=self.connect_s, set_as_default=False
            )
        except (OSError, ValueError, TimeoutError) as error:
            raise ClusterError(
                f"no Dask scheduler answers at {self.address} ({error}); start one with "
                "`dask scheduler`, and `dask worker ADDRESS` on every machine"
            ) from None
        self._known = self._threads()

    @property
    def workers(self) -> int:
        """How many runs are under way at a time."""
        return max(1, sum(self._known.values()))

    def close(self) -> None:
        """Leave the scheduler to others."""
        self._client.close()

    def run(self, work: Work, tasks: Sequence[Task]) -> Generator[Outcome, None, None]:
        """Make all runs; closing the iterator takes back those that are not made yet."""
        done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        under_way: dict[Any, Task] = {}
        if not self._known:
            yield News(f"{self.address} has no workers yet; waiting for the first")
        for task in tasks:
            future = self._client.submit(work, task, pure=False, priority=-task.number)
            under_way[future] = task
            future.add_done_callback(done.put)
        try:
            looked_s = time.monotonic()
            while under_way:
                if time.monotonic() - looked_s > _LOOK_S:
                    yield from self._who_left()
                    looked_s = time.monotonic()
                try:
                    future = done.get(timeout=TICK_S)
                except queue.Empty:
                    yield Tick()
                    continue
                yield self._outcome(future, under_way.pop(future))
        finally:
            with contextlib.suppress(Exception):  # whatever state the scheduler is in
                self._client.cancel(list(under_way))

    def _outcome(self, future: Any, task: Task) -> Outcome:
        if future.status == "finished":
            return Finished(task, future.result())
        if future.status != "error":
            raise ClusterError(
                f"the scheduler at {self.address} is gone; begin again when it is back: "
                "finished runs are kept"
            )
        error = future.exception()
        if not isinstance(error, distributed.scheduler.KilledWorker):
            return Failed(task, f"{type(error).__name__}: {error}")
        return Lost(task, error.allowed_failures + 1, str(error), again=False)

    def _who_left(self) -> Iterator[News]:
        """Says which workers have come and gone since it was looked last."""
        now = self._threads()
        for address in sorted(self._known.keys() - now.keys()):
            yield News(f"worker {address} is gone; its runs go to the others")
        for address in sorted(now.keys() - self._known.keys()):
            yield News(f"worker {address} has come")
        self._known = now

    def _threads(self) -> dict[str, int]:
        info = self._client.scheduler_info(n_workers=-1)
        return {address: worker["nthreads"] for address, worker in info["workers"].items()}
