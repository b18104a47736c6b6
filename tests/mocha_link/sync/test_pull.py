"""One pull over every path there is: which one it takes, and what it does when one fails."""

import random
from collections.abc import Iterable
from dataclasses import replace

import pytest

from benchmarks.fleet.network_sim import Carried, NetworkSim, pair_of, pulling
from mocha_link.links.metrics import Direction, MessageStored, SyncEnded, SyncStarted, SyncTimedOut
from mocha_link.node.gossip import TIMEOUT_S, Gossip
from mocha_link.sync.peer_path import MAX_MISSES, RETRY_EVERY
from mocha_link.sync.protocol import REQUEST_PATIENCE_S, Connect
from mocha_link.team.team import Team
from tests.mocha_link.conftest import noise
from tests.mocha_link.old_node import OldNode

FAR_S = 0.05  # half a round trip
IN, OUT = Direction.IN, Direction.OUT
UP, DOWN = ("udp", "io", "titan"), ("udp", "titan", "io")
TOPICS = 200
WIDE = pair_of(TOPICS)


@pytest.fixture
def net(team) -> NetworkSim:
    """io and titan, some way from each other."""
    net = NetworkSim(team, datagrams=True, delay_s=FAR_S)
    net.publish("titan", "/map", b"grid" * 1000)
    return net


def path(net: NetworkSim, client: str = "io", server: str = "titan") -> str | None:
    return net.nodes[client].links(net.now)[server].path


def ended(net: NetworkSim, name: str = "io") -> SyncEnded:
    return net.events_of(name, SyncEnded)[-1]


def until_some_came(net: NetworkSim, size: int = 100_000) -> None:
    """Let time pass until io has got so many bytes of titan."""
    while net.nodes["io"].links(net.now)["titan"].bytes_in < size:
        net.wait(0.01)
    assert pulling(net.nodes["io"]), "it should still be under way"


# --- which path


@pytest.mark.parametrize("datagrams", [True, False])
def test_both_sides_know_what_the_link_moved(team, datagrams):
    net = NetworkSim(team, datagrams=datagrams, delay_s=FAR_S)
    net.publish("titan", "/map", noise(2_000_000))
    net.pull("io", "titan")
    net.wait(1)
    moved = 2_000_000 / ended(net).duration_s
    for name, peer in (("io", "titan"), ("titan", "io")):
        found = net.nodes[name].links(net.now)[peer].bandwidth_bytes_s
        assert 0.8 * moved < found < 2 * moved
        net.publish("titan", "/slow", b"small")
        net.pull("io", "titan")
        assert net.nodes[name].links(net.now)[peer].bandwidth_bytes_s == found


def test_a_far_peer_by_datagrams(net):
    """They carry the messages before a connection stands."""
    net.pull("io", "titan")
    assert path(net) == "udp"
    assert net.held("io") == net.held("titan")
    assert ended(net).duration_s < 2.5 * 2 * FAR_S
    assert not net.sent("zmq", "titan", "io")


def test_a_near_peer_by_the_connection(team):
    net = NetworkSim(team, datagrams=True, delay_s=0.001)
    net.publish("titan", "/map", b"grid")
    net.nodes["io"].sync("titan", net.now)
    net.nodes["io"].progress("titan", net.now, 0.002)
    net.settle()
    assert path(net) == "zmq"
    net.publish("titan", "/map", b"grid 2")
    net.carried.clear()
    net.pull("io", "titan")
    assert path(net) == "zmq"
    assert not net.sent(*UP)
    assert net.held("io") == net.held("titan")


def test_an_original_peer(team):
    """It refuses SYNC1 and answers the GHEAD behind it; all goes on by its protocol."""
    net = NetworkSim(team, datagrams=True, delay_s=FAR_S)
    old = OldNode(net, "titan")
    old.publish("/map", b"old grid")
    net.pull("io", "titan")
    assert net.held("io") == {("titan", "/map"): b"old grid"}
    assert path(net) == "original"
    codes = [frame[6:11] for frame in net.sent("zmq", "io", "titan")]
    assert codes == [b"SYNC1", b"GHEAD", b"GDATA", b"DENDT"]
    assert ended(net) == SyncEnded(
        "titan", ended(net).at_s, IN, 1, ended(net).bytes, ended(net).duration_s
    )
    assert net.nodes["io"].links(net.now)["titan"].refused == 0


