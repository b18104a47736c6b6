"""Several peers have the same message: one of them brings it, and what one makes wrong is its own.

A message that several relays announce, or have at first contact, is requested of one of them, and
of another one when that one goes silent, fails or takes long; nothing is lost by it.
"""

import random
from functools import partial

import pytest

from benchmarks.fleet.network_sim import NEAR_DBM, NetworkSim, team_of
from mocha_link.links.metrics import MessageStored
from mocha_link.store import wire
from mocha_link.store.reassembly_buffer import SLOW_S, STALL_S
from mocha_link.store.record import Record
from mocha_link.sync import holdings
from mocha_link.sync.frames import record_id
from tests.mocha_link.network import NOW, START_MS, Node, Pull, peer_of

SIZE = 1_000_000
WINDOW = 65_536  # what an unknown peer may send before it receives SKIP
FAR_S = 0.02
MAP = ("zed", "/map")


def relays_of(net):
    return [name for name in net.nodes if name.startswith("r")]


def field(count, **options):
    """Zed, and io out of its reach; between them so many relays, which do not see each other."""
    relays = [f"r{number}" for number in range(count)]
    rows = [
        f"  {name}: {{kind: rover, address: {name}, base_port: {base}, clients: [{clients}]}}\n"
        for name, base, clients in [
            *((relay, 100 + 2 * number, "io, zed") for number, relay in enumerate(relays)),
            ("io", 200, ", ".join(relays)),
            ("zed", 300, ", ".join(relays)),
        ]
    ]
    team = team_of(
        "robots:\n" + "".join(rows) + "kinds:\n"
        "  rover: {topics: [{name: /map, type: a/B}, {name: /pose, type: a/B}]}\n"
    )
    return NetworkSim(team, names=[*relays, "io", "zed"], delay_s=FAR_S, **options)


def noise(seed=1):
    return random.Random(seed).randbytes(SIZE)


def meet(net):
    """All relays have zed's map, and io comes within their reach."""
    net.publish(*MAP, noise())
    for relay in relays_of(net):
        net.pull(relay, "zed")
    net.carried.clear()
    for relay in relays_of(net):
        net.nodes["io"].signal_received(relay, NEAR_DBM, net.at("io"))


def crossed(net, *sources):
    """How many times the map has come to io."""
    sources = sources or relays_of(net)
    pieces = [piece for piece in net.carried if piece.target == "io" and piece.source in sources]
    return sum(len(piece.data) for piece in pieces) / SIZE


def until_it_came(net, seed=1, limit_s=12.0):
    began_s = net.time_s
    while net.held("io").get(MAP) != noise(seed):
        assert net.time_s < began_s + limit_s
        net.wait(0.02)
    return net.time_s - began_s


@pytest.mark.parametrize("datagrams", [False, True])
@pytest.mark.parametrize("count", [3, 6])
def test_of_those_that_announce_a_message_one_brings_it(count, datagrams):
    net = field(count, by_timer=True, datagrams=datagrams)
    net.wait(20)
    net.carried.clear()
    net.publish(*MAP, noise())
    until_it_came(net, limit_s=4)
    net.wait(5)
    assert crossed(net) < 1.1
    assert len(net.events_of("io", MessageStored)) == 1
    assert not any(link.peer.offers.left for link in net.links("io"))


@pytest.mark.parametrize("count", [3, 6])
def test_of_those_that_are_met_at_once_one_brings_it(count):
    """What the others have sent before they receive SKIP crosses in vain."""
    net = field(count)
    meet(net)
    until_it_came(net, limit_s=2)
    net.wait(5)
    assert crossed(net) < 1.1 + (count - 1) * WINDOW / SIZE


@pytest.mark.parametrize("closed", [True, False], ids=["lost", "silent"])
def test_where_the_one_that_brings_it_goes_another_one_goes_on(closed):
    net = field(3)
    meet(net)
    while net.nodes["io"].links(net.now)["r0"].bytes_in < SIZE / 2:
        net.wait(0.01)
    net.silent = {"r0"}
    if closed:  # so it is waited for no longer
        net.nodes["io"].lost("r0", "the peer closed the connection", net.at("io"))
    again_s = 0.0 if closed else STALL_S + 0.1
    for relay in relays_of(net):
        pull = partial(net.nodes["io"].sync, relay)
        net.later(lambda pull=pull: pull(net.at("io")), net.time_s + again_s)
    until_it_came(net, limit_s=again_s + STALL_S / 2)
    assert crossed(net, "r1", "r2") < 0.6 + 2 * WINDOW / SIZE


