"""What is stored after a pull leaves at once, and costs nothing when it does not get there."""

import itertools
import math
import random

import pytest

from benchmarks.fleet.network_sim import NEAR_DBM, NetworkSim
from mocha_link.links.metrics import Direction, MessageStored, SyncEnded, SyncStarted, SyncTimedOut
from mocha_link.sync.frames import FOLLOW, OPEN, SyncFrameError, message_frame
from mocha_link.sync.protocol import FOLLOW_S
from mocha_link.sync.pull import STANDS_S
from mocha_link.sync.send_round import PUSH_BYTES
from mocha_link.sync.send_states import SendState
from mocha_link.sync.session import Session
from mocha_link.sync.sync_messages import (
    MAX_ANNOUNCED,
    Have,
    Open,
    decode_announce,
    encode_announce,
)
from mocha_link.sync.sync_sender import SyncSender
from mocha_link.team.team import Team
from tests.mocha_link.conftest import DATA, noise
from tests.mocha_link.network import peer_of

FAR_S = 0.05  # half a round trip
PROMPT_S = 0.02
HEADERS_BYTES = 2 * 66  # of Ethernet, IP and TCP, once more for the acknowledgement
CHAIN = Team.load(DATA / "chain.yaml")


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
    assert len(net.events_of("io", SyncEnded)) == len(net.events_of("io", SyncStarted)) == 1
    assert len(net.events_of("io", MessageStored)) == 21


def test_the_next_pull_brings_what_a_push_did_not(net):
    net.silent = {"titan"}
    publish(net, "titan", "/map", b"lost")
    net.wait(FAR_S + PROMPT_S)
    net.silent = set()
    assert net.held("io")["titan", "/map"] == b"grid"
    net.pull("io", "titan")
    assert net.held("io")["titan", "/map"] == b"lost"
    assert net.events_of("io", SyncTimedOut) == net.events_of("titan", SyncTimedOut) == []
    publish(net, "titan", "/map", b"and it follows again")
    net.wait(FAR_S + PROMPT_S)
    assert net.held("io")["titan", "/map"] == b"and it follows again"


def test_a_large_message_is_announced_and_pulled(net):
    """It may take its time, and be taken up again where it was cut."""
    large = random.Random(1).randbytes(PUSH_BYTES + 1)
    publish(net, "titan", "/map", large)
    net.wait(10 * FAR_S)
    assert net.held("io")["titan", "/map"] == b"grid"
    net.pull("io", "titan")
    assert net.held("io")["titan", "/map"] == large
    contact(net)
    net.wait(25)
    larger = random.Random(2).randbytes(PUSH_BYTES + 1)
    publish(net, "titan", "/map", larger)
    net.wait(1)
    assert net.held("io")["titan", "/map"] == larger


def contact(net, *pairs):
    """Radios receive each other from now on."""
    for name, peer in pairs or (("io", "titan"), ("titan", "io")):
        radio = ManualContact(net, name, peer)
        radio.report()


class ManualContact:
    """Reports again and again that a peer is received, as radios do."""

    def __init__(self, net, name, peer):
        self._net, self._name, self._peer = net, name, peer

    def report(self):
        net = self._net
        net.nodes[self._name].signal_received(self._peer, NEAR_DBM, net.at(self._name))
        net.later(self.report, net.time_s + 1)


def test_an_idle_contact_is_quiet(net):
    contact(net)
    net.wait(30)
    before, pulls = len(net.carried), len(net.events_of("io", SyncStarted))
    net.wait(60)
    assert len(net.events_of("io", SyncStarted)) - pulls <= 10  # in and out
    size = sum(len(piece.data) + HEADERS_BYTES for piece in net.carried[before:])
    assert size / 60 < (100 if net.nodes["io"].links(net.now)["titan"].path == "zmq" else 250)


def at_rest(team):
    """io and titan have been in contact for a while, over connections."""
    net = NetworkSim(team, delay_s=FAR_S)
    contact(net)
    net.wait(60)
    return net


