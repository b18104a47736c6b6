"""Flying the waypoints in the operator's order: the states INIT and EXPL."""

from __future__ import annotations

from air_router.controller.model.behaviour import Signal
from air_router.controller.model.mission_context import Cockpit
from air_router.controller.monitor.home_reachability import Enclosure
from air_router.controller.motion.command_gate import Helm
from air_router.controller.motion.navigator import Progress
from air_router.controller.targets.exploration import Exploration


class Exploring:
    """Visits waypoint after waypoint; one that cannot be reached from here is left out.

    Args:
        cockpit: Where it says what is left out, and signals that none is left.
        helm: Flies there.
        exploration: Whose turn it is.
        enclosure: Whether zones leave a way home: without one nothing is left out.
    """

    def __init__(
        self, cockpit: Cockpit, helm: Helm, exploration: Exploration, enclosure: Enclosure
    ) -> None:
        self._cockpit = cockpit
        self._helm = helm
        self._exploration = exploration
        self._enclosure = enclosure

    def begin(self) -> None:
        """Fly to the waypoint whose turn it is, or say that none is left."""
        helm, exploration = self._helm, self._exploration
        if self._enclosure.walled_in:  # those that cannot be reached from home are left out already
            helm.navigator.stop()
            helm.wait_here("no waypoint can be reached from here: walled in")
            return
        refusals = []
        mark = exploration.mark()
        while exploration.remaining:
            motion = helm.plan_to(exploration.goal)
            if helm.navigator.progress is Progress.FLYING:
                break
            if helm.navigator.progress is Progress.STRANDED:
                refusals.append(self._left_out(helm.refusal))
            else:
                exploration.visited()
                mark = exploration.mark()
        if refusals and not exploration.remaining:
            # All can be reached from home, or the mission would not fly: it is this place.
            exploration.back_to(mark)
            helm.navigator.stop()
            helm.wait_here(f"no waypoint can be reached from here: {helm.refusal}")
            return
        for refusal in refusals:
            self._cockpit.say(refusal)
        if exploration.remaining:
            helm.advance(motion)
        else:
            self._cockpit.signal(Signal.EXPLORED)

    def arrived(self) -> None:
        """On to the next."""
        self._exploration.visited()
        self.begin()

    def stranded(self, refusal: str) -> None:
        """On to the next, without this one."""
        self._cockpit.say(self._left_out(refusal))
        self.begin()

    def try_again(self) -> None:
        """To the same waypoint, or to the first that can be reached."""
        if self._helm.navigator.goal is None:
            self.begin()
        else:
            self._helm.fly_again()

    def fly_on(self) -> None:
        """To whose turn it is now."""
        self.begin()

    def _left_out(self, refusal: str) -> str:
        return f"waypoint {self._exploration.leave_out()} left out: {refusal}"
