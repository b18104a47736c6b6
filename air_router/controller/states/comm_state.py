"""Hovering over a robot while data are exchanged: the state COMM."""

from __future__ import annotations

from dataclasses import dataclass, field

from air_router.controller.model.actions import PublishMap
from air_router.controller.model.mission_context import MissionContext, StateHandler
from air_router.controller.model.states import Signal, State
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.states.search_state import SearchState
from mocha_link.links.metrics import Direction, SyncEnded, SyncStarted


@dataclass(slots=True, eq=False)
class CommState(StateHandler):
    """Stays over the robot that was found until both have all that the other has.

    Only a sync that began after the robot was found counts: it alone carries all that both had by
    then.

    Args:
        context: Where it signals that both directions have synced.
        gate: Waits where no way leads on.
        search_state: Which robot was found; follows it.
    """

    _context: MissionContext
    _gate: CommandGate
    _search_state: SearchState
    _began: set[Direction] = field(default_factory=set)
    _synced: set[Direction] = field(default_factory=set)

    def begin(self) -> None:
        """Have the newest map ready, and go over the robot."""
        self._began.clear()
        self._synced.clear()
        self._context.do(PublishMap())
        self._context.say(f"COMM {self._search_state.robot}: found")
        self._search_state.follow(force=True)

    def no_route(self, refusal: str) -> None:
        """Wait where it is."""
        self._gate.wait_for_way(refusal)

    def retry(self) -> None:
        """Over the robot, wherever it is now."""
        self._search_state.follow(force=True)

    replan = retry

    def sync_started(self, event: SyncStarted) -> None:
        """Data begin to flow."""
        if event.peer == self._search_state.robot:
            self._began.add(event.direction)
        self._search_state.radio_heard(event)

    def sync_ended(self, event: SyncEnded) -> None:
        """One direction has everything."""
        if event.peer == self._search_state.robot and event.direction in self._began:
            self._began.discard(event.direction)
            self._synced.add(event.direction)
        self._search_state.radio_heard(event)
        if self._context.state is State.COMM and len(self._synced) == len(Direction):
            self._context.signal(Signal.SYNCED)