def pulls(net, name):
    return [
        each.at_s for each in net.events_of(name, SyncStarted) if each.direction is Direction.IN
    ]


def until_the_next_pull(net, name):
    before = len(pulls(net, name))
    while len(pulls(net, name)) == before:
        net.wait(0.5)
    net.wait(1)


def test_of_two_at_rest_each_pulls_when_the_other_does_and_rarely(team):
    net = at_rest(team)
    for each in net.events.values():
        each.clear()
    net.wait(120)
    io, titan = pulls(net, "io"), pulls(net, "titan")
    assert len(io) == len(titan) == 8
    assert all(abs(a - b) < 1 for a, b in zip(io, titan, strict=True))
    assert net.events_of("io", SyncTimedOut) == net.events_of("titan", SyncTimedOut) == []


def test_what_a_push_did_not_bring_the_next_pull_of_either_brings(team):
    net = at_rest(team)
    until_the_next_pull(net, "io")
    net.silent = {"titan"}
    publish(net, "titan", "/map", b"lost")
    net.wait(1)
    net.silent = set()
    until_the_next_pull(net, "titan")
    net.wait(STANDS_S + 1)
    assert net.held("io")["titan", "/map"] == b"lost"


def test_both_pull_over_one_connection(team):
    """Whoever opened it; of two that were opened at once one is left in the end."""
    net = at_rest(team)
    lines = {(line.client, line.server) for line in net.lines.values()}
    assert lines == {("io", "titan")}
    for number in range(3):
        for name, topic in (("io", "/pose"), ("titan", "/map")):
            net.publish(name, topic, b"%d" % number)
        net.wait(20)
        assert net.held("io") == net.held("titan")
    assert {(line.client, line.server) for line in net.lines.values()} == lines


@pytest.mark.parametrize("datagrams", [True, False])
def test_who_cannot_reach_a_peer_gets_all_that_it_has_when_the_peer_reaches_it(team, datagrams):
    net = NetworkSim(team, datagrams=datagrams, by_timer=True, delay_s=FAR_S)
    net.unreached = {("io", "titan")}
    net.publish("titan", "/map", noise(300_000))
    net.publish("io", "/pose", b"here")
    net.wait(20)
    assert (
        net.held("io")
        == net.held("titan")
        == {
            ("titan", "/map"): noise(300_000),
            ("io", "/pose"): b"here",
        }
    )
    publish(net, "titan", "/map", b"pushed")
    publish(net, "io", "/pose", b"there")
    net.wait(1)
    assert net.held("io") == net.held("titan")
    assert net.held("io")["titan", "/map"] == b"pushed"


def test_a_peer_that_has_been_away_is_pulled_from_in_return(team):
    """Its connection has broken, so ours may have, too."""
    net = at_rest(team)
    until_the_next_pull(net, "io")
    net.wait(3)
    before = len(pulls(net, "io"))
    net.nodes["titan"].lost("io", "a test", net.now)
    until_the_next_pull(net, "titan")
    assert len(pulls(net, "io")) == before + 1


def test_both_pull_when_a_program_wants_to_exchange(net):
    contact(net)
    net.wait(21)
    before = len(net.events_of("titan", SyncEnded))
    net.nodes["titan"].sync("io", net.now, both=True)
    net.nodes["titan"].tick(net.now)
    net.wait(2.5)
    assert {end.direction for end in net.events_of("titan", SyncEnded)[before:]} == set(Direction)


def test_what_a_peer_does_not_follow_itself_is_announced_to_it(team):
    """Messages of callisto, out of io's reach, come through titan within an interval."""
    net = NetworkSim(team, delay_s=FAR_S)
    contact(net, *(pair for a in ("io", "callisto") for pair in ((a, "titan"), ("titan", a))))
    net.wait(40)
    publish(net, "callisto", "/pose", b"here")
    net.wait(1)
    assert net.held("io")["callisto", "/pose"] == b"here"
    contact(net, ("io", "callisto"), ("callisto", "io"))
    net.wait(40)
    before = len(net.carried)
    publish(net, "callisto", "/pose", b"there")
    net.wait(0.9)
    assert net.held("io")["callisto", "/pose"] == b"there"
    assert len(net.carried) - before == 2  # it crosses each link once, and is not announced again
    net.nodes["io"].signal_received("callisto", None, net.now)
    net.blocked = {("zmq", "callisto", "io"), ("zmq", "io", "callisto")}
    publish(net, "callisto", "/pose", b"elsewhere")
    net.wait(2.5)
    assert net.held("io")["callisto", "/pose"] == b"elsewhere"


