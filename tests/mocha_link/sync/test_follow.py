"""What is stored after a pull leaves at once, and costs nothing when it does not get there."""

import math
import random

import pytest

from mocha_link.links.link_events import MessageStored, SyncEnded, SyncStarted, SyncTimedOut
from mocha_link.sync.frames import FOLLOW, OPEN, message_frame
from mocha_link.sync.pull import STANDS_S
from mocha_link.sync.puller import Puller
from mocha_link.sync.server import FOLLOW_S
from mocha_link.sync.sync_messages import Have, Open
from mocha_link.sync.sync_sender import PUSH_BYTES, SyncSender
from tests.mocha_link.conftest import team_of
from tests.mocha_link.network import peer_of
from tests.mocha_link.network_sim import NEAR_DBM, NetworkSim

FAR_S = 0.05  # half a round trip
PROMPT_S = 0.02
CHAIN = """\
robots:
  callisto: {kind: rover, address: a, base_port: 10, clients: [titan]}
  io: {kind: rover, address: b, base_port: 20, clients: [titan]}
  titan: {kind: rover, address: c, base_port: 30, clients: [callisto, io]}
kinds:
  rover: {topics: [{name: /map, type: a/B}, {name: /pose, type: a/B}]}
"""


@pytest.fixture(params=[True, False], ids=["datagrams", "connection"])
def net(team, request):
    """io follows titan, some way from it."""
    net = NetworkSim(team, datagrams=request.param, delay_s=FAR_S)
    net.publish("titan", "/map", b"grid")
    net.pull("io", "titan")
    assert net.nodes["io"].links(net.now)["titan"].path == ("udp" if request.param else "zmq")
    return net


def publish(net, name, topic, data):
    net.publish(name, topic, data)
    net.nodes[name].tick(net.at(name))  # a publication wakes the node


def test_a_message_is_there_half_a_round_trip_after_it_was_published(net):
    for number in range(20):
        publish(net, "titan", "/map", b"grid %d" % number)
        net.wait(FAR_S + PROMPT_S)
        assert net.held("io")["titan", "/map"] == b"grid %d" % number
    assert len(net.told("io", SyncEnded)) == len(net.told("io", SyncStarted)) == 1
    assert len(net.told("io", MessageStored)) == 21


def test_the_next_pull_brings_what_a_push_did_not(net):
    net.silent = {"titan"}
    publish(net, "titan", "/map", b"lost")
    net.wait(FAR_S + PROMPT_S)
    net.silent = set()
    assert net.held("io")["titan", "/map"] == b"grid"
    net.pull("io", "titan")
    assert net.held("io")["titan", "/map"] == b"lost"
    assert net.told("io", SyncTimedOut) == net.told("titan", SyncTimedOut) == []
    publish(net, "titan", "/map", b"and it follows again")
    net.wait(FAR_S + PROMPT_S)
    assert net.held("io")["titan", "/map"] == b"and it follows again"


def test_a_large_message_waits_for_a_pull(net):
    large = random.Random(1).randbytes(PUSH_BYTES + 1)
    publish(net, "titan", "/map", large)
    net.wait(10 * FAR_S)
    assert net.held("io")["titan", "/map"] == b"grid"
    net.pull("io", "titan")
    assert net.held("io")["titan", "/map"] == large


def test_who_is_not_in_contact_any_more_gets_nothing(net):
    net.nodes["io"].heard("titan", NEAR_DBM, net.now)
    net.settle()
    net.nodes["io"].heard("titan", None, net.now)
    publish(net, "titan", "/map", b"far away")
    net.wait(10 * FAR_S)
    assert net.held("io")["titan", "/map"] == b"grid"


def test_a_peer_that_went_away_is_forgotten_without_a_word(net):
    net.silent = {"io"}
    net.wait(FOLLOW_S + 1)
    publish(net, "titan", "/map", b"to whom")
    before = len(net.carried)
    net.wait(1)
    assert len(net.carried) == before
    assert net.told("titan", SyncTimedOut) == []


@pytest.mark.parametrize("linked", [True, False])
def test_of_others_only_that_is_pushed_which_the_peer_gets_no_other_way(team, linked):
    """What several could push would cross every link of a neighbourhood."""
    chain = team_of(CHAIN)
    net = NetworkSim(team if linked else chain, delay_s=FAR_S)
    net.pull("titan", "callisto")
    net.pull("io", "titan")
    publish(net, "callisto", "/pose", b"here")
    net.wait(2 * (FAR_S + PROMPT_S))
    assert net.held("titan")["callisto", "/pose"] == b"here"
    assert (("callisto", "/pose") in net.held("io")) is not linked
    net.pull("io", "titan")
    assert net.held("io")["callisto", "/pose"] == b"here"


