"""Finding out whether a plan that a ground station has uploaded flies as ours does."""

import asyncio
from collections.abc import Awaitable, Callable

from air_router.errors import NotConfirmedError, PlanRefusedError
from air_router.mission.flight_plan import FlightPlan


class PlanGuard:
    """Compares what is on board with our plan each time that PX4 says that it changed.

    Args:
        compare: Reads what is on board and raises if it is another plan.
        report: Takes what is different, or None.

    Attributes:
        plan: What we put, or found, on board last; None before.
    """

    def __init__(
        self,
        compare: Callable[[FlightPlan], Awaitable[None]],
        report: Callable[[str | None], None],
    ) -> None:
        self.plan: FlightPlan | None = None
        self._compare = compare
        self._report = report
        self._once_more = False  # it changed while it was read
        self._task: asyncio.Task[None] | None = None  # reads and compares

    def replaced(self) -> None:
        """Compare; once more if that is under way: it may have read what was there before."""
        self._once_more = True
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._work())

    async def done(self) -> None:
        """Wait until nothing is left to compare."""
        if self._task is not None:
            await self._task

    def close(self) -> None:
        """Nothing is compared any more."""
        if self._task is not None:
            self._task.cancel()

    async def _work(self) -> None:
        difference: str | None = "no plan is ours"
        while self._once_more:
            self._once_more = False
            if self.plan is None:
                break
            try:
                await self._compare(self.plan)
            except (PlanRefusedError, NotConfirmedError) as error:
                difference = str(error)
            else:
                difference = None
        self._report(difference)
