import re
from pathlib import Path

import pytest

from air_router.controller.model.behaviour import (
    ONLY_SEARCHES,
    TRANSITIONS,
    Signal,
    State,
    UnexpectedSignalError,
    diagram,
    from_the_air,
    knows,
    next_state,
    searcher_diagram,
)

PAPER = {
    (State.INIT, Signal.TIMER): State.SEARCH,
    (State.SEARCH, Signal.FOUND): State.COMM,
    (State.SEARCH, Signal.TIMER): State.EXPL,
    (State.COMM, Signal.SYNCED): State.EXPL,
    (State.COMM, Signal.TIMER): State.EXPL,
    (State.EXPL, Signal.TIMER): State.SEARCH,
}


def test_a_signal_that_a_state_does_not_know_is_an_error():
    with pytest.raises(UnexpectedSignalError, match="DONE does not know FOUND"):
        next_state(State.DONE, Signal.FOUND)


def test_the_paper_s_transitions():
    assert TRANSITIONS.items() >= PAPER.items()


def test_every_state_is_reachable_and_only_done_is_final():
    reached = {State.READY}
    while fresh := {t for (s, _), t in TRANSITIONS.items() if s in reached} - reached:
        reached |= fresh
    assert reached == set(State)
    assert {s for s in State if not any(source is s for source, _ in TRANSITIONS)} == {State.DONE}


def test_in_the_air_the_pilot_can_always_take_over_and_the_mission_always_be_ended():
    for state in (*(State.INIT, State.SEARCH, State.COMM, State.EXPL), *(State.GOTO, State.HOLD)):
        assert next_state(state, Signal.TAKEN_OVER) is State.PASSIVE
        assert next_state(state, Signal.COME_HOME) is State.HOME
    for state in (State.HOME, State.LAND):
        assert next_state(state, Signal.TAKEN_OVER) is State.PASSIVE


def test_what_is_asked_for_moves_nothing_before_take_off_nor_once_it_lands_or_is_given_away():
    asked = {Signal.HOLD, Signal.SEEK, Signal.EXPLORE, Signal.GOTO}
    for state in (State.READY, State.LAND, State.DONE, State.PASSIVE):
        assert not any(knows(state, signal) for signal in asked)
    for state in set(State) - {State.READY, State.LAND, State.DONE, State.PASSIVE}:
        known = {signal for signal in asked if knows(state, signal)}
        assert known == asked - ({Signal.HOLD} if state is State.HOLD else set())


def test_hands_off_is_for_good_unless_the_operator_asks():
    after = {signal: t for (s, signal), t in TRANSITIONS.items() if s is State.PASSIVE}
    assert after == {
        Signal.GROUNDED: State.DONE,
        Signal.RESUMED: State.EXPL,
        Signal.COME_HOME: State.HOME,
    }


def test_a_vehicle_that_only_searches_never_explores_unless_it_is_asked_to():
    assert ONLY_SEARCHES.keys() <= TRANSITIONS.keys()
    left_out = {Signal.NO_TARGET, Signal.EXPLORE}  # it has nothing to explore, and says so
    reached = {State.READY}
    while (
        fresh := {
            next_state(state, signal, explores=False)
            for state, signal in TRANSITIONS
            if state in reached and signal not in left_out
        }
        - reached
    ):
        reached |= fresh
    assert reached == set(State) - {State.INIT, State.EXPL}


def test_the_diagram_in_the_docs_is_the_one_drawn_from_the_table():
    page = Path(__file__).parents[4] / "docs" / "state-machine.md"
    text = page.read_text(encoding="utf-8")
    assert diagram() in text
    assert from_the_air() in text
    assert searcher_diagram() in text


def test_diagram_and_table_together_say_all_of_it():
    drawn = {
        (source, said): target
        for source, target, said in re.findall(r"(\w+) --> (\w+): (.+)", diagram())
        if source != "AIR"
    }
    for row in from_the_air().splitlines()[2:]:
        said, sources, target = (cell.strip() for cell in row.strip("|").split("|"))
        assert f"AIR --> {target}: {said}" in diagram()
        drawn |= {(source, said): target for source in sources.split(", ")}
    assert drawn == {(s.name, signal.value): t.name for (s, signal), t in TRANSITIONS.items()}
