"""Whole nodes without sockets: who pulls when, and that nothing is ever lost or mixed up."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mocha_link import payload
from mocha_link.clock import Instant
from mocha_link.gossip import Dial, Gossip, HangUp, Send
from mocha_link.metrics import (
    ContactBegan,
    LinkState,
    MessageStored,
    RssiChanged,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.reading import Reading, Unit
from mocha_link.team import Team, UnknownRobotError

T = 1_795_175_900.0
NAMES = ("callisto", "io", "titan")


class Ether:
    """Carries frames between gossips in memory; loses them when told to."""

    def __init__(self, team: Team, *, by_timer: bool = False) -> None:
        numbers = itertools.count()
        self.team = team
        self.time_s = 0.0
        self.nodes = {
            name: Gossip(team, name, by_timer=by_timer, new_id=lambda: next(numbers).to_bytes(6))
            for name in NAMES
        }
        self.events: dict[str, list[object]] = {name: [] for name in NAMES}

    @property
    def now(self) -> Instant:
        return Instant(T + self.time_s, self.time_s)

    def publish(self, name: str, topic: str, data: bytes) -> None:
        known = self.team.topic(name, topic)
        packed = payload.pack(known.dtype, known.priority, data)
        self.nodes[name].publish(known, packed, self.now)

    def pull(self, client: str, server: str, *, cut_after: int = 1000) -> None:
        """One pull; after some requests the link is dead."""
        self.nodes[client].sync(server, self.now)
        self.carry(client, cut_after=cut_after)

    def carry(self, client: str, *, cut_after: int = 1000) -> None:
        node = self.nodes[client]
        for _ in range(1000):
            actions, events = node.take()
            self.events[client] += events
            for action in actions:
                if isinstance(action, Send) and cut_after > 0:
                    cut_after -= 1
                    server = self.nodes[action.peer]
                    reply = server.request(client, [action.frame], self.now)
                    node.reply(action.peer, [reply], self.now)
            if not actions:
                return

    def wait(self, seconds: float) -> None:
        self.time_s += seconds
        for name, node in self.nodes.items():
            node.tick(self.now)
            self.events[name] += node.take()[1]

    def held(self, name: str) -> dict[tuple[str, str], bytes]:
        held = {}
        for record in self.nodes[name].database.records():
            robot, topic = self.team.by_ids(record.header.robot_id, record.header.topic_id)
            held[robot.name, topic.name] = payload.unpack(record.body)
        return held


@pytest.fixture
def ether(team) -> Ether:
    return Ether(team)


def test_a_data_mule_carries_between_robots_that_never_meet(ether):
    ether.publish("callisto", "/pose", b"callisto is here")
    ether.pull("titan", "callisto")
    ether.pull("io", "titan")
    assert ether.held("io") == {("callisto", "/pose"): b"callisto is here"}
    assert ether.nodes["io"].links(ether.now)["callisto"].syncs_in == 0
    stored = [e for e in ether.events["io"] if isinstance(e, MessageStored)]
    assert [(e.peer, e.robot, e.topic) for e in stored] == [("titan", "callisto", "/pose")]


def test_a_contact_triggers_at_once_then_every_interval(ether):
    io = ether.nodes["io"]
    io.heard("titan", -80, ether.now)
    assert io.take() == ([], [RssiChanged("titan", T, -80, Reading(-80, Unit.DBM, "radio"))])
    io.heard("titan", -70, ether.now)
    actions, events = io.take()
    assert [type(a) for a in actions] == [Dial, Send]
    assert [type(e) for e in events] == [RssiChanged, ContactBegan, SyncStarted]
    io.heard("titan", -70, ether.now)
    assert io.take() == ([], [])
    assert io.links(ether.now)["titan"].state is LinkState.STARTED


def test_one_pull_per_peer_at_a_time(ether):
    io = ether.nodes["io"]
    assert io.sync("titan", ether.now)
    assert not io.sync("titan", ether.now)
    assert io.sync("callisto", ether.now)


def test_a_failed_pull_is_tried_again_at_the_next_trigger(ether):
    io = ether.nodes["io"]
    for second in range(9):
        ether.time_s = float(second)
        io.heard("titan", -70, ether.now)
        io.tick(ether.now)
    actions, events = io.take()
    assert [type(a) for a in actions] == [Dial, Send, HangUp, Dial, Send]
    assert [type(e) for e in events] == [
        RssiChanged,
        ContactBegan,
        SyncStarted,
        SyncTimedOut,
        SyncStarted,
    ]
    assert io.links(ether.now)["titan"].timeouts == 1


def test_a_new_contact_replaces_a_stalled_pull(ether):
    io = ether.nodes["io"]
    io.heard("titan", -70, ether.now)
    ether.time_s = 0.5
    io.heard("titan", None, ether.now)
    io.heard("titan", -70, ether.now)  # too soon to call the pull stalled
    assert [type(a) for a in io.take()[0]] == [Dial, Send]
    ether.time_s = 2.0
    io.heard("titan", None, ether.now)
    io.heard("titan", -70, ether.now)
    assert [type(a) for a in io.take()[0]] == [HangUp, Dial, Send]


def test_a_silent_radio_is_told(ether):
    io = ether.nodes["io"]
    io.heard("titan", -90, ether.now)
    ether.wait(6.5)
    assert ether.events["io"][-1] == RssiChanged("titan", T + 6.5, None)
    assert io.links(ether.now)["titan"].rssi_dbm is None


def test_by_timer_everybody_is_asked(team):
    ether = Ether(team, by_timer=True)
    ether.nodes["io"].tick(ether.now)
    dialled = [a.peer for a in ether.nodes["io"].take()[0] if isinstance(a, Dial)]
    assert dialled == ["callisto", "titan"]


def test_held_messages_leave_when_their_interval_is_over(ether):
    for data in (b"1", b"2", b"3"):
        ether.publish("titan", "/slow", data)
    assert ether.held("titan") == {("titan", "/slow"): b"1"}
    ether.wait(5)
    assert ether.held("titan") == {("titan", "/slow"): b"3"}
    own = [e for e in ether.events["titan"] if isinstance(e, MessageStored)]
    assert [(e.peer, e.robot) for e in own] == [("titan", "titan")] * 2


def test_metrics_of_both_sides(ether):
    ether.publish("titan", "/map", b"map" * 1000)
    ether.pull("io", "titan")
    io, titan = ether.nodes["io"], ether.nodes["titan"]
    ether.time_s = 4.0
    pulled, served = io.links(ether.now)["titan"], titan.links(ether.now)["io"]
    assert (pulled.state_in, served.state_out) == (LinkState.ENDED, LinkState.ENDED)
    assert pulled.bytes_in == served.bytes_out > 0
    assert (pulled.syncs_in, pulled.syncs_out, served.syncs_out) == (1, 0, 1)
    assert pulled.newest_age_s == pytest.approx(4)
    assert served.newest_age_s is None
    assert pulled.rtt_s == 0
    (ended,) = [e for e in ether.events["io"] if isinstance(e, SyncEnded)]
    assert (ended.messages, ended.bytes) == (1, pulled.bytes_in)


def test_peers_that_are_not_linked(ether):
    with pytest.raises(UnknownRobotError, match="no robot 'mars' among the clients of io"):
        ether.nodes["io"].sync("mars", ether.now)
    with pytest.raises(UnknownRobotError):
        ether.nodes["io"].heard("io", -50, ether.now)


def test_replies_and_losses_without_a_pull_are_nothing(ether):
    io = ether.nodes["io"]
    io.reply("titan", [b"what?"], ether.now)
    io.lost("titan", "gone", ether.now)
    io.progress("titan", ether.now)
    assert io.take() == ([], [])


def test_a_reboot_with_a_clock_that_is_behind_loses_nothing(ether, team):
    """The first life's message has the later stamp; the second life's must win all the same."""
    ether.publish("callisto", "/path", b"first life")
    ether.publish("callisto", "/pose", b"first life")
    ether.pull("titan", "callisto")
    ether.time_s -= 3600
    ether.nodes["callisto"] = Gossip(team, "callisto", by_timer=False)
    ether.publish("callisto", "/path", b"second life")
    ether.pull("titan", "callisto")
    ether.pull("callisto", "titan")
    assert ether.held("callisto") == {
        ("callisto", "/path"): b"second life",
        ("callisto", "/pose"): b"first life",
    }
    ether.pull("titan", "callisto")
    assert ether.held("titan") == ether.held("callisto")


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("publish"), st.sampled_from(("callisto", "io")), st.integers(0, 2)),
        st.tuples(st.just("pull"), st.permutations(NAMES), st.integers(0, 5)),
        st.tuples(st.just("wait"), st.integers(1, 20), st.just(0)),
    ),
    max_size=40,
)


@settings(
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # the team never changes
)
@given(steps=STEPS)
def test_whatever_is_cut_everything_arrives_in_the_end(team, steps):
    ether = Ether(team)
    newest = {}
    for number, (what, who, choice) in enumerate(steps):
        if what == "publish":
            topic = ("/pose", "/path", "/cloud")[choice]
            newest[who, topic] = f"{who}{topic} {number}".encode() * 50
            ether.publish(who, topic, newest[who, topic])
        elif what == "pull":
            ether.pull(who[0], who[1], cut_after=choice)
        else:
            ether.wait(who)
    for _ in range(2):  # two good rounds through titan; callisto and io do not meet
        ether.wait(10)  # pulls that were cut break off
        for client, server in (
            ("titan", "callisto"),
            ("titan", "io"),
            ("callisto", "titan"),
            ("io", "titan"),
        ):
            ether.pull(client, server)
    assert all(ether.held(name) == newest for name in NAMES)