def test_many_that_are_announced_are_not_listed():
    assert decode_announce(encode_announce(range(MAX_ANNOUNCED))) == tuple(range(MAX_ANNOUNCED))
    assert encode_announce(range(MAX_ANNOUNCED + 1)) == b""
    with pytest.raises(SyncFrameError):
        decode_announce(b"1234567")
    with pytest.raises(SyncFrameError):
        decode_announce(bytes(8 * (MAX_ANNOUNCED + 1)))


def test_who_is_not_in_contact_any_more_gets_nothing(net):
    net.nodes["io"].signal_received("titan", NEAR_DBM, net.now)
    net.settle()
    net.nodes["io"].signal_received("titan", None, net.now)
    publish(net, "titan", "/map", b"far away")
    net.wait(10 * FAR_S)
    assert net.held("io")["titan", "/map"] == b"grid"


def test_a_peer_that_went_away_is_forgotten_without_an_event(net):
    net.silent = {"io"}
    net.wait(FOLLOW_S + 1)
    publish(net, "titan", "/map", b"to whom")
    before = len(net.carried)
    net.wait(1)
    assert len(net.carried) == before
    assert net.events_of("titan", SyncTimedOut) == []


@pytest.mark.parametrize("linked", [True, False])
def test_of_others_only_that_is_pushed_which_the_peer_gets_no_other_way(team, linked):
    """What several could push would cross every link of a neighbourhood."""
    net = NetworkSim(team if linked else CHAIN, delay_s=FAR_S)
    net.pull("titan", "callisto")
    net.pull("io", "titan")
    publish(net, "callisto", "/pose", b"here")
    net.wait(2 * (FAR_S + PROMPT_S))
    assert net.held("titan")["callisto", "/pose"] == b"here"
    assert (("callisto", "/pose") in net.held("io")) is not linked
    net.pull("io", "titan")
    assert net.held("io")["callisto", "/pose"] == b"here"


def test_who_follows_before_all_was_sent_ends_the_pull():
    sender = SyncSender(peer_of())
    sender.receive(message_frame(OPEN, 0, Open(9, 0, Have(())).encode(), 0, 1000))
    sender.receive(message_frame(FOLLOW, 0, b"", 0, 1000))
    assert sender.state is SendState.OVER


@pytest.mark.parametrize("net", [True], indirect=True)
def test_frames_of_a_connection_that_a_new_pull_replaces_are_not_handed_in(net):
    io = net.nodes["io"]
    io.lost("titan", "a test", net.now)
    io.take()
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
    assert all(end.complete for end in net.events_of("io", SyncEnded))
    publish(net, "titan", "/map", b"still pushed")
    net.wait(FAR_S + PROMPT_S)
    assert net.held("io")["titan", "/map"] == b"still pushed"


@standing
def test_what_was_pushed_before_the_next_pull_reached_the_peer_is_taken(net):
    """Of a large one the credit that it takes would come too late."""
    net.nodes["io"].sync("titan", net.now)
    crossed = random.Random(1).randbytes(50_000)
    publish(net, "titan", "/map", crossed)
    net.wait(FAR_S + PROMPT_S)
    assert net.held("io")["titan", "/map"] == crossed
    net.settle()
    net.wait(2 * FAR_S)
    assert net.nodes["io"].links(net.now)["titan"].refused == 0


