"""One pull over every path there is: which one it takes, and what it does when one fails."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import pytest

from mocha_link.links.metrics import Direction, MessageStored, SyncEnded, SyncStarted, SyncTimedOut
from mocha_link.node.actions import Connect
from mocha_link.node.gossip import LEAST_BUDGET
from mocha_link.sync.pull import MAX_MISSES, RETRY_EVERY
from mocha_link.team.document import Document
from mocha_link.team.team import Team
from tests.mocha_link.ether import Carried, Ether, OldNode

FAR_S = 0.05  # half a round trip
IN, OUT = Direction.IN, Direction.OUT
UP, DOWN = ("udp", "io", "titan"), ("udp", "titan", "io")
TOPICS = 200
WIDE = Team.from_document(
    Document.from_text(
        "robots:\n"
        "  io: {kind: rover, address: a, base_port: 10, clients: [titan]}\n"
        "  titan: {kind: rover, address: b, base_port: 10, clients: [io]}\n"
        "kinds:\n"
        "  rover:\n"
        "    topics:\n"
        + "".join(f"      - {{name: /t{topic}, type: a/B}}\n" for topic in range(TOPICS)),
        Path("team.yaml"),
    )
)


@pytest.fixture
def ether(team) -> Ether:
    """io and titan, some way from each other."""
    ether = Ether(team, datagrams=True, delay_s=FAR_S)
    ether.publish("titan", "/map", b"grid" * 1000)
    return ether


def path(ether: Ether, client: str = "io", server: str = "titan") -> str | None:
    return ether.nodes[client].links(ether.now)[server].path


def ended(ether: Ether, name: str = "io") -> SyncEnded:
    return ether.told(name, SyncEnded)[-1]


def noise(size: int, seed: int = 1) -> bytes:
    return random.Random(seed).randbytes(size)


def until_some_came(ether: Ether, size: int = 100_000) -> None:
    """Let time pass until io has got so many bytes of titan."""
    while ether.nodes["io"].links(ether.now)["titan"].bytes_in < size:
        ether.wait(0.01)
    assert ether.nodes["io"]._pulls, "it should still be under way"


def blocked(*ways: tuple[str, str, str]) -> set[tuple[str, str, str]]:
    return {*ways}


# --- which path


def test_nothing_new(ether):
    ether.pull("io", "titan")
    before = len(ether.carried)
    ether.pull("io", "titan")
    assert [e.messages for e in ether.told("io", SyncEnded)] == [1, 0]
    assert ended(ether).complete
    assert sum(len(c.data) for c in ether.carried[before:]) < 700


@pytest.mark.parametrize("datagrams", [True, False])
def test_both_sides_know_what_the_link_moved(team, datagrams):
    ether = Ether(team, datagrams=datagrams, delay_s=FAR_S)
    ether.publish("titan", "/map", noise(2_000_000))
    ether.pull("io", "titan")
    ether.wait(1)
    moved = 2_000_000 / ended(ether).duration_s
    for name, peer in (("io", "titan"), ("titan", "io")):
        found = ether.nodes[name].links(ether.now)[peer].bandwidth_bytes_s
        assert 0.8 * moved < found < 2 * moved
        ether.publish("titan", "/slow", b"small")
        ether.pull("io", "titan")
        assert ether.nodes[name].links(ether.now)[peer].bandwidth_bytes_s == found


def test_a_far_peer_by_datagrams(ether):
    """They carry the messages before a connection stands."""
    ether.pull("io", "titan")
    assert path(ether) == "udp"
    assert ether.held("io") == ether.held("titan")
    assert ended(ether).duration_s < 2.5 * 2 * FAR_S
    assert not ether.sent("zmq", "titan", "io")


def test_a_near_peer_by_the_connection(team):
    ether = Ether(team, datagrams=True, delay_s=0.001)
    ether.publish("titan", "/map", b"grid")
    ether.nodes["io"].sync("titan", ether.now)
    ether.nodes["io"].measured("titan", 0.002)
    ether.settle()
    assert path(ether) == "zmq"
    ether.publish("titan", "/map", b"grid 2")
    ether.carried.clear()
    ether.pull("io", "titan")
    assert path(ether) == "zmq"
    assert not ether.sent(*UP)
    assert ether.held("io") == ether.held("titan")


def test_an_original_peer(team):
    """It refuses SYNC1 and answers the GHEAD behind it; all goes on by its protocol."""
    ether = Ether(team, datagrams=True, delay_s=FAR_S)
    old = OldNode(ether, "titan")
    old.publish("/map", b"old grid")
    ether.pull("io", "titan")
    assert ether.held("io") == {("titan", "/map"): b"old grid"}
    assert path(ether) == "original"
    codes = [frame[6:11] for frame in ether.sent("zmq", "io", "titan")]
    assert codes == [b"SYNC1", b"GHEAD", b"GDATA", b"DENDT"]
    assert ended(ether) == SyncEnded(
        "titan", ended(ether).at_s, IN, 1, ended(ether).bytes, ended(ether).duration_s
    )
    assert ether.nodes["io"].links(ether.now)["titan"].refused == 0


def test_a_peer_that_is_said_to_be_original(team):
    ether = Ether(team.with_robots({"titan": {"original": True}}), datagrams=True, delay_s=FAR_S)
    ether.publish("titan", "/map", b"grid")
    ether.pull("io", "titan")
    assert ether.held("io") == {("titan", "/map"): b"grid"}
    codes = [frame[6:11] for frame in ether.sent("zmq", "io", "titan")]
    assert codes == [b"GHEAD", b"GDATA", b"DENDT"]
    assert not ether.sent(*UP)
    assert path(ether) == "original"


def test_an_original_peer_with_many_messages():
    """The window widens by what was seen; every reply is taken once."""
    ether = Ether(WIDE, names=("io", "titan"), datagrams=True, delay_s=FAR_S)
    old = OldNode(ether, "titan")
    for number in range(TOPICS):
        old.publish(f"/t{number}", b"message %d" % number)
    ether.pull("io", "titan")
    assert ether.held("io") == {
        ("titan", f"/t{number}"): b"message %d" % number for number in range(TOPICS)
    }
    codes = [frame[6:11] for frame in ether.sent("zmq", "io", "titan")]
    assert codes == [b"SYNC1", b"GHEAD", *[b"GDATA"] * TOPICS, b"DENDT"]
    # Two round trips to the list, some for windows that widen, one for the end.
    assert ended(ether).duration_s < 12 * 2 * FAR_S


def test_an_original_peer_on_a_slow_link(team):
    """It takes long, datagrams were tried in vain, and all that counts is that bytes come."""
    ether = Ether(team, datagrams=True, delay_s=FAR_S)
    OldNode(ether, "titan").publish("/map", noise(100_000))
    ether.lets_by = lambda piece: piece[:3] != ("zmq", "titan", "io") or len(piece.data) < 10_000
    io = ether.nodes["io"]
    io.sync("titan", ether.now)
    ether.wait(1)
    assert ether.sent(*UP)
    for _ in range(30):  # the reply is coming in
        io.progress("titan", ether.now)
        ether.wait(1)
    assert not ether.told("io", SyncTimedOut)


# --- where one path is closed


def test_where_udp_is_blocked_the_connection_serves(ether):
    ether.blocked = blocked(UP, DOWN)
    ether.pull("io", "titan")
    assert path(ether) == "zmq"
    assert ether.held("io") == ether.held("titan")
    assert not ether.told("io", SyncTimedOut)


def test_where_answers_by_udp_are_blocked_the_connection_serves_before_long(ether):
    """Datagrams get there, and what comes back does not: a firewall, or another interface."""
    ether.blocked = blocked(DOWN)
    for _ in range(5):
        ether.publish("titan", "/map", noise(20_000))
        ether.pull("io", "titan")
        assert path(ether) == "zmq"
        assert ended(ether).complete
        assert ended(ether).duration_s < 10 * 2 * FAR_S
        assert ether.held("io") == ether.held("titan")
        ether.wait(1)
    assert not ether.told("io", SyncTimedOut)
    assert not [e for e in ether.told("titan", SyncTimedOut) if e.direction is not OUT]


def test_where_only_our_acknowledgements_are_lost_nothing_is_taken_twice_or_left_out(ether):
    """What the connection repeats are the same frames, so none stands for another."""
    for topic in ("/map", "/slow"):
        ether.publish("titan", topic, noise(60_000))
    ether.lets_by = lambda piece: piece[:3] != UP or len(piece.data) > 1_000  # the opening
    ether.pull("io", "titan")
    assert ended(ether).complete
    assert ended(ether).messages == 2
    assert ether.held("io") == ether.held("titan")
    assert not ether.told("io", SyncTimedOut)


@pytest.mark.parametrize("until", [0, 1, 2, 5])
def test_a_contact_that_dies_says_nothing_of_datagrams(team, until):
    """A relay on the way accepts the connection, and the contact is over after some datagrams."""
    ether = Ether(team, datagrams=True, delay_s=FAR_S)
    ether.publish("titan", "/map", noise(500_000))
    came = 0

    def first_ones(piece: Carried) -> bool:
        nonlocal came
        came += piece[:3] == DOWN
        return piece[:3] != ("zmq", "titan", "io") and (piece[:3] != DOWN or came <= until)

    ether.lets_by = first_ones
    for _ in range(3 * MAX_MISSES):
        came = 0
        ether.carried.clear()
        ether.pull("io", "titan")
        assert ether.sent(*UP), "not tried"
        ether.wait(20)
    assert not ether.told("io", SyncEnded)
    assert ether.nodes["io"]._path_stats["titan"].udp_misses == 0


def test_where_tcp_is_blocked_datagrams_serve(ether):
    ether.blocked = blocked(("zmq", "io", "titan"), ("zmq", "titan", "io"))
    ether.pull("io", "titan")
    assert path(ether) == "udp"
    assert ether.held("io") == ether.held("titan")


def test_datagrams_that_carry_nothing_are_given_up_for_a_while(team):
    """titan takes the datagrams and answers, but larger ones do not get through."""
    ether = Ether(team, datagrams=True, delay_s=FAR_S)
    ether.publish("titan", "/map", noise(20_000))
    ether.blocked = blocked(("zmq", "io", "titan"))  # so that nothing else may help
    ether.lets_by = lambda piece: piece[:3] != DOWN or len(piece.data) < 600
    tried = []
    for _ in range(MAX_MISSES + 2 * RETRY_EVERY):
        ether.carried.clear()
        ether.pull("io", "titan")
        ether.wait(1)
        tried.append(bool(ether.sent(*UP)))
    assert tried[:MAX_MISSES] == [True] * MAX_MISSES
    assert tried.count(True) == MAX_MISSES + 2
    ether.lets_by = None
    for _ in range(RETRY_EVERY):
        ether.pull("io", "titan")
    assert ether.held("io") == ether.held("titan")
    ether.carried.clear()
    ether.pull("io", "titan")
    assert ether.sent(*UP)  # from now on at once


def test_a_connection_that_is_lost_does_not_matter_while_datagrams_get_through(ether):
    ether.publish("titan", "/slow", noise(50_000))
    io = ether.nodes["io"]
    io.sync("titan", ether.now)
    until_some_came(ether, 1_000)
    io.lost("titan", "cannot connect to titan: refused", ether.now)
    ether.settle()
    assert not ether.told("io", SyncTimedOut)
    assert ether.held("io") == ether.held("titan")


def test_a_refused_connection_before_anything_came_ends_the_pull(ether):
    """There is no node: say so at once, not in 5 s."""
    io = ether.nodes["io"]
    io.sync("titan", ether.now)
    io.lost("titan", "cannot connect to titan: refused", ether.now)
    ether.carry()
    (broken,) = ether.told("io", SyncTimedOut)
    assert broken.reason == "cannot connect to titan: refused"
    assert io.sync("titan", ether.now)


# --- peers that are none, or that change


@pytest.mark.parametrize(
    ("parts", "refusals"),
    [
        ([b"absent!"], 1),
        ([], 1),
        ([b"\0\0\0\0\0\1", b"two"], 1),
        ([b"\0\0\0\0\0\1" + b"garbage"], 1),
        ([b"\0\0\0\0\0\1" + bytes(60)], 1),
    ],
)
def test_what_answers_is_no_node(team, parts, refusals):
    ether = Ether(team)
    io = ether.nodes["io"]
    io.sync("titan", ether.now)
    io.progress("titan", ether.now)
    io.reply("titan", parts, ether.now)
    events = io.take()[1]
    assert [type(event) for event in events] == [SyncStarted, SyncTimedOut]
    assert events[1].reason in (
        "the peer answered what was not asked",
        "what answers there is not a node",
    )
    assert io.links(ether.now)["titan"].refused == refusals


def test_a_peer_that_refuses_everything_times_out(team):
    ether = Ether(team)
    io = ether.nodes["io"]
    io.sync("titan", ether.now)
    io.progress("titan", ether.now)
    io.reply("titan", [b"\0\0\0\0\0\1SERRM"], ether.now)
    ether.silent.add("titan")
    ether.settle()
    (broken,) = ether.told("io", SyncTimedOut)
    assert broken.reason == "no byte for 5 s, waiting for the reply to GHEAD"


def test_a_peer_that_restarts_in_mid_pull(ether):
    """It knows nothing of the sync any more, says so, and the next pull has the rest."""
    ether.publish("titan", "/slow", noise(3_000_000))
    ether.blocked = blocked(UP, DOWN)
    io = ether.nodes["io"]
    io.sync("titan", ether.now)
    until_some_came(ether)
    ether.nodes["titan"]._servers["io"].__init__(
        "io", ether.nodes["titan"].database, ether.nodes["titan"]._known["io"]
    )
    ether.settle()
    (broken,) = ether.told("io", SyncTimedOut)
    assert broken.reason == "the peer does not know of the sync any more"
    ether.pull("io", "titan")
    assert ether.held("io") == ether.held("titan")


def test_silence_in_the_middle_of_a_pull(ether):
    ether.publish("titan", "/slow", noise(3_000_000))
    ether.nodes["io"].sync("titan", ether.now)
    until_some_came(ether)
    ether.silent.add("titan")
    ether.settle()
    (broken,) = ether.told("io", SyncTimedOut)
    assert broken.reason == "no byte for 5 s in the middle of a sync"


def test_a_peer_with_a_new_database(ether):
    """What we know of the old one is worth nothing; what we hold is not sent again."""
    ether.pull("io", "titan")
    ether.restart("titan")
    ether.publish("titan", "/slow", b"new")
    ether.pull("io", "titan")
    assert ether.held("io") == {("titan", "/map"): b"grid" * 1000, ("titan", "/slow"): b"new"}
    assert ended(ether).messages == 1


def test_silence_times_out(ether):
    ether.silent.add("titan")
    begin_s = ether.time_s
    ether.pull("io", "titan")
    (broken,) = ether.told("io", SyncTimedOut)
    assert broken.reason == "no connection within 5 s"
    assert 5 < ether.time_s - begin_s < 5.6


# --- gaps


def test_a_short_gap_over_datagrams_ends_nothing(ether):
    ether.publish("titan", "/slow", noise(2_000_000))
    ether.nodes["io"].sync("titan", ether.now)
    until_some_came(ether)
    ether.silent.add("titan")
    ether.wait(3)
    ether.silent.clear()
    ether.settle()
    assert not ether.told("io", SyncTimedOut)
    assert not ether.told("titan", SyncTimedOut)
    assert ended(ether).messages == 2
    assert ether.held("io") == ether.held("titan")


def test_a_new_contact_ends_a_short_gap_at_once(ether):
    """The radio hears the peer again: do not wait for timers that have grown meanwhile."""

    def back_after(on_contact: bool) -> float:
        ether = Ether(ether_team, datagrams=True, delay_s=FAR_S)
        ether.publish("titan", "/slow", noise(2_000_000))
        io = ether.nodes["io"]
        io.heard("titan", -60, ether.now)
        until_some_came(ether)
        ether.silent.add("titan")
        io.heard("titan", None, ether.now)
        ether.wait(3.9)
        before = io.links(ether.now)["titan"].bytes_in
        ether.silent.clear()
        begin_s = ether.time_s
        if on_contact:
            io.heard("titan", -60, ether.now)
            ether.nodes["titan"].heard("io", -60, ether.now)
        while io.links(ether.now)["titan"].bytes_in == before:
            ether.wait(0.01)
        assert not ether.told("io", SyncTimedOut)
        return ether.time_s - begin_s

    ether_team = ether.team
    assert back_after(on_contact=True) < 2 * FAR_S + 0.03
    assert back_after(on_contact=False) < 1.1


def test_a_long_gap_keeps_every_chunk(ether):
    """It ends the pull; the next one goes on where it was."""
    ether.publish("titan", "/slow", noise(2_000_000))
    ether.nodes["io"].sync("titan", ether.now)
    until_some_came(ether)
    ether.silent.add("titan")
    ether.wait(20)
    assert len(ether.told("io", SyncTimedOut)) == len(ether.told("titan", SyncTimedOut)) == 1
    ether.silent.clear()
    ether.pull("io", "titan")
    assert ether.held("io") == ether.held("titan")
    total = ether.nodes["io"].links(ether.now)["titan"].bytes_in
    assert total < 2_000_000 * 1.12  # what came before the gap did not come again


def test_a_long_gap_over_a_connection_keeps_every_chunk(team):
    ether = Ether(team, delay_s=FAR_S)
    ether.publish("titan", "/slow", noise(2_000_000))
    ether.nodes["io"].sync("titan", ether.now)
    until_some_came(ether)
    ether.silent.add("titan")
    ether.wait(20)
    assert len(ether.told("io", SyncTimedOut)) == 1
    ether.silent.clear()
    ether.pull("io", "titan")
    assert ether.held("io") == ether.held("titan")
    assert ether.nodes["io"].links(ether.now)["titan"].bytes_in < 2_000_000 * 1.12 + 70_000


def test_a_stalled_connection_is_dialled_anew_when_a_contact_begins(team):
    """TCP sleeps in its back-off; a fresh connection gets through at once."""
    ether = Ether(team, delay_s=FAR_S)
    ether.publish("titan", "/slow", noise(2_000_000))
    io = ether.nodes["io"]
    io.heard("titan", -60, ether.now)
    until_some_came(ether)
    ether.silent.add("titan")
    ether.wait(1.5)
    io.heard("titan", None, ether.now)
    ether.silent.clear()
    io.heard("titan", -60, ether.now)
    actions, events = io.take()
    assert sum(isinstance(action, Connect) for action in actions) == 1
    assert [e.reason for e in events if isinstance(e, SyncTimedOut)] == [
        "stalled, and a new contact began"
    ]


@pytest.mark.parametrize("seed", range(6))
def test_the_end_is_lost(team, seed):
    """Whatever of the last packets is lost, both sides come to know that all is over."""
    ether = Ether(team, datagrams=True, delay_s=FAR_S)
    ether.publish("titan", "/map", b"grid")
    chance = random.Random(seed)

    def mostly(piece: Carried) -> bool:
        over = not ether.nodes["io"]._pulls
        return not (over and piece.path == "udp" and chance.random() < 0.6)

    ether.lets_by = mostly
    ether.pull("io", "titan")
    ether.wait(20)
    assert ether.held("io") == ether.held("titan")
    assert ended(ether).complete
    told = [type(e) for e in ether.events["titan"] if getattr(e, "direction", None) is OUT]
    assert told == [SyncStarted, SyncEnded]
    assert not ether.told("io", SyncTimedOut)


@pytest.mark.parametrize("loss", [0.02, 0.2])
def test_where_datagrams_are_lost_everything_arrives(team, loss):
    ether = Ether(team, datagrams=True, delay_s=0.02)
    ether.blocked = blocked(("zmq", "io", "titan"))
    ether.publish("titan", "/map", noise(60_000))
    ether.publish("titan", "/slow", noise(100))
    chance = random.Random(3)
    ether.lets_by = lambda _: chance.random() >= loss
    ether.pull("io", "titan")
    assert ether.held("io") == ether.held("titan")
    assert ended(ether).complete
    assert ether.nodes["io"].links(ether.now)["titan"].refused == 0


# --- budget


def budgeted(team: Team, budget_bytes: int, **options: object) -> Ether:
    trigger = replace(team.trigger, budget_bytes=budget_bytes)
    return Ether(replace(team, trigger=trigger), names=("io", "titan"), delay_s=FAR_S, **options)


@pytest.mark.parametrize("datagrams", [True, False])
def test_a_new_peer_keeps_to_the_budget(datagrams):
    ether = budgeted(WIDE, 20_000, datagrams=datagrams)
    for number in range(40):
        ether.publish("titan", f"/t{number}", noise(2_000, number))
    ether.pull("io", "titan")
    assert not ended(ether).complete
    assert ended(ether).messages in (8, 9)
    assert ether.nodes["io"].links(ether.now)["titan"].bytes_in < 21_000 + 1_500
    assert ether.told("titan", SyncEnded)[-1].complete is False


def test_an_original_peer_is_asked_for_no_more_than_the_budget():
    ether = budgeted(WIDE, 20_000)
    old = OldNode(ether, "titan")
    for number in range(40):
        old.publish(f"/t{number}", noise(2_000, number))
    ether.pull("io", "titan")
    assert not ended(ether).complete
    assert 9 <= ended(ether).messages <= 11
    assert not ether.nodes["io"].sync("titan", ether.now)


def test_the_next_contact_has_a_budget_of_its_own():
    """In the same contact no more; in the next ones the rest, nothing of it twice."""
    ether = budgeted(WIDE, 20_000, datagrams=True)
    for number in range(40):
        ether.publish("titan", f"/t{number}", noise(2_000, number))
    io = ether.nodes["io"]
    for contact in range(1, 7):
        io.heard("titan", -60, ether.now)
        ether.settle()
        held = len(ether.held("io"))
        assert held >= min(40, 8 * contact)
        ether.wait(3)
        io.heard("titan", -60, ether.now)
        ether.settle()
        assert len(ether.held("io")) <= held + 1
        io.heard("titan", None, ether.now)
        if held == 40:
            break
    assert ether.held("io") == ether.held("titan")
    assert len(ether.told("io", MessageStored)) == 40
    assert io.links(ether.now)["titan"].bytes_in < 40 * 2_100 + 10_000


def test_with_hardly_any_budget_left_no_pull_begins(team):
    ether = budgeted(team, 10_000, datagrams=False)
    ether.publish("titan", "/map", noise(10_000 - LEAST_BUDGET))
    ether.pull("io", "titan")
    assert not ether.nodes["io"].sync("titan", ether.now)


# --- what everything else shares


def test_an_urgent_message_overtakes(team):
    """A goal that is published while a map is under way comes before the rest of the map."""
    for datagrams in (True, False):
        ether = Ether(team, datagrams=datagrams, delay_s=FAR_S)
        ether.publish("titan", "/slow", noise(3_000_000))
        ether.nodes["io"].sync("titan", ether.now)
        until_some_came(ether)
        ether.publish("titan", "/map", b"urgent")
        ether.settle()
        stored = [event.topic for event in ether.told("io", MessageStored)]
        assert stored == ["/map", "/slow"]


def test_pulls_from_several_peers_at_once(team):
    ether = Ether(team, datagrams=True, delay_s=FAR_S)
    ether.publish("titan", "/map", noise(100_000))
    ether.publish("callisto", "/pose", b"here")
    ether.pull("callisto", "titan")
    io = ether.nodes["io"]
    for peer in ("callisto", "titan"):
        io.sync(peer, ether.now)
    ether.settle()
    assert ether.held("io") == {
        ("titan", "/map"): noise(100_000),
        ("callisto", "/pose"): b"here",
    }
    assert len(ether.told("io", SyncEnded)) == 2
    assert len(ether.told("io", MessageStored)) == 2
