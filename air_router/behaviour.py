"""When to explore, when to search, when to talk: the mission's state machine, as a table.

INIT, SEARCH, COMM and EXPL are those of the paper (its figure "State machine describing the
communication-aware exploration"); the others take the vehicle off the ground, bring it home and
give it away. The table is the whole behaviour: a signal that a state does not list is an error
that changes nothing, and the diagram in docs/ is drawn from it.
"""

from __future__ import annotations

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
    HOME = "flying home along the graph"
    LAND = "landing at home"
    DONE = "landed and disarmed"
    PASSIVE = "somebody else flies: hands off"


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
        (State.COMM, Signal.SYNCED): State.EXPL,
        (State.COMM, Signal.TIMER): State.EXPL,
        (State.EXPL, Signal.TIMER): State.SEARCH,
        (State.EXPL, Signal.EXPLORED): State.SEARCH,
        (State.HOME, Signal.ARRIVED): State.LAND,
        (State.LAND, Signal.GROUNDED): State.DONE,
        (State.PASSIVE, Signal.GROUNDED): State.DONE,
        (State.PASSIVE, Signal.RESUMED): State.EXPL,
        # From anywhere in the air: home on the word of duration, battery or operator; hands off
        # when somebody else flies; done when the ground has the vehicle.
        **{
            (state, signal): target
            for state in (State.INIT, State.SEARCH, State.COMM, State.EXPL)
            for signal, target in (
                (Signal.COME_HOME, State.HOME),
                (Signal.TAKEN_OVER, State.PASSIVE),
                (Signal.GROUNDED, State.DONE),
            )
        },
        (State.HOME, Signal.TAKEN_OVER): State.PASSIVE,
        (State.HOME, Signal.GROUNDED): State.DONE,
        (State.LAND, Signal.TAKEN_OVER): State.PASSIVE,
    }
)
"""(state, signal) -> next state. What is not here does not happen."""

EXPLORING: Final = frozenset({State.INIT, State.EXPL})
"""States that fly the waypoints in order."""


def next_state(state: State, signal: Signal) -> State:
    """The state that follows.

    Raises:
        UnexpectedSignalError: the table has no such transition.
    """
    try:
        return TRANSITIONS[state, signal]
    except KeyError:
        raise UnexpectedSignalError(state, signal) from None


def knows(state: State, signal: Signal) -> bool:
    """Whether a state reacts to a signal."""
    return (state, signal) in TRANSITIONS


def diagram() -> str:
    """The table as a Mermaid state diagram, for docs/."""
    lines = ["stateDiagram-v2", "    [*] --> READY"]
    lines += [
        f"    {source.name} --> {target.name}: {signal.value}"
        for (source, signal), target in TRANSITIONS.items()
    ]
    lines.append("    DONE --> [*]")
    return "\n".join(lines)