def test_who_follows_before_all_was_said_ends_the_pull():
    sender = SyncSender(peer_of())
    sender.receive(message_frame(OPEN, 0, Open(9, 0, Have(())).encode(), 0, 1000))
    sender.receive(message_frame(FOLLOW, 0, b"", 0, 1000))
    assert (sender.over, sender.follows) == (True, False)


@pytest.mark.parametrize("net", [True], indirect=True)
def test_frames_of_a_connection_that_a_new_pull_replaces_are_not_handed_in(net):
    io = net.nodes["io"]
    assert not io.leaves("titan")
    io.sync("titan", net.now)
    assert io.leaves("titan")


standing = pytest.mark.parametrize("net", [False], indirect=True, ids=["connection"])
IDLE_BYTES = 250  # both ways: what both have, and that it is the same


@standing
def test_a_pull_goes_on_over_the_connection_that_stands(net):
    line, before = net.lines["io", "titan"], len(net.carried)
    for _ in range(3):
        net.pull("io", "titan")
    assert net.lines["io", "titan"] is line
    frames = [len(piece.data) for piece in net.carried[before:]]
    assert len(frames) == 3 * 4  # OPEN, HELLO, DONE, FOLLOW
    assert sum(frames) < 3 * IDLE_BYTES
    assert all(end.complete for end in net.told("io", SyncEnded))
    publish(net, "titan", "/map", b"still pushed")
    net.wait(FAR_S + PROMPT_S)
    assert net.held("io")["titan", "/map"] == b"still pushed"


@standing
def test_what_was_pushed_before_the_next_pull_reached_the_peer_is_taken(net):
    net.nodes["io"].sync("titan", net.now)
    publish(net, "titan", "/map", b"crossed")
    net.wait(FAR_S + PROMPT_S)
    assert net.held("io")["titan", "/map"] == b"crossed"
    net.settle()
    assert net.nodes["io"].links(net.now)["titan"].refused == 0


@standing
@pytest.mark.parametrize("told", [True, False], ids=["closed", "silent"])
def test_where_the_connection_is_gone_the_pull_goes_on_over_a_new_one(net, told):
    net.lines["io", "titan"].dead = True
    publish(net, "titan", "/map", b"new")
    ends = len(net.told("io", SyncEnded))
    io = net.nodes["io"]
    io.sync("titan", net.now)
    if told:
        io.lost("titan", "the peer closed the connection", net.now)
    net.settle()
    assert net.held("io")["titan", "/map"] == b"new"
    assert len(net.told("io", SyncStarted)) == len(net.told("io", SyncEnded)) == ends + 1
    assert net.told("io", SyncTimedOut) == []


@standing
def test_what_waits_says_when_it_is_due(net):
    """A node sleeps until then; of a peer only its long silence is waited for."""
    io, titan = net.nodes["io"], net.nodes["titan"]
    assert io.due_s == math.inf
    io.heard("titan", NEAR_DBM, net.now)
    assert io.wake_s == pytest.approx(net.now.steady_s + STANDS_S, abs=0.5)
    assert titan.due_s == math.inf
    net.settle()
    assert io.wake_s == pytest.approx(net.now.steady_s + FOLLOW_S, abs=0.5)
    assert titan.wake_s == pytest.approx(net.now.steady_s + FOLLOW_S, abs=0.5)
    assert io.due_s == pytest.approx(net.now.unix_s + net.team.trigger.interval_s, abs=0.5)
    publish(net, "titan", "/slow", b"stored")
    publish(net, "titan", "/slow", b"held")
    assert net.nodes["titan"].due_s == pytest.approx(net.now.unix_s + 5.0)


@standing
def test_only_links_on_which_something_happens_are_looked_at(net, monkeypatch):
    """A hundred peers that are silent cost a node nothing."""
    looked: list[str] = []
    tick = Puller.tick
    monkeypatch.setattr(
        Puller, "tick", lambda it, now: (looked.append(it._peer.name), tick(it, now))
    )
    io = net.nodes["io"]
    io.tick(net.now)
    looked.clear()
    io.tick(net.now)
    assert looked == []
    io.progress("titan", net.now)
    io.tick(net.now)
    assert looked == ["titan"]
    publish(net, "titan", "/map", b"new")
    assert net.nodes["titan"].take_served() == {"io"}
    net.wait(FOLLOW_S + 1)
    assert "callisto" not in looked
