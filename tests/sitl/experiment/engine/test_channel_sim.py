"""Exchanges on the air, over a channel of which the test decides everything."""

import math

import numpy as np
import pytest

from mocha_link.links.metrics import (
    ContactBegan,
    ContactEnded,
    MessageStored,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from sitl.experiment.engine.channel import Change, Stage
from sitl.experiment.engine.channel_sim import ChannelSim
from sitl.experiment.engine.exchange import AirtimeStats, Transmission
from sitl.experiment.events import EventQueue
from sitl.experiment.robots.node import Node, fleet_of

HEADER, DATA, END = Stage
NOWHERE = np.zeros((0, 3))


class Script:
    """A channel on which every transmission takes a second."""

    pull_every_s = None
    frame_by_frame = False

    def __init__(self, patience_s):
        self.patience_s = patience_s
        self.changes = []

    def update(self, now_s, places):
        changes, self.changes = self.changes, []
        return changes

    def duration_s(self, link, load, now_s):
        return 1.0

    def turn(self, link, ready_s):
        return link

    def occupied(self, busy):
        return set(range(8)) if busy else set()


class Once:
    """A robot that publishes once, and then no more."""

    def __init__(self, messages):
        self.messages = messages

    def __call__(self):
        messages, self.messages = self.messages, []
        return messages


class Field:
    """Two ground robots and a UAV that have something to publish."""

    def __init__(self, protocol, patience_s=math.inf, *, triggered=False):
        self.queue = EventQueue()
        self.channel = Script(patience_s)
        fleet = fleet_of(1, 2, base=False, original=protocol == "original")
        self.events = {name: [] for name in fleet.names}
        self.nodes = [
            Node(
                number,
                name,
                fleet.team,
                self.queue,
                triggered=triggered,
                publish=Once([("/pose", name.encode()), ("/path", b"way")]),
                receive=self.events[name].append,
            )
            for number, name in enumerate(fleet.names)
        ]
        self.airtime = AirtimeStats([].append)
        self.channel_sim = ChannelSim(self.queue, self.channel, self.nodes, self.airtime)

    def contact(self, a, b, *, up):
        self.channel.changes = [Change(a, b, up)]
        self.channel_sim.update(NOWHERE)

    def rows(self, *, complete=True):
        rows = [sent for sent in self.airtime.transmissions if sent.complete is complete]
        return np.rec.fromrecords(rows, names=list(Transmission._fields)) if rows else []

    def stored(self, name):
        return {
            (event.robot, event.topic)
            for event in self.events[name]
            if isinstance(event, MessageStored) and event.robot != name
        }

    def ended(self, name, kind=SyncEnded):
        return [event.direction.value for event in self.events[name] if isinstance(event, kind)]


def met(protocol, until_s, **how):
    """Two robots are in contact until then."""
    field = Field(protocol, **how)
    field.contact(1, 2, up=True)
    field.queue.run(until_s)
    return field


@pytest.mark.parametrize("protocol", ["original", "ours"])
def test_two_robots_meet(protocol):
    field = met(protocol, 60.0)
    assert field.stored("ugv01") == {("ugv02", "/pose"), ("ugv02", "/path")}
    assert field.stored("ugv02") == {("ugv01", "/pose"), ("ugv01", "/path")}
    assert sorted(field.ended("ugv01")) == ["in", "out"]
    assert (field.airtime.complete, field.airtime.broken, field.channel_sim.open) == (2, 0, 0)
    rows = field.rows()
    stages = [Stage(row["stage"]) for row in rows if row["requesting"] == 1]
    # Ours takes both messages in one frame, and ends without a request.
    assert stages == ([HEADER, DATA, DATA, END] if protocol == "original" else [HEADER, DATA])
    assert rows["messages"][rows["stage"] == DATA].sum() == 4


def test_who_comes_later_in_the_order_waits():
    field = met("original", 60.0)
    rows = field.rows()
    assert np.all(rows["start_s"][1:] == rows["end_s"][:-1])
    second = rows[rows["requesting"] == 2]
    assert second["ready_s"][0] == 0.0
    assert second["start_s"][0] == 4.0  # after the four of the first
    waits = rows["start_s"] - rows["ready_s"]
    assert waits[rows["requesting"] == 1].max() == 0.0


@pytest.mark.parametrize("protocol", ["original", "ours"])
def test_what_is_held_goes_on_at_the_next_contact_and_then_everything_new_follows(protocol):
    field = met(protocol, 1.5)  # in the middle of the first piece of data
    field.contact(1, 2, up=False)
    assert field.stored("ugv01") == set()
    field.queue.run(100.0)
    field.contact(1, 2, up=True)
    field.queue.run(150.0)
    again = field.rows()[1]
    (cut,) = field.rows(complete=False)
    assert (cut["stage"], cut["ready_s"], cut["messages"]) == (DATA, 1.0, 0)
    assert 0 < cut["bytes"] < again["bytes"]
    assert (again["stage"], again["ready_s"], again["start_s"]) == (DATA, 1.0, 100.0)
    assert field.stored("ugv01") == {("ugv02", "/pose"), ("ugv02", "/path")}
    assert (field.airtime.broken, field.channel_sim.open) == (0, 0)
    assert field.airtime.complete == 4  # the two that were held, and one each for the new contact


@pytest.mark.parametrize("protocol", ["original", "ours"])
def test_after_the_time_out_an_exchange_begins_anew(protocol):
    field = met(protocol, 1.5, patience_s=5.0)
    field.contact(1, 2, up=False)
    field.queue.run(4.0)
    field.contact(1, 2, up=True)  # in time
    field.queue.run(4.5)
    field.contact(1, 2, up=False)
    field.queue.run(9.4)
    assert field.airtime.broken == 0
    field.queue.run(20.0)
    assert field.airtime.broken == 2
    assert "in" in field.ended("ugv01", SyncTimedOut)
    field.contact(1, 2, up=True)
    field.queue.run(60.0)
    assert field.stored("ugv01") == {("ugv02", "/pose"), ("ugv02", "/path")}
    assert field.airtime.complete == 2
    assert field.channel_sim.contacts() == [
        (0.0, 1.5, 1, 2),
        (4.0, 4.5, 1, 2),
        (20.0, 60.0, 1, 2),
    ]


@pytest.mark.parametrize("protocol", ["original", "ours"])
def test_messages_travel_over_a_third_robot(protocol):
    field = met(protocol, 30.0)
    field.contact(1, 2, up=False)
    field.contact(0, 2, up=True)
    field.queue.run(60.0)
    assert ("ugv01", "/pose") in field.stored("uav01")
    assert ("ugv01", "/claimed_goals") not in field.stored("uav01")


def test_in_a_contact_that_lasts_robots_pull_again_at_the_channel_s_interval():
    field = Field("ours")
    field.channel.pull_every_s = 10.0
    field.contact(1, 2, up=True)
    for second in range(1, 40):
        field.queue.run(float(second))
        field.channel_sim.update(NOWHERE)
    assert field.airtime.complete == 8


def pulled(field, name, until_s):
    """When a node's own pulls from the others began, looked at twice a second."""
    times_s = []
    while field.queue.now_s < until_s:
        before = len(field.ended(name, SyncStarted))
        field.channel_sim.update(NOWHERE)
        field.queue.run(field.queue.now_s + 0.5)
        begun = field.ended(name, SyncStarted)[before:]
        times_s += [field.queue.now_s - 0.5] * begun.count("in")
    return times_s


@pytest.mark.parametrize("protocol", ["original", "ours"])
def test_a_node_pulls_by_its_own_trigger_while_a_contact_lasts(protocol):
    field = Field(protocol, triggered=True)
    field.channel.duration_s = lambda *_: 0.01
    field.contact(1, 2, up=True)
    times_s = {"original": [2.0, 4.0, 6.0, 8.0], "ours": [2.0, 6.0]}[protocol]  # ours pushes
    assert pulled(field, "ugv01", 9.0) == times_s  # and the first, at once
    field.contact(1, 2, up=False)
    assert pulled(field, "ugv01", 20.0) == []
    pulls = 2 * (1 + len(times_s))
    assert (field.airtime.complete, field.airtime.broken, field.channel_sim.open) == (pulls, 0, 0)
    kinds = [type(e) for e in field.events["ugv01"] if isinstance(e, ContactBegan | ContactEnded)]
    assert kinds == [ContactBegan, ContactEnded]


def test_between_two_pulls_ours_pushes_what_is_new_and_the_original_does_not():
    stored = {}
    for protocol in ("original", "ours"):
        field = Field(protocol, triggered=True)
        field.channel.duration_s = lambda *_: 0.01
        field.contact(1, 2, up=True)
        field.queue.run(1.0)
        field.nodes[2].publish("/claimed_goals", b"new")
        field.channel_sim.settle()
        field.channel_sim.update(NOWHERE)
        field.queue.run(1.5)
        stored[protocol] = ("ugv02", "/claimed_goals") in field.stored("ugv01")
    assert stored == {"original": False, "ours": True}


def test_a_pull_that_waits_too_long_for_the_channel_times_out_as_a_node_s_does():
    field = Field("ours", triggered=True)
    field.channel.occupied = lambda *_: {0, 1, 2}
    field.contact(1, 2, up=True)
    pulled(field, "ugv01", 9.0)
    assert field.ended("ugv01", SyncTimedOut)[:1] == ["in"]
    assert field.airtime.broken == 2