@standing
@pytest.mark.parametrize("closed", [True, False], ids=["closed", "silent"])
def test_where_the_connection_is_gone_the_pull_goes_on_over_a_new_one(net, closed):
    net.lines["io", "titan"].dead = True
    publish(net, "titan", "/map", b"new")
    ends = len(net.events_of("io", SyncEnded))
    io = net.nodes["io"]
    io.sync("titan", net.now)
    if closed:
        io.lost("titan", "the peer closed the connection", net.now)
    net.settle()
    assert net.held("io")["titan", "/map"] == b"new"
    assert len(net.events_of("io", SyncStarted)) == len(net.events_of("io", SyncEnded)) == ends + 1
    assert net.events_of("io", SyncTimedOut) == []


@standing
def test_what_waits_reports_when_it_is_due(net):
    """A node sleeps until then; of a peer only its long silence is waited for."""
    io, titan = net.nodes["io"], net.nodes["titan"]
    assert io.due_in_s(net.now) == math.inf
    io.signal_received("titan", NEAR_DBM, net.now)
    assert io.wake_s == pytest.approx(net.now.steady_s + STANDS_S, abs=0.5)
    assert titan.due_in_s(net.now) == math.inf
    net.settle()
    assert io.wake_s == pytest.approx(net.now.steady_s + FOLLOW_S, abs=0.5)
    assert titan.wake_s == pytest.approx(net.now.steady_s + FOLLOW_S, abs=0.5)
    assert io.due_in_s(net.now) == pytest.approx(net.team.trigger.interval_s, abs=0.5)
    publish(net, "titan", "/slow", b"stored")
    publish(net, "titan", "/slow", b"held")
    assert net.nodes["titan"].due_in_s(net.now) == pytest.approx(5.0)


@standing
def test_only_links_on_which_something_happens_are_looked_at(net, monkeypatch):
    """A hundred peers that are silent cost a node nothing."""
    looked: list[str] = []
    tick = Session.tick
    monkeypatch.setattr(
        Session, "tick", lambda it, *given: (looked.append(it.peer.name), tick(it, *given))
    )
    io = net.nodes["io"]
    io.tick(net.now)
    looked.clear()
    io.tick(net.now)
    assert looked == []
    io.progress("titan", net.now)
    io.tick(net.now)
    assert looked == ["titan"]
    titan = net.nodes["titan"]
    titan.publish(net.team.topic("titan", "/map"), b"new", net.now)
    assert titan.tick(net.now) == {"io"}
    net.wait(FOLLOW_S + 1)
    assert "callisto" not in looked


def linked(net, *names):
    """All of them receive each other from now on."""
    contact(net, *itertools.permutations(names, 2))


def test_what_a_lost_peer_stores_comes_by_another_at_once(team):
    """A peer that is pulled from rarely leaves out what is followed elsewhere; that is over now."""
    net = NetworkSim(team, by_timer=True, delay_s=0.01)
    net.wait(50)
    callisto = net.link("callisto", "titan").session
    publish(net, "titan", "/map", random.Random(1).randbytes(PUSH_BYTES + 1))
    while callisto.has_all:
        net.wait(0.001)
    net.blocked = {("zmq", "callisto", "titan"), ("zmq", "titan", "callisto")}
    while net.team.robot("titan").robot_id in callisto.peer.node.followed:
        net.wait(0.1)
    publish(net, "titan", "/slow", b"after")
    net.wait(3)
    assert net.held("callisto")["titan", "/slow"] == b"after"


@pytest.mark.parametrize("datagrams", [True, False], ids=["datagrams", "connection"])
def test_a_pull_from_one_does_not_have_the_others_pulled_from(team, datagrams):
    net = NetworkSim(team, datagrams=datagrams, delay_s=2 * FAR_S)
    for number, pair in enumerate(itertools.combinations(net.nodes, 2)):
        linked(net, *pair)
        net.wait(4 + number)
    net.wait(45)
    before = {name: len(net.events_of(name, SyncStarted)) for name in net.nodes}
    net.wait(60)
    for name, seen in before.items():
        pulls = net.events_of(name, SyncStarted)[seen:]
        assert sum(pull.direction is Direction.IN for pull in pulls) <= 10
