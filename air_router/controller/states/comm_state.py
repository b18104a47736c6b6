"""Hovering over a robot while data are exchanged: the state COMM."""

from __future__ import annotations

from air_router.controller.model.actions import PublishMap
from air_router.controller.model.behaviour import Signal, State
from air_router.controller.model.mission_context import Cockpit
from air_router.controller.motion.command_gate import Helm
from air_router.controller.states.search_state import Pursuit
from air_router.controller.targets.sync_progress import Exchange
from mocha_link.links.metrics import SyncEnded, SyncStarted


class Meeting:
    """Stays over the robot that was found until both have all that the other has.

    Args:
        cockpit: Where it signals that both directions have synced.
        helm: Waits where no way leads on.
        pursuit: Whom it meets, and follows it.
    """

    def __init__(self, cockpit: Cockpit, helm: Helm, pursuit: Pursuit) -> None:
        self._cockpit = cockpit
        self._helm = helm
        self._pursuit = pursuit
        self._exchange = Exchange()

    def begin(self) -> None:
        """Have the newest map ready, and go over the robot."""
        robot = self._pursuit.robot
        self._exchange = Exchange(robot)
        self._cockpit.do(PublishMap())
        self._cockpit.say(f"COMM {robot}: found")
        self._pursuit.follow(force=True)

    def arrived(self) -> None:
        """Stay: the state has a timer."""

    def stranded(self, refusal: str) -> None:
        """Wait where it is."""
        if not self._cockpit.schedule.retrying:
            self._helm.wait_here(refusal)

    def try_again(self) -> None:
        """Over the robot, wherever it is now."""
        self._pursuit.follow(force=True)

    def fly_on(self) -> None:
        """The same, by ways planned anew."""
        self._pursuit.follow(force=True)

    def sync_started(self, event: SyncStarted) -> None:
        """Data begin to flow."""
        self._exchange.started(event)
        self._pursuit.radio_heard(event)

    def sync_ended(self, event: SyncEnded) -> None:
        """One direction has everything."""
        self._exchange.ended(event)
        self._pursuit.radio_heard(event)
        if self._cockpit.state is State.COMM and self._exchange.complete:
            self._cockpit.signal(Signal.SYNCED)
