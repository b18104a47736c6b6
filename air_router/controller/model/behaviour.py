"""When to explore, when to search, when to talk: the mission's state machine, as a table.

INIT, SEARCH, COMM and EXPL are those of the paper (its figure "State machine describing the
communication-aware exploration"); the others take the vehicle off the ground, bring it home and
give it away. The table is the whole behaviour: a signal that a state does not list is an error
that changes nothing, and the diagram in docs/ is drawn from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import Final


class State(Enum):
    """What the mission is doing."""

    READY = "on the ground or climbing, until the vehicle hovers above home"
    INIT = "exploring the waypoints for the first time"
    SEARCH = "going where a robot should be"
    COMM = "hovering over a robot while data are exchanged"
    EXPL = "exploring on where exploration stopped"
    GOTO = "flying to requested points"
    HOLD = "hovering on request"
    HOME = "flying home along the graph"
    LAND = "landing at home"
    DONE = "landed and disarmed"
    PASSIVE = "the pilot or a failsafe flies: hands off"


class Signal(Enum):
    """What can happen to a mission."""

    AIRBORNE = "the vehicle hovers above home"
    TIMER = "the state's time is over"
    EXPLORED = "every waypoint has been visited"
    FOUND = "the robot that is sought was heard"
    SYNCED = "both directions have synced"
    NO_TARGET = "no robot can be sought now"
    COME_HOME = "duration, battery reserve or the operator's word"
    ARRIVED = "above home"
    GROUNDED = "landed and disarmed"
    TAKEN_OVER = "the pilot or the autopilot changed the mode"
    RESUMED = "the operator asks to go on"
    HOLD = "asked to hold"
    SEEK = "asked to seek a robot"
    EXPLORE = "asked to explore"
    GOTO = "asked to fly to points"
    NO_WAY = "no clear way to the points that are left"
    YIELDED = "another UAV seeks the same robot"


class UnexpectedSignalError(Exception):
    """A signal reached a state that does not know it; the state is unchanged."""

    def __init__(self, state: State, signal: Signal) -> None:
        self.state = state
        self.signal = signal
        super().__init__(f"{state.name} does not know {signal.name}; still {state.name}")


TRANSITIONS: Final = MappingProxyType(
    {
        (State.READY, Signal.AIRBORNE): State.INIT,
        (State.READY, Signal.COME_HOME): State.HOME,
        (State.READY, Signal.GROUNDED): State.DONE,
        (State.READY, Signal.TAKEN_OVER): State.PASSIVE,
        (State.INIT, Signal.TIMER): State.SEARCH,
        (State.INIT, Signal.EXPLORED): State.SEARCH,
        (State.SEARCH, Signal.FOUND): State.COMM,
        (State.SEARCH, Signal.TIMER): State.EXPL,
        (State.SEARCH, Signal.NO_TARGET): State.EXPL,
        (State.SEARCH, Signal.YIELDED): State.SEARCH,
        (State.COMM, Signal.SYNCED): State.EXPL,
        (State.COMM, Signal.TIMER): State.EXPL,
        (State.EXPL, Signal.TIMER): State.SEARCH,
        (State.EXPL, Signal.EXPLORED): State.SEARCH,
        (State.GOTO, Signal.TIMER): State.EXPL,
        (State.GOTO, Signal.NO_WAY): State.EXPL,
        (State.HOLD, Signal.RESUMED): State.EXPL,
        (State.HOME, Signal.ARRIVED): State.LAND,
        (State.LAND, Signal.GROUNDED): State.DONE,
        (State.PASSIVE, Signal.GROUNDED): State.DONE,
        (State.PASSIVE, Signal.RESUMED): State.EXPL,
        (State.PASSIVE, Signal.COME_HOME): State.HOME,
        # From anywhere in the air: home on the word of duration, battery or operator; hands off
        # when a pilot flies; done when the ground has the vehicle.
        **{
            (state, signal): target
            for state in (
                *(State.INIT, State.SEARCH, State.COMM, State.EXPL),
                *(State.GOTO, State.HOLD),
            )
            for signal, target in (
                (Signal.COME_HOME, State.HOME),
                (Signal.TAKEN_OVER, State.PASSIVE),
                (Signal.GROUNDED, State.DONE),
            )
        },
        # Requests: from the same states, and from a way home that was requested.
        **{
            (state, signal): target
            for state in (
                *(State.INIT, State.SEARCH, State.COMM, State.EXPL),
                *(State.GOTO, State.HOLD, State.HOME),
            )
            for signal, target in (
                (Signal.HOLD, State.HOLD),
                (Signal.SEEK, State.SEARCH),
                (Signal.EXPLORE, State.EXPL),
                (Signal.GOTO, State.GOTO),
            )
            if (state, signal) != (State.HOLD, Signal.HOLD)
        },
        (State.HOME, Signal.TAKEN_OVER): State.PASSIVE,
        (State.HOME, Signal.GROUNDED): State.DONE,
        (State.LAND, Signal.TAKEN_OVER): State.PASSIVE,
    }
)
"""(state, signal) -> next state. What is not here does not happen."""

EXPLORING: Final = frozenset({State.INIT, State.EXPL})
"""States that fly the waypoints in order."""

ONLY_SEARCHES: Final = MappingProxyType(
    {
        (State.READY, Signal.AIRBORNE): State.SEARCH,
        (State.SEARCH, Signal.TIMER): State.SEARCH,
        (State.COMM, Signal.SYNCED): State.SEARCH,
        (State.COMM, Signal.TIMER): State.SEARCH,
        (State.GOTO, Signal.TIMER): State.SEARCH,
        (State.GOTO, Signal.NO_WAY): State.SEARCH,
        (State.HOLD, Signal.RESUMED): State.SEARCH,
        (State.PASSIVE, Signal.RESUMED): State.SEARCH,
    }
)
"""Where a vehicle that only searches, as the paper's second UAV, goes instead of exploring."""


