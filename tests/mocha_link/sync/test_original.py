"""Beside original nodes: every fault that such a peer can cause, asked by us and asking us.

The peer is the stand-in of `original.py` on real sockets; docs/compatibility.md says how live,
unmodified original nodes did in the same situations.
"""

from __future__ import annotations

import contextlib
import json
import math
import random
from pathlib import Path

import lz4.frame
import pytest
import zmq

from mocha_link.links.metrics import Direction, LinkState, SyncEnded, SyncTimedOut
from mocha_link.store.record import WRAP_S, Header
from mocha_link.team.team import Team
from tests.mocha_link import original
from tests.mocha_link.original import JUNK, SILENT, Original

IN, OUT = Direction.IN, Direction.OUT
DATA = Path(__file__).parents[2] / "data" / "mocha"
SMALL, LARGE = b"a pose", random.Random(7).randbytes(300_000)


@pytest.fixture
def old(field):
    """Starts original nodes of the field's team; they end with the test."""
    with contextlib.ExitStack() as stack:

        def start(name: str, **options: object) -> Original:
            return stack.enter_context(
                Original(field.team, name, **{"now_s": field.clock.now_s, **options})
            )

        yield start


@pytest.fixture(params=[False, True], ids=["found out", "said in the team"])
def mixed(request, field):
    """That io runs the original node is said in the team file, or has to be found out."""
    if request.param:
        field.team = field.team.with_robots({"io": {"original": True}})
    return field


def pull(node, saw, peer) -> SyncEnded:
    """Pull from a peer, to the end."""
    node.sync(peer)
    return saw.wait(SyncEnded, peer=peer, direction=IN)


def body_of(field, robot, topic, data, **changes) -> bytes:
    known = field.team.topic(robot, topic)
    dtype, priority = changes.get("dtype", known.dtype), changes.get("priority", known.priority)
    return bytes([dtype, priority]) + lz4.frame.compress(data)


def lists(old_peer, node) -> list[bytes]:
    """What a node offers to an original one."""
    return original.split(old_peer.ask(node.name, b"GHEAD"))


def test_the_stand_in_answers_as_recorded():
    team = Team.load(DATA / "team.yaml")
    frames = [
        bytes.fromhex(frame["hex"])
        for frame in json.loads((DATA / "exchange.json").read_text())
        if frame["conn"] in range(1, 5)
    ]
    titan = Original(team, "titan", now_s=lambda: 0.0)
    for asked, reply in zip(frames[::2], frames[1::2], strict=True):
        if asked[6:11] == b"GDATA":
            titan.put(asked[11:], reply[6:])
    for asked, reply in zip(frames[::2], frames[1::2], strict=True):
        assert titan.answer("io", [asked]) == reply
    assert titan.answer("io", [b"idididSYNC1\xff\x80"]) == b"ididid" + JUNK
    for parts in ([b"idididGDAT\xff"], [b"idididDENDT\xff"], [b"idididGHEAD", b""]):
        titan.dead.clear()
        assert titan.answer("io", parts) is None
        assert titan.dead == {"io"}


def test_both_ways(mixed, old):
    io = old("io")
    titan, _, saw = mixed.node("titan")
    io.publish("/pose", SMALL)
    mixed.clock.time_s += 1
    io.publish("/cloud", LARGE)
    titan.publish("/map", LARGE)
    assert pull(titan, saw, "io").messages == 2
    assert titan.latest("io", "/pose").data == SMALL
    assert titan.latest("io", "/cloud").data == LARGE
    assert io.pull("titan").ended
    assert io.data("titan", "/map") == LARGE
    assert saw.wait(SyncEnded, peer="io", direction=OUT).messages == 1
    assert pull(titan, saw, "io").messages == 0
    assert io.pull("titan") == original.Pull(offered=lists(io, titan), ended=True)
    assert titan.links()["io"].refused == 0
    assert not io.dead


