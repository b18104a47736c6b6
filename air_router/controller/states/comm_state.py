"""Hovering over a robot while data are exchanged: the state COMM."""

from __future__ import annotations

from air_router.controller.model.actions import PublishMap
from air_router.controller.model.behaviour import Signal, State
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.states.search_state import SearchState
from air_router.controller.targets.sync_progress import SyncProgress
from mocha_link.links.metrics import SyncEnded, SyncStarted


class CommState:
    """Stays over the robot that was found until both have all that the other has.

    Args:
        context: Where it signals that both directions have synced.
        gate: Waits where no way leads on.
        search_state: Whom it meets, and follows it.
    """

    def __init__(
        self, context: MissionContext, gate: CommandGate, search_state: SearchState
    ) -> None:
        self._context = context
        self._gate = gate
        self._search_state = search_state
        self._progress = SyncProgress()

    def begin(self) -> None:
        """Have the newest map ready, and go over the robot."""
        robot = self._search_state.robot
        self._progress = SyncProgress(robot)
        self._context.do(PublishMap())
        self._context.say(f"COMM {robot}: found")
        self._search_state.follow(force=True)

    def arrived(self) -> None:
        """Stay: the state has a timer."""

    def no_route(self, refusal: str) -> None:
        """Wait where it is."""
        if not self._context.schedule.retrying:
            self._gate.wait_here(refusal)

    def retry(self) -> None:
        """Over the robot, wherever it is now."""
        self._search_state.follow(force=True)

    def replan(self) -> None:
        """The same, by ways planned anew."""
        self._search_state.follow(force=True)

    def sync_started(self, event: SyncStarted) -> None:
        """Data begin to flow."""
        self._progress.started(event)
        self._search_state.radio_heard(event)

    def sync_ended(self, event: SyncEnded) -> None:
        """One direction has everything."""
        self._progress.ended(event)
        self._search_state.radio_heard(event)
        if self._context.state is State.COMM and self._progress.complete:
            self._context.signal(Signal.SYNCED)