def test_what_was_left_to_a_peer_that_does_not_bring_it_is_requested_by_what_is_here():
    """The others take it for ours: OPEN lists all that is here instead of what is new."""
    net = field(2, by_timer=True)
    net.wait(20)
    net.lets_by = lambda piece: (
        (piece.source, piece.target) != ("r0", "io") or len(piece.data) < 999
    )
    net.publish(*MAP, noise())
    until_it_came(net)
    for number in range(5):
        net.publish("zed", "/pose", b"%d" % number)
        net.wait(4)
        assert net.held("io")["zed", "/pose"] == b"%d" % number


@pytest.mark.parametrize("listed", [512, 0], ids=["listed", "digests"])
def test_nothing_is_lost_of_what_was_left_to_a_peer_that_fails(monkeypatch, listed):
    """Nor if the pull that requests it does not get through."""
    monkeypatch.setattr(holdings, "MAX_LISTED", listed)
    monkeypatch.setattr(holdings, "SPARE_BYTES", 0)
    asker, one, other = Node("asker"), Node("one"), Node("other")
    for node in (asker, one, other):
        node.store(0, 16, START_MS)
    assert Pull(asker, other).run().receiver.complete
    asker.store(0, 32, START_MS)
    for node in (one, other):
        node.store(0, 0, START_MS, size=SIZE)
    begun(asker, one, 50)
    left = Pull(asker, other).run()
    assert left.data_down == 0
    assert not left.receiver.complete
    begun(asker, Node("other"), 0)  # it reaches no one
    pull = begun(asker, other, 0).run()
    assert pull.receiver.complete
    assert pull.data_down < 0.6 * SIZE
    assert other.content.items() <= asker.content.items()


@pytest.fixture
def good():
    good = Node("good")
    good.store(0, 0, START_MS, size=SIZE)
    return good


@pytest.fixture
def bad(good):
    """It has something else under the same name and of the same size."""
    bad, (record,) = Node("bad"), good.database.kept()
    body = wire.pack(0, 0, noise(), stamp_ms=START_MS)
    assert len(body) == len(record.body)
    assert bad.database.insert(Record(record.header, 0, body, START_MS, NOW.unix_s), NOW.unix_s)
    return bad


def begun(asker, server, frames):
    """A pull of which so many frames have come, after all others were long over."""
    Pull.steady_s += SLOW_S
    pull = Pull(asker, server)
    pull.deliver_up()
    for _ in range(frames):
        pull.give(10_000)
        pull.deliver()
        while pull.up:
            pull.deliver_up()
    return pull


def test_wrong_parts_do_not_spoil_what_another_peer_brings(good, bad):
    """Nor while they come on and on, whatever their sender receives."""
    asker = Node("asker")
    wrong = begun(asker, bad, 20)
    while wrong.give(10_000):
        pass
    pull = begun(asker, good, 0)
    while pull.up or pull.down or pull.give(10_000):
        if pull.up:
            pull.deliver_up()
        if pull.down:
            pull.deliver()
        if wrong.down:
            wrong.deliver(len(wrong.down) - 1)
    assert asker.content == good.content
    assert pull.receiver.complete
    assert pull.data_down < 1.05 * SIZE
    assert asker.reassembly.cost == 0


def test_wrong_parts_do_not_cost_those_that_have_come(good, bad):
    """A peer that ends a message wrongly: it is only the end that the next one brings again."""
    asker = Node("asker")
    begun(asker, good, 90)
    wrong = begun(asker, bad, 0)
    while not wrong.refusals:
        wrong.give(10_000)
        wrong.deliver()
    assert "damaged" in wrong.refusals[0]
    pull = begun(asker, good, 0).run(10_000)
    assert asker.content == good.content
    assert pull.data_down < 0.15 * SIZE


def test_what_one_peer_may_not_hand_on_another_one_may(good):
    """Its last part was the untrusted peer's: the others are still those of who may."""
    asker, other = Node("asker"), Node("other")
    (record,) = good.database.kept()
    other.database.insert(record, NOW.unix_s)

    def refuse(*_: object) -> None:
        raise wire.PayloadError("not from that one")

    begun(asker, good, 90)
    asker.peers["other"] = peer_of(
        asker.database, name="other", reassembly=asker.reassembly, verify=refuse
    )
    begun(asker, other, 0).run(10_000)
    assert asker.content == {}
    assert begun(asker, good, 0).run(10_000).data_down < 0.15 * SIZE
    assert asker.content == {record_id(record): record.body}