def test_a_relay_across_our_node(mixed, old):
    """io and callisto, both original, meet only titan, which is ours."""
    io, callisto = old("io"), old("callisto")
    titan, _, saw = mixed.node("titan")
    sent = io.publish("/cloud", LARGE)
    pull(titan, saw, "io")
    assert callisto.pull("titan").stored == [sent]
    assert callisto.body(sent) == io.body(sent)  # as it came, byte for byte
    sent = callisto.publish("/pose", SMALL)
    pull(titan, saw, "callisto")
    assert io.pull("titan").stored == [sent]
    assert io.data("callisto", "/pose") == SMALL


def test_a_relay_across_an_original_node(mixed, old):
    """Two of ours meet only io, which is original; what stands behind the LZ4 frame stays on."""
    io = old("io")
    titan, _, saw = mixed.node("titan")
    callisto, _, callisto_saw = mixed.node("callisto")
    sent = titan.publish("/map", LARGE).pack()
    body = io.ask("titan", b"GDATA" + sent)
    assert io.pull("titan").stored == [sent]
    assert io.body(sent) == body
    assert pull(callisto, callisto_saw, "io").messages == 1
    assert callisto.latest("titan", "/map").data == LARGE
    assert callisto.latest("titan", "/map").header.pack() == sent
    callisto.publish("/pose", SMALL)
    assert io.pull("callisto").ended
    pull(titan, saw, "io")
    assert titan.latest("callisto", "/pose").data == SMALL


def test_an_error_reply_that_became_a_message(mixed, old):
    """An infected node offers it with every list. We neither keep it nor hand it on."""
    io, callisto = old("io"), old("callisto")
    titan, _, saw = mixed.node("titan")
    now_s = mixed.clock.now_s()
    junk = original.header(0, 0, now_s - 5)
    io.put(junk, JUNK)
    sent = io.publish("/pose", SMALL)
    for messages in (1, 0, 0):
        assert pull(titan, saw, "io").messages == messages
    assert titan.latest("callisto", "/pose") is None
    assert lists(callisto, titan) == [sent]
    # The true one is still welcome: a junk header is nothing that we have.
    callisto.put(junk, body_of(mixed, "callisto", "/pose", b"true"))
    assert pull(titan, saw, "callisto").messages == 1
    assert titan.latest("callisto", "/pose").data == b"true"


def test_an_original_node_never_gets_an_error_for_what_it_was_offered(field, old):
    """It would store it. So what we replace meanwhile stays until it has asked for a new list."""
    io = old("io")
    titan, _, _ = field.node("titan")
    first = titan.publish("/map", LARGE).pack()
    assert lists(io, titan) == [first]
    for number in range(20):
        field.clock.time_s += 0.1
        newest = titan.publish("/map", b"%d" % number).pack()
    body = io.ask("titan", b"GDATA" + first)
    assert bytes(lz4.frame.decompress(body[2:])) == LARGE
    assert lists(io, titan) == [newest]


def test_a_list_that_is_no_list(mixed, old):
    io = old("io", override=lambda code, _: bytes(7) if code == b"GHEAD" else None)
    titan, _, saw = mixed.node("titan")
    io.publish("/pose", SMALL)
    titan.sync("io")
    broken = saw.wait(SyncTimedOut, peer="io", direction=IN)
    assert "headers" in broken.reason
    io.override = None  # and nothing is busy for ever
    assert pull(titan, saw, "io").messages == 1
    assert titan.links()["io"].refused == 1


@pytest.mark.parametrize("body", [b"", b"\3\3no LZ4", JUNK])
def test_a_body_that_is_none(mixed, old, body):
    """Empty data stop the original's channel; for us the message is not there."""
    io = old("io")
    titan, _, saw = mixed.node("titan")
    bad = io.publish("/cloud", SMALL)
    mixed.clock.time_s += 1
    io.publish("/path", SMALL)
    io.override = lambda code, raw: body if (code, raw) == (b"GDATA", bad) else None
    assert pull(titan, saw, "io").messages == 1
    assert titan.latest("io", "/cloud") is None
    assert titan.latest("io", "/path").data == SMALL
    io.override = None
    assert pull(titan, saw, "io").messages == 1


