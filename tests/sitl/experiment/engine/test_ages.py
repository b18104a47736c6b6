"""Ages of information: saw teeth by hand, and against a simulation second by second."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.links.metrics import MessageStored
from sitl.experiment.engine.ages import Ages, mean_age_s, mean_value, peak_age_s

ROBOTS = ("uav01", "ugv01", "ugv02")
KINDS = ("uav", "ugv", "ugv")


class World:
    """A map that a UAV makes, or a pose of a ground robot, and who holds it."""

    def __init__(self, topic="/map", maker="uav01", user="ugv01", *, watched=True):
        self.queue = SimpleNamespace(now_s=0.0)
        self.ages = Ages(self.queue)
        self.topic, self.maker, self.user = topic, maker, user
        self.state = 0
        if watched:
            self.ages.watch(maker, topic, lambda: self.state)
        self.passed_on = []

    def at(self, time_s):
        self.queue.now_s = float(time_s)
        return self

    def become(self, state):
        self.state = state
        self.ages.update()
        return self

    def store(self, robot, header):
        event = MessageStored("peer", 0.0, self.maker, self.topic, header, 1)
        self.ages.listener(robot, self.passed_on.append)(event)
        return self

    def publish(self, header):
        return self.store(self.maker, header)

    def receive(self, header):
        return self.store(self.user, header)

    @property
    def held(self):
        (found,) = [
            held
            for pair, held in self.ages.held(ROBOTS, KINDS).items()
            if pair == (self.topic[1:], self.maker, self.user)
        ]
        return found


def test_poses_age_from_when_they_were_made():
    world = World("/pose", "ugv01", "uav01", watched=False)
    world.at(2).publish("a").at(4).receive("a").at(5).publish("b")
    world.at(10).receive("b").at(11).receive("a")
    # 0..4 s: 0 to 4; 4..10 s: 2 to 8; 10..20 s: 5 to 15; an older one that comes late is none
    assert mean_age_s(world.held, 20.0) == pytest.approx((8 + 30 + 100) / 20)
    assert peak_age_s(world.held, 20.0) == pytest.approx((4 + 8 + 15) / 3)
    assert len(world.passed_on) == 5


def test_who_never_receives_is_as_old_as_what_there_was_to_receive():
    world = World().at(3).become(1)
    assert mean_age_s(world.held, 13.0) == pytest.approx(50 / 13)
    assert peak_age_s(world.held, 13.0) == 10.0
    silent = World()
    assert (mean_age_s(silent.held, 13.0), peak_age_s(silent.held, 13.0)) == (0.0, None)
    pose = World("/pose", "ugv01", "uav01", watched=False)
    assert (mean_age_s(pose.held, 10.0), peak_age_s(pose.held, 10.0)) == (5.0, 10.0)


def test_what_is_true_is_worth_one_and_half_of_it_a_half_life_later():
    always = np.array([(0.0, math.inf)])
    assert mean_value(always, 50.0, 10.0) == 1.0
    # true for 20 of 40 s, then 20 s old: the worth falls from 1 to a quarter
    half = np.array([(0.0, 20.0)])
    assert mean_value(half, 40.0, 10.0) == pytest.approx((20 + 0.75 * 10 / math.log(2)) / 40)
    # a pose that is 5 s old when it is received, and nothing before
    pose = np.array([(0.0, 0.0), (10.0, 5.0)])
    ages_s = np.concatenate([np.arange(0, 10, 0.001), np.arange(5, 15, 0.001)])
    assert mean_value(pose, 20.0, 8.0) == pytest.approx(np.mean(2 ** (-ages_s / 8)), rel=1e-3)
    never = np.array([(0.0, 0.0)])
    assert mean_value(never, 1e6, 10.0) < 1e-4


STEPS = st.lists(
    st.tuples(st.integers(0, 2), st.booleans(), st.none() | st.integers(0, 60)),
    min_size=1,
    max_size=60,
)


class Slow:
    """The same by the definition: states and messages are kept, and looked through every second."""

    def __init__(self):
        self.states, self.sent = [], []  # by second; seconds of messages

    def false_s(self, message):
        """When the last stretch began in which there was another state to publish, until it was."""
        state, made = (0, -1) if message is None else (self.state(message), self.sent[message])
        later = [t for t in self.sent if t > made and (message is None or self.states[t] != state)]
        last = later[0] if later else len(self.states) - 1
        if message is None and later and self.states[last] == state:
            return last
        first = math.inf
        for second in range(last, made, -1):
            if self.states[second] == state:
                break
            first = second
        return first

    def state(self, message):
        return self.states[self.sent[message]]

    def is_update(self, message, newest):
        """Whether a message has another state than the newest that was received."""
        if newest is None or message <= newest:
            return newest is None
        return len({self.state(each) for each in range(newest, message + 1)}) > 1

    def area_and_peaks(self, received):
        """The area under the ages, and the peaks; `received`: a message by second."""
        area, peaks, newest, end = 0.0, [], None, len(self.states)
        for second in range(end):
            message = received.get(second)
            if message is not None and self.is_update(message, newest):
                peaks.append(max(0.0, second - self.false_s(newest)))
                newest = message
            if self.false_s(newest) <= second:
                area += second - self.false_s(newest) + 0.5
        last = end - self.false_s(newest)
        return area, peaks + [last] * (last > 0)


@given(STEPS)
def test_ages_are_those_of_a_simulation_second_by_second(steps):
    """Each second the state may change, be sent, and an earlier message be received."""
    world, slow, received = World(), Slow(), {}
    for second, (state, publishes, receives) in enumerate(steps):
        world.at(second).become(state)
        slow.states.append(state)
        if publishes:
            world.publish(str(len(slow.sent)))
            slow.sent.append(second)
        if receives is not None and slow.sent:
            received[second] = receives % len(slow.sent)
            world.receive(str(received[second]))
    area, peaks = slow.area_and_peaks(received)
    assert mean_age_s(world.held, float(len(steps))) == pytest.approx(area / len(steps))
    peak_s = peak_age_s(world.held, float(len(steps)))
    assert peak_s is None if not peaks else peak_s == pytest.approx(np.mean(peaks))
