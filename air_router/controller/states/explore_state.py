"""Flying the waypoints in the operator's order: the states INIT and EXPL."""

from __future__ import annotations

from air_router.controller.model.behaviour import Signal
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.monitor.home_reachability import HomeReachability
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.navigator import Progress
from air_router.controller.targets.exploration import Exploration


class ExploreState:
    """Visits waypoint after waypoint; one that cannot be reached from here is left out.

    Args:
        context: Where it says what is left out, and signals that none is left.
        gate: Flies there.
        exploration: Whose turn it is.
        reachability: Whether zones leave a way home: without one nothing is left out.
    """

    def __init__(
        self,
        context: MissionContext,
        gate: CommandGate,
        exploration: Exploration,
        reachability: HomeReachability,
    ) -> None:
        self._context = context
        self._gate = gate
        self._exploration = exploration
        self._reachability = reachability

    def begin(self) -> None:
        """Fly to the waypoint whose turn it is, or say that none is left."""
        gate, exploration = self._gate, self._exploration
        if (
            self._reachability.walled_in
        ):  # those that cannot be reached from home are left out already
            gate.navigator.stop()
            gate.wait_here("no waypoint can be reached from here: walled in")
            return
        refusals = []
        mark = exploration.mark()
        while exploration.remaining:
            motion = gate.plan_to(exploration.goal)
            if gate.navigator.progress is Progress.FLYING:
                break
            if gate.navigator.progress is Progress.NO_ROUTE:
                refusals.append(self._left_out(gate.refusal))
            else:
                exploration.visited()
                mark = exploration.mark()
        if refusals and not exploration.remaining:
            # All can be reached from home, or the mission would not fly: it is this place.
            exploration.back_to(mark)
            gate.navigator.stop()
            gate.wait_here(f"no waypoint can be reached from here: {gate.refusal}")
            return
        for refusal in refusals:
            self._context.say(refusal)
        if exploration.remaining:
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

    def replan(self) -> None:
        """To whose turn it is now."""
        self.begin()

    def _left_out(self, refusal: str) -> str:
        return f"waypoint {self._exploration.leave_out()} left out: {refusal}"