def test_ids_types_and_priorities_that_are_none_of_the_team(mixed, old):
    io, callisto = old("io"), old("callisto")
    titan, _, saw = mixed.node("titan")
    now_s = mixed.clock.now_s()
    for robot_id, topic_id in ((9, 0), (255, 255), (0, 77), (1, 3)):
        io.put(original.header(robot_id, topic_id, now_s), b"\xc8\xc8" + lz4.frame.compress(b"x"))
    io.put(original.header(0, 0, now_s), body_of(mixed, "callisto", "/pose", b"x", dtype=200))
    urgent = original.header(0, 1, now_s)
    io.put(urgent, body_of(mixed, "callisto", "/path", b"way", priority=200))
    sent = io.publish("/pose", SMALL)
    assert pull(titan, saw, "io").messages == 2
    assert titan.links()["io"].refused >= 5
    # The priority of a topic is what the team says, not what a peer says.
    assert lists(callisto, titan) == [sent, urgent]
    assert titan.latest("callisto", "/path").priority.name == "MEDIUM"
    # 1000 ms and more are read as seconds by original nodes; here they are no header.
    io.put(bytes([0, 2]) + (500).to_bytes(2) + (65535).to_bytes(2), b"\1\0" + SMALL)
    assert pull(titan, saw, "io").messages == 0


def test_the_second_that_stops_original_nodes(field, old):
    """A header with seconds = 0 locks the database of a node that stores it: it ends here."""
    wrap_s = math.ceil(field.clock.now_s() / WRAP_S) * WRAP_S
    field.clock.time_s = wrap_s + 0.5
    io, callisto = old("io"), old("callisto")
    titan, _, saw = field.node("titan")
    stops = io.publish("/path", SMALL)
    assert original.wire_s(stops) == 0.5
    relayed = original.header(0, 0, wrap_s + 1.0)
    io.override = lambda code, _: stops + relayed if code == b"GHEAD" else None
    assert pull(titan, saw, "io").messages == 0
    assert titan.links()["io"].refused == 2
    ours = titan.publish("/map", SMALL).pack()  # and we make none
    assert callisto.pull("titan").stored == [ours]
    assert lists(callisto, titan) == [ours]
    assert callisto.header_list() == [ours]
    assert not callisto.stopped
    io.override = None
    field.clock.time_s = wrap_s + 3
    io.publish("/path", LARGE)
    pull(titan, saw, "io")
    assert titan.latest("io", "/path").data == LARGE


def test_an_original_node_whose_database_is_locked(mixed, old):
    """Mute, whatever is asked; the others are served."""
    io, callisto = old("io"), old("callisto")
    io.put(bytes([1, 0, 0, 0, 0, 0]), body_of(mixed, "io", "/pose", SMALL))
    io.header_list()
    assert io.stopped
    titan, _, saw = mixed.node("titan", timeout_s=1)
    callisto.publish("/pose", SMALL)
    titan.sync("io")
    assert pull(titan, saw, "callisto").messages == 1
    saw.wait(SyncTimedOut, peer="io", direction=IN)


@pytest.mark.parametrize("mute", [b"GDATA", b"DENDT"])
def test_a_peer_that_falls_silent(field, old, mute):
    field.team = field.team.with_robots({"io": {"original": True}})
    callisto = old("callisto")
    titan, _, saw = field.node("titan", timeout_s=1)
    callisto.publish("/pose", SMALL)
    sent = SMALL
    with Original(
        field.team,
        "io",
        now_s=field.clock.now_s,
        override=lambda code, _: SILENT if code == mute else None,
    ) as io:
        io.publish("/pose", sent)
        titan.sync("io")
        assert pull(titan, saw, "callisto").messages == 1  # meanwhile
        broken = saw.wait(SyncTimedOut, peer="io", direction=IN)
    assert mute.decode() in broken.reason
    assert (titan.latest("io", "/pose") is None) == (mute != b"DENDT")
    io = old("io")  # restarted
    io.publish("/pose", sent)
    pull(titan, saw, "io")
    assert titan.latest("io", "/pose").data == sent
    assert titan.links()["io"].state_in is LinkState.ENDED


