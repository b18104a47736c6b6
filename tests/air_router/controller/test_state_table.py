"""The table of states: the controller driven through it, and drawn as the docs have it."""

import pytest

from air_router.controller.model.actions import StateChanged
from air_router.controller.model.states import CommandPolicy, Signal, State, TimerStart
from air_router.controller.model.task import EndReason
from air_router.controller.states.goto_state import GotoTask
from air_router.controller.states.table import STATES, transitions
from geo.frame import Point
from tests.printed import assert_printed

PAPER = {
    (State.INIT, Signal.TIMER): State.SEARCH,
    (State.SEARCH, Signal.FOUND): State.COMM,
    (State.SEARCH, Signal.TIMER): State.EXPL,
    (State.COMM, Signal.SYNCED): State.EXPL,
    (State.COMM, Signal.TIMER): State.EXPL,
    (State.EXPL, Signal.TIMER): State.SEARCH,
}
TRANSITIONS = {(s, signal): t for s, spec in STATES.items() for signal, t in spec.on.items()}
WAYS = {
    State.READY: (),
    State.INIT: (),
    State.SEARCH: (Signal.TIMER,),
    State.COMM: (Signal.TIMER, Signal.FOUND),
    State.EXPL: (Signal.EXPLORE,),
    State.IDLE: (Signal.TIMER, Signal.ALL_MET),
    State.GOTO: (Signal.GOTO,),
    State.HOLD: (Signal.HOLD,),
    State.HOME: (Signal.COME_HOME,),
    State.LAND: (Signal.COME_HOME, Signal.ARRIVED),
    State.PASSIVE: (Signal.TAKEN_OVER,),
    State.DONE: (Signal.GROUNDED,),
}


def in_state(pretend, state):
    """A flight whose controller was led there, signal by signal."""
    flight = pretend()
    if state is State.READY:
        flight.step()
    else:
        flight.take_off()
    for signal in WAYS[state]:
        signalled(flight, signal)
    assert flight.controller.state is state
    return flight


def signalled(flight, signal):
    """What a signal makes of a controller in a state of its own, without an event around it."""
    context = flight.controller.context
    context.actions = []
    if signal is Signal.GOTO:  # what comes with it
        flight.controller.states.goto.goto_task = GotoTask((Point(-20.0, -60.0),), 20.0, "a test")
    if signal is Signal.COME_HOME:
        context.task.end(EndReason("a test"))
    context.signal(signal)
    return context.actions


@pytest.mark.parametrize("state", State)
def test_the_controller_enters_the_state_of_the_table_and_no_other(pretend, state):
    for signal in Signal:
        enters_the_state_of_the_table(in_state(pretend, state), state, signal)


def enters_the_state_of_the_table(flight, state, signal):
    controller, context = flight.controller, flight.controller.context
    before = (context.task.robot, context.left_s)
    entered = [a for a in signalled(flight, signal) if isinstance(a, StateChanged)]
    if signal not in STATES[state].on:
        assert entered == [], signal
        assert controller.state is state
        assert (context.task.robot, context.left_s) == before
        return
    target = STATES[state].on[signal]
    assert (entered[0].source, entered[0].signal, entered[0].target) == (state, signal, target)
    spec = STATES[controller.state]
    if spec.timer is not None:
        limit_s = getattr(flight.mission.timers, spec.timer)
        waits = spec.timer_from is TimerStart.ARRIVAL
        left_s = None if waits else pytest.approx(limit_s)
        assert context.left_s == left_s
    if not spec.keeps_target:
        assert context.task.robot is None


def test_the_paper_s_transitions():
    assert TRANSITIONS.items() >= PAPER.items()


def test_every_state_is_reachable_and_only_done_is_final():
    reached = {State.READY}
    while fresh := {t for (s, _), t in TRANSITIONS.items() if s in reached} - reached:
        reached |= fresh
    assert reached == set(State)
    assert [state for state in State if not STATES[state].on] == [State.DONE]


def test_in_the_air_the_pilot_can_always_take_over_and_the_mission_always_be_ended():
    for state, spec in STATES.items():
        if spec.ours:
            assert spec.on[Signal.TAKEN_OVER] is State.PASSIVE
            assert spec.on[Signal.GROUNDED] is State.DONE
            bound_home = spec.requests is CommandPolicy.CALL_OFF
            assert bound_home or spec.on[Signal.COME_HOME] is State.HOME, state


def test_a_vehicle_that_only_searches_never_explores_unless_it_is_requested():
    left_out = {Signal.NO_TARGET, Signal.EXPLORE}  # it has nothing to explore, and announces that
    reached = {State.READY}
    while (
        fresh := {
            target
            for state, row in transitions(explores=False).items()
            for signal, target in row.items()
            if state in reached and signal not in left_out
        }
        - reached
    ):
        reached |= fresh
    assert reached == set(State) - {State.INIT, State.EXPL}


# The diagrams of docs/state-machine.md.

REQUESTED_OR_ENDED = {
    *(Signal.COME_HOME, Signal.TAKEN_OVER, Signal.GROUNDED),
    *(Signal.HOLD, Signal.SEEK, Signal.EXPLORE, Signal.GOTO),
}
FROM_THE_AIR = {
    (s, signal): t
    for (s, signal), t in TRANSITIONS.items()
    if signal in REQUESTED_OR_ENDED and STATES[s].cruises
}
"""Transitions that nearly all states in the air have: drawn once."""


def arrows(table):
    return [f"    {s.name} --> {t.name}: {signal.value}" for (s, signal), t in table.items()]


def diagram():
    own = {key: t for key, t in TRANSITIONS.items() if key not in FROM_THE_AIR}
    common = dict.fromkeys((signal, t) for (_, signal), t in FROM_THE_AIR.items())
    return [
        "stateDiagram-v2",
        '    state "any state in the air" as AIR',
        "    [*] --> READY",
        *arrows(own),
        *(f"    AIR --> {t.name}: {signal.value}" for signal, t in common),
        "    DONE --> [*]",
    ]


def from_the_air():
    sources = {}
    for (source, signal), target in FROM_THE_AIR.items():
        sources.setdefault((signal, target), []).append(source.name)
    return ["| when | in | leads to |", "|---|---|---|"] + [
        f"| {signal.value} | {', '.join(names)} | {target.name} |"
        for (signal, target), names in sources.items()
    ]


def searcher_diagram():
    others = {
        (s, signal): target
        for s, row in transitions(explores=False).items()
        for signal, target in row.items()
        if target is not TRANSITIONS[s, signal] and signal not in {Signal.NO_TARGET, Signal.EXPLORE}
    }
    return ["stateDiagram-v2", *arrows(others)]


def mermaid(lines):
    return ["```mermaid", *lines, "```"]


@pytest.mark.parametrize(
    ("name", "drawn"),
    [
        ("states", mermaid(diagram())),
        ("from the air", from_the_air()),
        ("a searcher", mermaid(searcher_diagram())),
    ],
)
def test_the_diagrams_in_the_docs_are_those_drawn_from_the_table(name, drawn):
    assert_printed("state-machine.md", name, drawn)