def test_an_original_peer_on_a_slow_link(team):
    """It takes long, datagrams were tried in vain, and all that counts is that bytes come."""
    net = NetworkSim(team, datagrams=True, delay_s=FAR_S)
    OldNode(net, "titan").publish("/map", noise(100_000))
    net.lets_by = lambda piece: piece[:3] != ("zmq", "titan", "io") or len(piece.data) < 10_000
    io = net.nodes["io"]
    io.sync("titan", net.now)
    net.wait(1)
    before = len(net.sent(*UP))
    assert before
    for _ in range(30):  # the reply is coming in
        io.progress("titan", net.now)
        net.wait(1)
    assert not net.events_of("io", SyncTimedOut)
    assert len(net.sent(*UP)) == before  # each of them would take of the link
    assert io.wake_s == net.now.steady_s - 1 + TIMEOUT_S  # nothing but the end of patience


# --- where one path is closed


@pytest.mark.parametrize(
    ("closed", "open_path"),
    [
        ((UP, DOWN), "zmq"),
        ((("zmq", "io", "titan"), ("zmq", "titan", "io")), "udp"),
    ],
)
def test_where_one_path_is_closed_the_other_serves(net, closed, open_path):
    net.blocked = {*closed}
    net.pull("io", "titan")
    assert path(net) == open_path
    assert net.held("io") == net.held("titan")
    assert not net.events_of("io", SyncTimedOut)


def test_where_answers_by_udp_are_blocked_the_connection_serves_before_long(net):
    """Datagrams get there, and what comes back does not: a firewall, or another interface."""
    net.blocked = {DOWN}
    for _ in range(5):
        net.publish("titan", "/map", noise(20_000))
        net.pull("io", "titan")
        assert path(net) == "zmq"
        assert ended(net).complete
        assert ended(net).duration_s < 10 * 2 * FAR_S
        assert net.held("io") == net.held("titan")
        net.wait(1)
    assert not net.events_of("io", SyncTimedOut)
    assert not [e for e in net.events_of("titan", SyncTimedOut) if e.direction is not OUT]


@pytest.mark.parametrize("until", [0, 1, 2, 5])
def test_a_contact_that_dies_proves_nothing_of_datagrams(team, until):
    """A relay on the way accepts the connection, and the contact is over after some datagrams."""
    net = NetworkSim(team, datagrams=True, delay_s=FAR_S)
    net.publish("titan", "/map", noise(500_000))
    came = 0

    def first_ones(piece: Carried) -> bool:
        nonlocal came
        came += piece[:3] == DOWN
        return piece[:3] != ("zmq", "titan", "io") and (piece[:3] != DOWN or came <= until)

    net.lets_by = first_ones
    for _ in range(3 * MAX_MISSES):
        came = 0
        net.carried.clear()
        net.pull("io", "titan")
        assert net.sent(*UP), "not tried"
        net.wait(20)
    assert not net.events_of("io", SyncEnded)
    assert net.link("io", "titan").peer.path.udp_misses == 0


def test_datagrams_that_carry_nothing_are_given_up_for_a_while(team):
    """titan takes the datagrams and answers, but larger ones do not get through."""
    net = NetworkSim(team, datagrams=True, delay_s=FAR_S)
    net.publish("titan", "/map", noise(20_000))
    net.blocked = {("zmq", "io", "titan")}  # so that nothing else may help
    net.lets_by = lambda piece: piece[:3] != DOWN or len(piece.data) < 600
    tried = []
    for _ in range(MAX_MISSES + 2 * RETRY_EVERY):
        net.carried.clear()
        net.pull("io", "titan")
        net.wait(REQUEST_PATIENCE_S)  # until then it takes what begins anew for a copy
        tried.append(bool(net.sent(*UP)))
    assert tried[:MAX_MISSES] == [True] * MAX_MISSES
    assert tried.count(True) == MAX_MISSES + 2
    net.lets_by = None
    for _ in range(RETRY_EVERY):
        net.pull("io", "titan")
    assert net.held("io") == net.held("titan")
    net.carried.clear()
    net.pull("io", "titan")
    assert net.sent(*UP)  # from now on at once


def test_a_connection_that_is_lost_does_not_matter_while_datagrams_get_through(net):
    net.publish("titan", "/slow", noise(50_000))
    io = net.nodes["io"]
    io.sync("titan", net.now)
    until_some_came(net, 1_000)
    io.lost("titan", "cannot connect to titan: refused", net.now)
    net.settle()
    assert not net.events_of("io", SyncTimedOut)
    assert net.held("io") == net.held("titan")