_AIR: Final = (
    *(State.INIT, State.SEARCH, State.COMM, State.EXPL),
    *(State.GOTO, State.HOLD, State.HOME),
)
_COMMON: Final = frozenset(
    {Signal.COME_HOME, Signal.TAKEN_OVER, Signal.GROUNDED}
    | {Signal.HOLD, Signal.SEEK, Signal.EXPLORE, Signal.GOTO}
)
_FROM_THE_AIR: Final = tuple(
    (source, signal, target)
    for (source, signal), target in TRANSITIONS.items()
    if source in _AIR and signal in _COMMON
)
"""Transitions that nearly all states in the air have: drawn once."""


def next_state(state: State, signal: Signal, *, explores: bool = True) -> State:
    """The state that follows, for a vehicle that explores or one that only searches.

    Raises:
        UnexpectedSignalError: the table has no such transition.
    """
    try:
        target = TRANSITIONS[state, signal]
    except KeyError:
        raise UnexpectedSignalError(state, signal) from None
    return target if explores else ONLY_SEARCHES.get((state, signal), target)


def knows(state: State, signal: Signal) -> bool:
    """Whether a state reacts to a signal."""
    return (state, signal) in TRANSITIONS


def diagram() -> str:
    """The table as a Mermaid state diagram, for docs/; `from_the_air` has the rest of it."""
    own = {
        (source, signal): target
        for (source, signal), target in TRANSITIONS.items()
        if (source, signal, target) not in _FROM_THE_AIR
    }
    common = dict.fromkeys((signal, target) for _, signal, target in _FROM_THE_AIR)
    return "\n".join(
        [
            "stateDiagram-v2",
            '    state "any state in the air" as AIR',
            "    [*] --> READY",
            *_arrows(own),
            *(f"    AIR --> {target.name}: {signal.value}" for signal, target in common),
            "    DONE --> [*]",
        ]
    )


def from_the_air() -> str:
    """What the diagram draws from "any state in the air", as a Markdown table: from which."""
    sources: dict[tuple[Signal, State], list[str]] = {}
    for source, signal, target in _FROM_THE_AIR:
        sources.setdefault((signal, target), []).append(source.name)
    return "\n".join(
        ["| when | in | leads to |", "|---|---|---|"]
        + [
            f"| {signal.value} | {', '.join(names)} | {target.name} |"
            for (signal, target), names in sources.items()
        ]
    )


def searcher_diagram() -> str:
    """The transitions that differ for a vehicle that only searches."""
    return "\n".join(["stateDiagram-v2", *_arrows(ONLY_SEARCHES)])


def _arrows(table: Mapping[tuple[State, Signal], State]) -> list[str]:
    return [
        f"    {source.name} --> {target.name}: {signal.value}"
        for (source, signal), target in table.items()
    ]