def test_an_original_node_that_gives_up_on_a_slow_answer(field, old):
    """After 6 s without the whole answer it lets go, and begins anew at the next trigger."""
    io = old("io")
    titan, _, saw = field.node("titan")
    titan.publish("/slow", SMALL)
    titan.publish("/map", LARGE)
    assert not io.pull("titan", give_up_after=1).ended
    assert io.data("titan", "/map") == LARGE
    done = io.pull("titan")
    assert done.ended
    assert len(done.asked) == 1  # what it had is kept
    broken = saw.wait(SyncTimedOut, peer="io", direction=OUT)
    assert broken.reason == "the peer began anew"
    saw.wait(SyncEnded, peer="io", direction=OUT)


def test_a_message_that_is_too_slow_for_an_original_node_starves_nothing_else(field, old):
    io = old("io")
    titan, _, _ = field.node("titan")
    large = titan.publish("/map", LARGE).pack()  # high priority: first in the list
    small = titan.publish("/slow", SMALL).pack()
    assert lists(io, titan) == [large, small]
    assert io.pull("titan", give_up_after=0).asked == [large]
    done = io.pull("titan", give_up_after=1)
    assert done.asked == [small, large]
    assert io.data("titan", "/slow") == SMALL
    newer = titan.publish("/map", LARGE[1:]).pack()  # its topic stays behind until it gets through
    assert lists(io, titan) == [small, newer]
    assert io.pull("titan").ended
    assert io.data("titan", "/map") == LARGE[1:]
    assert lists(io, titan) == [newer, small]


def test_seconds_wrap(field, old):
    """We take what is new after the wrap; an original node does not, which is its own limit."""
    wrap_s = math.ceil(field.clock.now_s() / WRAP_S) * WRAP_S
    field.clock.time_s = wrap_s - 5
    io, callisto = old("io"), old("callisto")
    titan, _, saw = field.node("titan")
    io.publish("/pose", b"before")
    titan.publish("/map", b"before")
    pull(titan, saw, "io")
    for each in (io, callisto):
        assert each.pull("titan").ended
    field.clock.time_s = wrap_s + 10
    io.publish("/pose", b"after")
    io.publish("/path", b"first")
    after = titan.publish("/map", b"after").pack()
    titan.publish("/slow", b"first")
    assert pull(titan, saw, "io").messages == 2
    assert titan.latest("io", "/pose").data == b"after"
    assert titan.latest("io", "/pose").stamp_s == wrap_s + 10
    assert callisto.pull("titan").ended
    assert callisto.data("titan", "/map") == callisto.data("io", "/pose") == b"before"
    assert callisto.data("titan", "/slow") == callisto.data("io", "/path") == b"first"
    callisto.messages.clear()  # its restart, or 18.2 h, end it
    assert after in callisto.pull("titan").stored
    assert callisto.data("titan", "/map") == callisto.data("io", "/pose") == b"after"


def test_clocks_that_are_set_back(field, old):
    io = old("io")
    titan, _, saw = field.node("titan")
    io.publish("/pose", b"before")
    first = titan.publish("/map", b"before")
    pull(titan, saw, "io")
    assert io.pull("titan").ended
    field.clock.time_s -= 3600
    io.publish("/pose", b"after")  # which it does not offer before its clock has caught up
    io.publish("/path", b"a first one")
    second = titan.publish("/map", b"after")
    assert pull(titan, saw, "io").messages == 1
    assert titan.latest("io", "/pose").data == b"before"
    assert titan.latest("io", "/path").data == b"a first one"
    # Ours goes on from its last stamp, so an original node takes it.
    assert io.pull("titan").ended
    assert io.data("titan", "/map") == b"after"
    assert second == Header.at(2, 0, round(first.stamp_s(field.clock.now_s()) * 1000) + 1)
    field.clock.time_s += 3601
    io.publish("/pose", b"caught up")
    assert pull(titan, saw, "io").messages == 1
    assert titan.latest("io", "/pose").data == b"caught up"