def test_a_datagram_that_comes_late_does_not_hide_that_the_connection_is_lost(team):
    """A sync that began over datagrams and was moved to the connection stays there."""
    net = NetworkSim(team, datagrams=True, delay_s=0.008)
    net.publish("titan", "/map", noise(3_000_000))
    io = net.nodes["io"]
    peer, back = (net.link(a, b).peer for a, b in (("io", "titan"), ("titan", "io")))
    peer.path.measured(0.03)  # it was further away last time: datagrams go at once
    peer.tokens.receive(back.tokens.next)
    held: list[bytes] = []

    def hold(piece: Carried) -> bool:
        if (
            piece[:3] == ("udp", "titan", "io")
            and len(piece.data) > 1000
            and (held or len(net.sent("udp", "titan", "io")) > 5)
        ):
            held.append(piece.data)
            return False
        return True

    net.lets_by = hold
    io.sync("titan", net.now)
    until_some_came(net, 1_000_000)
    assert net.sent("zmq", "titan", "io")
    io.packet_back("titan", held[0], net.now)
    io.lost("titan", "the peer closed the connection", net.now)
    net.wait(0.01)
    (broken,) = (e for e in net.events_of("io", SyncTimedOut) if e.direction is IN)
    assert broken.reason == "the peer closed the connection"


# --- peers that are none, or that change


@pytest.mark.parametrize(
    "parts",
    [
        [b"absent!"],
        [],
        [b"\0\0\0\0\0\1", b"two"],
        [b"\0\0\0\0\0\1" + b"garbage"],
        [b"\0\0\0\0\0\1" + bytes(60)],
    ],
)
def test_what_answers_is_no_node(team, parts):
    net = NetworkSim(team)
    io = net.nodes["io"]
    io.sync("titan", net.now)
    io.progress("titan", net.now)
    io.reply("titan", parts, net.now)
    events = io.take()[1]
    assert [type(event) for event in events] == [SyncStarted, SyncTimedOut]
    assert events[1].reason in (
        "the peer answered without a request",
        "what answers there is not a node",
    )
    assert io.links(net.now)["titan"].refused == 1


def test_a_peer_that_restarts_in_mid_pull(net):
    """It knows nothing of the sync any more, reports it, and the next pull has the rest."""
    net.publish("titan", "/slow", noise(3_000_000))
    net.blocked = {UP, DOWN}
    io = net.nodes["io"]
    io.sync("titan", net.now)
    until_some_came(net)
    before = net.nodes["titan"]
    net.nodes["titan"] = Gossip(
        net.team, "titan", by_timer=False, datagrams=True, database=before.database
    )
    net.settle()
    (broken,) = net.events_of("io", SyncTimedOut)
    assert broken.reason == "the peer does not know of the sync any more"
    net.pull("io", "titan")
    assert net.held("io") == net.held("titan")


def test_silence_times_out(net):
    net.silent.add("titan")
    begin_s = net.time_s
    net.pull("io", "titan")
    (broken,) = net.events_of("io", SyncTimedOut)
    assert broken.reason == "no connection within 5 s"
    assert 5 < net.time_s - begin_s < 5.6


# --- gaps


def test_a_new_contact_ends_a_short_gap_at_once(net):
    """The radio receives the peer again: do not wait for timers that have grown meanwhile."""

    net.publish("titan", "/slow", noise(2_000_000))
    io = net.nodes["io"]
    io.signal_received("titan", -60, net.now)
    until_some_came(net)
    net.silent.add("titan")
    io.signal_received("titan", None, net.now)
    net.wait(3.9)
    before = io.links(net.now)["titan"].bytes_in
    net.silent.clear()
    io.signal_received("titan", -60, net.now)
    net.nodes["titan"].signal_received("io", -60, net.now)
    net.wait(2 * FAR_S + 0.03)
    assert io.links(net.now)["titan"].bytes_in > before


def test_a_long_gap_keeps_every_chunk(net):
    """It ends the pull; the next one goes on where it was."""
    net.publish("titan", "/slow", noise(2_000_000))
    net.nodes["io"].sync("titan", net.now)
    until_some_came(net)
    net.silent.add("titan")
    net.wait(20)
    assert len(net.events_of("io", SyncTimedOut)) == len(net.events_of("titan", SyncTimedOut)) == 1
    net.silent.clear()
    net.pull("io", "titan")
    assert net.held("io") == net.held("titan")
    total = net.nodes["io"].links(net.now)["titan"].bytes_in
    assert total < 2_000_000 * 1.12  # what came before the gap did not come again


