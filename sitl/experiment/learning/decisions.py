"""A run that stops at every decision whom a UAV seeks next, and goes on with the answer.

The engine calls policies from within; a program that decides from outside needs it the other way
round. So the run has a thread of its own, and exactly one of the two threads runs at a time: what
happens depends on the seed and the answers alone.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from queue import SimpleQueue

from air_router.seek_policies import Policy, SearchPlace, SeekContext, TargetList
from sitl.experiment import RunSettings
from sitl.experiment.engine import Run


@dataclass(frozen=True, slots=True)
class Decision:
    """A UAV is to seek a robot.

    Attributes:
        uav: Its name.
        targets: What it knows of the robots; read only.
        context: What it can see beside them.
    """

    uav: str
    targets: TargetList
    context: SeekContext


class _ClosedError(Exception):
    """The run is not wanted any more."""


class _Requesting:
    """A policy that requests decisions: the answer's robot first, then the others in their turn."""

    def __init__(self, uav: str, where: Policy, run: DecisionRun) -> None:
        self._uav, self._where, self._run = uav, where, run

    @property
    def foresees(self) -> bool:
        """As the policy that gives the places."""
        return self._where.foresees

    def order(self, targets: TargetList, context: SeekContext) -> list[SearchPlace]:
        """As `Policy.order`."""
        chosen = self._run.request(Decision(self._uav, targets, context))
        names = sorted(targets.candidates(context.now_s), key=lambda name: name != chosen)
        places = [self.place(name, targets, context) for name in names]
        return [replace(places[0], reason=f"chosen; {places[0].reason}"), *places[1:]]

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        """As `Policy.place`."""
        return self._where.place(robot, targets, context)


class DecisionRun:
    """A run, from decision to decision.

    Args:
        settings: Of the run; its policy does not count.
        seed: Of the run.
        where: Decides where a robot is sought.

    Attributes:
        run: The run, which is over once `next` has returned None.

    Raises:
        AirRouterError, ValueError: no run can be made of the settings.
    """

    def __init__(self, settings: RunSettings, seed: int, where: Policy) -> None:
        names = [f"uav{number + 1:02d}" for number in range(settings.uavs)]
        self.run = Run(settings, seed, {name: _Requesting(name, where, self) for name in names})
        # Put by the run's thread: a decision, the error of the run, or None at its end.
        self._requests: SimpleQueue[Decision | Exception | None] = SimpleQueue()
        # Put by the thread that calls `next` and `close`: a robot, or None to end the run.
        self._answers: SimpleQueue[str | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._finish, daemon=True)  # of the run

    def next(self, answer: str | None = None) -> Decision | None:
        """Go on to the next decision; None: the run is over.

        Args:
            answer: The robot to seek, of the decision before; the first call has none.
        """
        if self._thread.ident is None:
            self._thread.start()
        else:
            self._answers.put(answer)
        found = self._requests.get()
        if isinstance(found, Exception):
            raise found
        return found

    def close(self) -> None:
        """End a run that is not over."""
        while self._thread.is_alive():
            self._answers.put(None)
            self._thread.join(timeout=60)

    def request(self, decision: Decision) -> str:
        """In the run's thread: the answer, for which the run stands still."""
        self._requests.put(decision)
        answer = self._answers.get()
        if answer is None:
            raise _ClosedError
        return answer

    def _finish(self) -> None:
        try:
            self.run.finish()
        except _ClosedError:
            return
        except Exception as error:  # noqa: BLE001 - raised where the answers come from
            self._requests.put(error)
            return
        self._requests.put(None)


def robots_of(run: Run) -> Sequence[str]:
    """The robots that UAVs seek, in the mission's order."""
    return (*run.fleet.ugvs, *(() if run.fleet.base is None else (run.fleet.base,)))
