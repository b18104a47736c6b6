"""The table of a pull's states, which docs/sync-protocol.md prints."""

import itertools

from mocha_link.sync.pull_states import OVER, STATES, PullEvent, PullState, next_state
from tests.printed import assert_printed, state_table


def test_the_docs_print_the_table():
    assert_printed("sync-protocol.md", "pull states", state_table(PullState, STATES))


def test_every_pull_can_end_and_none_that_broke_off_goes_on():
    for state, event in itertools.product(PullState, PullEvent):
        after = next_state(state, event)
        if state not in OVER:
            assert next_state(state, PullEvent.FAILURE) is PullState.BROKEN
        elif state is not PullState.FOLLOWING:
            assert after is state
        if after in OVER and after is not state:
            assert event in (PullEvent.FOLLOW, PullEvent.END, PullEvent.FAILURE)


def test_every_state_is_reached():
    first = {PullState.OPENING, PullState.STANDING, PullState.ORIGINAL}
    assert first | set(STATES.values()) == set(PullState)