def test_two_messages_in_one_millisecond(field, old):
    io = old("io")
    titan, _, saw = field.node("titan")
    assert io.publish("/pose", b"one") == io.publish("/pose", b"two")
    pull(titan, saw, "io")
    assert titan.latest("io", "/pose").data == b"two"
    io.publish("/pose", b"three")  # overwritten over there; no node that has "two" can know of it
    assert pull(titan, saw, "io").messages == 0
    stamps = [titan.publish("/map", b"%d" % number).pack() for number in range(5)]
    assert len(set(stamps)) == 5
    assert io.pull("titan").stored == [stamps[-1]]
    assert io.data("titan", "/map") == b"4"


def test_thousands_of_messages_in_one_topic(field, old):
    io = old("io")
    titan, _, saw = field.node("titan")
    start_s = field.clock.now_s() - 100
    body = body_of(field, "io", "/pose", SMALL)
    for number in range(9_000):
        io.put(original.header(1, 0, start_s + number / 1000), body)
    assert pull(titan, saw, "io").messages == 1
    for _ in range(2000):
        last = titan.publish("/map", SMALL).pack()
    assert [message.topic for message in titan.messages() if message.robot == "titan"] == ["/map"]
    assert io.pull("titan").stored == [last]
    # The same header over and over, and a hundred versions of one topic: one is fetched.
    many = [original.header(1, 1, start_s + second) for second in range(100)]
    for raw in many:
        io.put(raw, body_of(field, "io", "/path", raw))
    io.override = lambda code, _: b"".join(many) * 300 if code == b"GHEAD" else None
    io.requests.clear()
    assert pull(titan, saw, "io").messages == 1
    assert [asked for asked in io.requests if asked.startswith(b"GDATA")] == [b"GDATA" + many[-1]]


def test_an_original_node_that_restarts_gets_its_own_back(field, old):
    io = old("io")
    titan, _, saw = field.node("titan")
    sent = io.publish("/pose", b"before")
    pull(titan, saw, "io")
    io.messages.clear()
    assert io.pull("titan").stored == [sent]
    field.clock.time_s += 1
    io.publish("/pose", b"after")
    assert pull(titan, saw, "io").messages == 1
    assert titan.latest("io", "/pose").data == b"after"


def test_nothing_that_we_ask_kills_an_original_node(mixed, old):
    """Its thread dies of a code that is not UTF-8 and of a second part; it has neither from us."""
    io = old("io")
    titan, _, saw = mixed.node("titan")
    for number in range(10):
        titan.publish("/map", b"%d" % number)
        mixed.clock.time_s += 1
        io.publish("/pose", random.Random(number).randbytes(200))
        pull(titan, saw, "io")
        assert io.pull("titan").ended
    assert io.requests
    assert not io.dead
    for request in io.requests:
        request[:5].decode("ascii")


def test_what_kills_an_original_node_costs_an_error_reply(field):
    titan, _, _ = field.node("titan")
    port = titan.robot.port_for("io")
    with zmq.Context() as context:
        for parts in (
            [b"idididGDAT\xff"],
            [b"ididid\x80\x81\x82\x83\x84"],
            [b"idididGHEAD", b"second part"],
            [b"idididGHEAD", b""],
            [b""],
            [b"idid"],
        ):
            with context.socket(zmq.REQ) as client:
                client.linger = 0
                client.connect(f"tcp://{field.host}:{port}")
                client.send_multipart(parts)
                assert client.poll(20_000)
                assert client.recv() == parts[0][:6] + JUNK
        with context.socket(zmq.REQ) as client:
            client.connect(f"tcp://{field.host}:{port}")
            client.send(b"idididDENDT\xff\xfe")
            assert client.poll(20_000)
            assert client.recv() == b"idididAck"
