"""Flying the waypoints in the operator's order: the states INIT and EXPL."""

from __future__ import annotations

from dataclasses import dataclass

from air_router.controller.model.mission_context import MissionContext, StateHandler
from air_router.controller.model.states import Signal
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.navigator import Progress
from air_router.controller.states.return_state import HomeReachability
from air_router.controller.targets.exploration import Exploration


@dataclass(slots=True, eq=False)
class ExploreState(StateHandler):
    """Visits waypoint after waypoint; one that cannot be reached from here is skipped.

    Args:
        context: Where it says what is skipped, and signals that no waypoint is left.
        gate: Flies there.
        exploration: Whose turn it is.
        reachability: Whether zones leave a way home: without one no waypoint is skipped.
    """

    _context: MissionContext
    _gate: CommandGate
    _exploration: Exploration
    _reachability: HomeReachability

    def begin(self) -> None:
        """Fly to the waypoint whose turn it is, or say that none is left."""
        gate, exploration = self._gate, self._exploration
        if self._reachability.walls is not None:
            # What cannot be reached from home is skipped already.
            gate.navigator.stop()
            gate.wait_here("no waypoint can be reached from here: no clear way home")
            return
        refusals = []
        mark = exploration.mark()
        while (goal := exploration.goal) is not None:
            motion = gate.plan_to(goal)
            if gate.navigator.progress is Progress.FLYING:
                break
            if gate.navigator.progress is Progress.NO_ROUTE:
                refusals.append(self._left_out(gate.refusal))
            else:
                exploration.visited()
                mark = exploration.mark()
        if refusals and goal is None:
            # All can be reached from home, or the mission would not fly: it is this place.
            exploration.back_to(mark)
            gate.navigator.stop()
            gate.wait_here(f"no waypoint can be reached from here: {gate.refusal}")
            return
        for refusal in refusals:
            self._context.say(refusal)
        if goal is not None:
            gate.advance(motion)
        else:
            self._context.signal(Signal.EXPLORED)

    def arrived(self) -> None:
        """On to the next."""
        self._exploration.visited()
        self.begin()

    def no_route(self, refusal: str) -> None:
        """On to the next, without this one."""
        self._context.say(self._left_out(refusal))
        self.begin()

    def retry(self) -> None:
        """To the same waypoint, or to the first that can be reached."""
        if self._gate.navigator.goal is None:
            self.begin()
        else:
            self._gate.fly_again()

    replan = begin

    def _left_out(self, refusal: str) -> str:
        return f"waypoint {self._exploration.leave_out()} left out: {refusal}"
