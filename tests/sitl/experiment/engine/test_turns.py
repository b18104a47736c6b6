"""Turns: who is next among those that wait, beside transmissions under way."""

from hypothesis import given
from hypothesis import strategies as st

from sitl.experiment.engine.channel import Link
from sitl.experiment.engine.exchange import Exchange
from sitl.experiment.engine.turns import Turns

ROBOTS = st.integers(0, 5)
STEPS = st.lists(
    st.tuples(ROBOTS, ROBOTS, st.integers(0, 3), st.frozensets(ROBOTS), st.booleans()), max_size=40
)


@given(STEPS)
def test_the_first_is_the_least_of_all_whose_robots_are_free(steps):
    turns, waiting = Turns(), []
    for count, (requesting, answering, priority, occupied, leaves) in enumerate(steps):
        exchange = Exchange(Link(requesting, answering), ())
        turns.add(exchange, ((float(priority),), count))
        waiting.append(exchange)
        free = [each for each in waiting if occupied.isdisjoint(each.link)]
        first = min(free, key=lambda each: each.turn, default=None)
        assert turns.first_beside(occupied) is first
        if leaves and first is not None:
            turns.remove(first)
            waiting.remove(first)
        assert bool(turns) == bool(waiting)
