"""The mission's state machine as one table: when to explore, search, exchange data, and come home.

Each row defines one state completely. Signals that a row does not list have no effect in its state.
The diagram in docs/state-machine.md is generated from this table.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from air_router.controller.model import (
    CommandPolicy,
    MissionContext,
    Signal,
    State,
    StateHandler,
    StateSpec,
    TimerStart,
)
from air_router.controller.motion import CommandGate, Navigator
from air_router.controller.states.explore_state import ExploreState
from air_router.controller.states.goto_state import GotoState
from air_router.controller.states.hold_state import HoldState
from air_router.controller.states.idle_state import IdleState
from air_router.controller.states.ready_state import ReadyState
from air_router.controller.states.return_state import (
    HandsOffState,
    HomeReachability,
    LandState,
    ReturnState,
)
from air_router.controller.states.search_points import Search
from air_router.controller.states.search_state import CommState, SearchState

# Common to the states in the air: come home (duration, battery, operator), hands off (pilot), done
# (landed); then the operator's requests.
_ENDS: Final = {
    Signal.COME_HOME: State.HOME,
    Signal.TAKEN_OVER: State.PASSIVE,
    Signal.GROUNDED: State.DONE,
}
_REQUESTED: Final = {
    Signal.HOLD: State.HOLD,
    Signal.SEEK: State.SEARCH,
    Signal.EXPLORE: State.EXPL,
    Signal.GOTO: State.GOTO,
}
# fmt: off
STATES: Final[Mapping[State, StateSpec]] = MappingProxyType({
    State.READY: StateSpec(ReadyState, requests=CommandPolicy.NOT_YET, defers=True,
        on={Signal.AIRBORNE: State.INIT, **_ENDS}),
    State.INIT: StateSpec(ExploreState, timer="init_s", explores=True, cruises=True,
        on={Signal.TIMER: State.SEARCH, Signal.EXPLORED: State.SEARCH, **_ENDS, **_REQUESTED}),
    State.SEARCH: StateSpec(SearchState, timer="search_s", timer_from=TimerStart.ARRIVAL,
        keeps_target=True, seeks=True, cruises=True,
        on={Signal.FOUND: State.COMM, Signal.TIMER: State.EXPL, Signal.NO_TARGET: State.EXPL,
            Signal.ALL_MET: State.IDLE, Signal.YIELDED: State.SEARCH, **_ENDS, **_REQUESTED}),
    State.COMM: StateSpec(CommState, timer="communicate_s", keeps_target=True, seeks=True,
        cruises=True,
        on={Signal.SYNCED: State.EXPL, Signal.TIMER: State.EXPL, **_ENDS, **_REQUESTED}),
    State.EXPL: StateSpec(ExploreState, timer="explore_s", explores=True, cruises=True,
        on={Signal.TIMER: State.SEARCH, Signal.EXPLORED: State.SEARCH, **_ENDS, **_REQUESTED}),
    State.IDLE: StateSpec(IdleState, cruises=True,
        on={Signal.ROBOT_DUE: State.SEARCH, **_ENDS, **_REQUESTED}),
    State.GOTO: StateSpec(GotoState, timer="hold_s", timer_from=TimerStart.ARRIVAL, cruises=True,
        on={Signal.TIMER: State.EXPL, Signal.NO_WAY: State.EXPL, **_ENDS, **_REQUESTED}),
    State.HOLD: StateSpec(HoldState, defers=True, cruises=True,
        on={Signal.RESUMED: State.EXPL, Signal.LAND_HERE: State.LAND, **_ENDS,
            Signal.SEEK: State.SEARCH, Signal.EXPLORE: State.EXPL, Signal.GOTO: State.GOTO}),
    State.HOME: StateSpec(ReturnState, requests=CommandPolicy.CALL_OFF, cruises=True,
        on={Signal.ARRIVED: State.LAND, Signal.TAKEN_OVER: State.PASSIVE,
            Signal.GROUNDED: State.DONE, **_REQUESTED}),
    State.LAND: StateSpec(LandState, requests=CommandPolicy.CALL_OFF, keeps_target=True,
        on={Signal.GROUNDED: State.DONE, Signal.TAKEN_OVER: State.PASSIVE}),
    State.PASSIVE: StateSpec(HandsOffState, requests=CommandPolicy.NOT_OURS, ours=False,
        keeps_target=True, on={Signal.GROUNDED: State.DONE, Signal.RESUMED: State.EXPL,
            Signal.COME_HOME: State.HOME}),
    State.DONE: StateSpec(HandsOffState, requests=CommandPolicy.OVER, ours=False,
        keeps_target=True, on={}),
})
# fmt: on
"""The mission's state machine. No other transition exists."""


def transitions(*, explores: bool) -> Mapping[State, Mapping[Signal, State]]:
    """The next state by signal, for each state.

    A vehicle that only searches (the paper's second UAV) enters SEARCH instead of an exploring
    state.
    """
    if explores:
        return {state: spec.on for state, spec in STATES.items()}
    return {
        state: {
            signal: State.SEARCH if STATES[target].explores else target
            for signal, target in spec.on.items()
        }
        for state, spec in STATES.items()
    }


class StateHandlers:
    """The handlers of all states, sharing one context.

    Args:
        context: State of the flight that the handlers share.
        gate: Sends motions, and keeps the last one sent.
        navigator: Plans and flies routes.
        search: Chooses the robot to seek and where, and the next waypoint.

    Attributes:
        reachability: Checks whether zones leave a route home.
        ready, search, comm, goto, hold, home, land: Handlers that other parts also call.
        of: Handler by state.
    """

    def __init__(
        self,
        context: MissionContext,
        gate: CommandGate,
        navigator: Navigator,
        search: Search,
    ) -> None:
        self.reachability = HomeReachability(context)
        self.ready = ReadyState(context, gate)
        self.search = SearchState(context, navigator, search)
        self.comm = CommState(context, self.search)
        self.goto = GotoState(context, navigator)
        self.hold = HoldState(context, gate, self.goto, self.search)
        self.home = ReturnState(context, gate)
        self.land = LandState(context, gate)
        handlers: tuple[StateHandler, ...] = (
            self.ready,
            ExploreState(context, navigator, search.exploration, self.reachability),
            self.search,
            self.comm,
            IdleState(context, search),
            self.goto,
            self.hold,
            self.home,
            self.land,
            HandsOffState(),
        )
        of_class = {type(handler): handler for handler in handlers}
        self.of = {state: of_class[spec.handler] for state, spec in STATES.items()}
