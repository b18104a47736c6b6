import itertools
from pathlib import Path

import pytest

from air_router.behaviour import (
    TRANSITIONS,
    Signal,
    State,
    UnexpectedSignalError,
    diagram,
    knows,
    next_state,
)

PAPER = {
    (State.INIT, Signal.TIMER): State.SEARCH,
    (State.SEARCH, Signal.FOUND): State.COMM,
    (State.SEARCH, Signal.TIMER): State.EXPL,
    (State.COMM, Signal.SYNCED): State.EXPL,
    (State.COMM, Signal.TIMER): State.EXPL,
    (State.EXPL, Signal.TIMER): State.SEARCH,
}


@pytest.mark.parametrize(("state", "signal"), list(itertools.product(State, Signal)))
def test_every_state_answers_every_signal_by_the_table_or_not_at_all(state, signal):
    if (state, signal) in TRANSITIONS:
        assert knows(state, signal)
        assert next_state(state, signal) is TRANSITIONS[state, signal]
    else:
        assert not knows(state, signal)
        with pytest.raises(
            UnexpectedSignalError, match=f"{state.name} does not know {signal.name}"
        ):
            next_state(state, signal)


@pytest.mark.parametrize(("source", "signal"), list(PAPER))
def test_the_paper_s_transitions(source, signal):
    assert next_state(source, signal) is PAPER[source, signal]


def test_every_state_is_reachable_and_only_done_is_final():
    reached = {State.READY}
    while fresh := {t for (s, _), t in TRANSITIONS.items() if s in reached} - reached:
        reached |= fresh
    assert reached == set(State)
    assert {s for s in State if not any(source is s for source, _ in TRANSITIONS)} == {State.DONE}


def test_in_the_air_the_pilot_can_always_take_over_and_the_mission_always_be_ended():
    for state in (State.INIT, State.SEARCH, State.COMM, State.EXPL):
        assert next_state(state, Signal.TAKEN_OVER) is State.PASSIVE
        assert next_state(state, Signal.COME_HOME) is State.HOME
    for state in (State.HOME, State.LAND):
        assert next_state(state, Signal.TAKEN_OVER) is State.PASSIVE


def test_hands_off_is_for_good_unless_somebody_asks():
    after = {signal: t for (s, signal), t in TRANSITIONS.items() if s is State.PASSIVE}
    assert after == {Signal.GROUNDED: State.DONE, Signal.RESUMED: State.EXPL}


def test_the_diagram_in_the_docs_is_the_one_drawn_from_the_table():
    page = Path(__file__).parents[2] / "docs" / "state-machine.md"
    assert diagram() in page.read_text(encoding="utf-8")
