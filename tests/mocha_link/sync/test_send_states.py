"""The table of a served pull's states, which docs/sync-protocol.md prints."""

import itertools

from mocha_link.sync.send_states import ENDED, STATES, SendEvent, SendState, next_state
from tests.printed import assert_printed, state_table


def test_the_docs_print_the_table():
    assert_printed("sync-protocol.md", "send states", state_table(SendState, STATES))


def test_every_pull_can_end_and_nothing_follows_its_end():
    for state, event in itertools.product(SendState, SendEvent):
        if state is SendState.OVER or event is SendEvent.END:
            assert next_state(state, event) is SendState.OVER


def test_only_a_peer_that_was_sent_all_may_follow():
    before = {state for (state, _), after in STATES.items() if after is SendState.FOLLOWED}
    assert before == {SendState.DONE}


def test_a_pull_that_has_ended_sends_no_second_round():
    after = {next_state(state, event) for state in ENDED for event in SendEvent}
    assert after == {*ENDED, SendState.REJECTED}


def test_every_state_is_reached():
    assert {SendState.OPENING} | set(STATES.values()) == set(SendState)