def test_a_stalled_connection_is_dialled_anew_when_a_contact_begins(team):
    """TCP sleeps in its back-off; a fresh connection gets through at once."""
    net = NetworkSim(team, delay_s=FAR_S)
    net.publish("titan", "/slow", noise(2_000_000))
    io = net.nodes["io"]
    io.signal_received("titan", -60, net.now)
    until_some_came(net)
    net.silent.add("titan")
    net.wait(1.5)
    io.signal_received("titan", None, net.now)
    net.silent.clear()
    io.signal_received("titan", -60, net.now)
    actions, events = io.take()
    assert sum(isinstance(action, Connect) for action in actions) == 1
    assert [e.reason for e in events if isinstance(e, SyncTimedOut)] == [
        "stalled, and a new contact began"
    ]


@pytest.mark.parametrize("follow", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_the_end_is_lost(team, seed, follow):
    """Whatever of the last packets is lost, both sides come to know that all is over."""
    net = NetworkSim(team, datagrams=True, delay_s=FAR_S)
    net.restart("io", follow=follow)
    net.publish("titan", "/map", b"grid")
    chance = random.Random(seed)

    def mostly(piece: Carried) -> bool:
        over = not pulling(net.nodes["io"])
        return not (over and piece.path == "udp" and chance.random() < 0.6)

    net.lets_by = mostly
    net.pull("io", "titan")
    net.wait(20)
    assert net.held("io") == net.held("titan")
    assert ended(net).complete
    events = [type(e) for e in net.events["titan"] if getattr(e, "direction", None) is OUT]
    assert events == [SyncStarted, SyncEnded]
    assert not net.events_of("io", SyncTimedOut)


def budgeted(team: Team, budget_bytes: int, **options: object) -> NetworkSim:
    trigger = team.trigger.model_copy(update={"budget_bytes": budget_bytes})
    return NetworkSim(
        replace(team, trigger=trigger), names=("io", "titan"), delay_s=FAR_S, **options
    )


def test_the_next_contact_has_a_budget_of_its_own():
    """In the same contact no more; in the next ones the rest, nothing of it twice."""
    net = budgeted(WIDE, 20_000, datagrams=True)
    for number in range(40):
        net.publish("titan", f"/t{number}", noise(2_000, number))
    io = net.nodes["io"]
    for contact in range(1, 7):
        io.signal_received("titan", -60, net.now)
        net.settle()
        held = len(net.held("io"))
        assert min(40, 8 * contact) <= held <= 10 * contact
        assert io.links(net.now)["titan"].bytes_in < 22_000 * contact
        for name, direction in (("io", IN), ("titan", OUT)):
            last = [end for end in net.events_of(name, SyncEnded) if end.direction is direction][-1]
            assert last.complete == (held == 40)
        net.wait(3)
        io.signal_received("titan", -60, net.now)
        net.settle()
        assert len(net.held("io")) <= held + 1
        io.signal_received("titan", None, net.now)
        if held == 40:
            break
    assert net.held("io") == net.held("titan")
    assert len(net.events_of("io", MessageStored)) == 40
    assert io.links(net.now)["titan"].bytes_in < 40 * 2_100 + 10_000


def test_a_pull_that_goes_on_over_a_new_connection_has_a_budget_though_it_is_spent():
    """What the peer pushed meanwhile, over the connection that was lost, has used it up."""
    net = budgeted(WIDE, 20_000)
    net.publish("titan", "/t0", b"small")
    io = net.nodes["io"]
    io.signal_received("titan", -60, net.now)
    net.settle()

    def push(numbers: Iterable[int]) -> None:
        for number in numbers:
            net.publish("titan", f"/t{number}", noise(300, number))
            net.nodes["titan"].tick(net.now)  # a publication wakes the node
            net.wait(0)

    push(range(1, 50))
    net.wait(1.2 * FAR_S)
    assert io.sync("titan", net.now)
    push(range(50, 60))
    net.wait(1.2 * FAR_S)
    assert io.links(net.now)["titan"].bytes_in > 20_000
    net.lines["io", "titan"].dead = True
    for number in range(100, 140):
        net.publish("titan", f"/t{number}", noise(2_000, number))
    io.lost("titan", "the peer closed the connection", net.now)
    net.settle()
    assert io.links(net.now)["titan"].bytes_in < 22_000
    assert not ended(net).complete
