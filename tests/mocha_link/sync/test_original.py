"""Beside original nodes: every fault that such a peer can cause, when we pull and when it pulls.

The peer is the stand-in of `original.py` on real sockets; docs/protocol.md has what live,
unmodified original nodes did in the same situations.
"""

import contextlib
import json
import math
import random

import lz4.frame
import pytest

from mocha_link.links.metrics import Direction, LinkState, SyncEnded, SyncTimedOut
from mocha_link.store.wire import WRAP_S
from mocha_link.team.team import Team
from tests.mocha_link import original
from tests.mocha_link.conftest import DATA
from tests.mocha_link.original import JUNK, SILENT, Original

IN, OUT = Direction.IN, Direction.OUT
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


@pytest.fixture(params=[False, True], ids=["found out", "set in the team"])
def mixed(request, field):
    """That io runs the original node is set in the team file, or has to be found out."""
    if request.param:
        field.team = field.team.with_robots({"io": {"original": True}})
    return field


def body_of(field, robot, topic, data, **changes) -> bytes:
    known = field.team.topic(robot, topic)
    dtype, priority = changes.get("dtype", known.dtype), changes.get("priority", known.priority)
    return bytes([dtype, priority]) + lz4.frame.compress(data)


def lists(old_peer, node) -> list[bytes]:
    """What a node offers to an original one."""
    return original.split(old_peer.reply_of(node.name, b"GHEAD"))


def test_the_stand_in_answers_as_recorded():
    team = Team.load(DATA / "team.yaml")
    frames = [
        bytes.fromhex(frame["hex"])
        for frame in json.loads((DATA / "exchange.json").read_text())
        if frame["conn"] in range(1, 5)
    ]
    titan = Original(team, "titan", now_s=lambda: 0.0)
    for request, reply in zip(frames[::2], frames[1::2], strict=True):
        if request[6:11] == b"GDATA":
            titan.put(request[11:], reply[6:])
    for request, reply in zip(frames[::2], frames[1::2], strict=True):
        assert titan.answer("io", [request]) == reply
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
    assert saw.pull("io").messages == 2
    assert titan.latest("io", "/pose").data == SMALL
    assert titan.latest("io", "/cloud").data == LARGE
    assert io.pull("titan").ended
    assert io.data("titan", "/map") == LARGE
    assert saw.wait(SyncEnded, peer="io", direction=OUT).messages == 1
    assert saw.pull("io").messages == 0
    assert io.pull("titan") == original.Pull(offered=lists(io, titan), ended=True)
    assert titan.links()["io"].refused == 0
    assert not io.dead


def test_a_relay_across_an_original_node(mixed, old):
    """Two of ours meet only io, which is original; what stands behind the LZ4 frame stays on."""
    io = old("io")
    titan, _, saw = mixed.node("titan")
    callisto, _, callisto_saw = mixed.node("callisto")
    sent = titan.publish("/map", LARGE).pack()
    body = io.reply_of("titan", b"GDATA" + sent)
    assert io.pull("titan").stored == [sent]
    assert io.body(sent) == body
    assert callisto_saw.pull("io").messages == 1
    assert callisto.latest("titan", "/map").data == LARGE
    assert callisto.latest("titan", "/map").header.pack() == sent
    callisto.publish("/pose", SMALL)
    assert io.pull("callisto").ended
    saw.pull("io")
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
        assert saw.pull("io").messages == messages
    assert titan.latest("callisto", "/pose") is None
    assert lists(callisto, titan) == [sent]
    # The true one is still welcome: a junk header is nothing that we have.
    callisto.put(junk, body_of(mixed, "callisto", "/pose", b"true"))
    assert saw.pull("callisto").messages == 1
    assert titan.latest("callisto", "/pose").data == b"true"


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
    assert saw.pull("io").messages == 2
    assert titan.links()["io"].refused >= 5
    # The priority of a topic is that of the team file, not that of a peer's message.
    assert lists(callisto, titan) == [sent, urgent]
    assert titan.latest("callisto", "/path").priority.name == "MEDIUM"
    # 1000 ms and more are read as seconds by original nodes; here they are no header.
    io.put(bytes([0, 2]) + (500).to_bytes(2) + (65535).to_bytes(2), b"\1\0" + SMALL)
    assert saw.pull("io").messages == 0


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
    assert saw.pull("io").messages == 0
    assert titan.links()["io"].refused == 2
    ours = titan.publish("/map", SMALL).pack()  # and we make none
    assert callisto.pull("titan").stored == [ours]
    assert lists(callisto, titan) == [ours]
    assert callisto.header_list() == [ours]
    assert not callisto.stopped
    io.override = None
    field.clock.time_s = wrap_s + 3
    io.publish("/path", LARGE)
    saw.pull("io")
    assert titan.latest("io", "/path").data == LARGE


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
        assert saw.pull("callisto").messages == 1  # meanwhile
        broken = saw.wait(SyncTimedOut, peer="io", direction=IN)
    assert mute.decode() in broken.reason
    assert (titan.latest("io", "/pose") is None) == (mute != b"DENDT")
    io = old("io")  # restarted
    io.publish("/pose", sent)
    saw.pull("io")
    assert titan.latest("io", "/pose").data == sent
    assert titan.links()["io"].state_in is LinkState.ENDED


def test_a_message_that_is_too_slow_for_an_original_node_starves_nothing_else(field, old):
    io = old("io")
    titan, _, _ = field.node("titan")
    large = titan.publish("/map", LARGE).pack()  # high priority: first in the list
    small = titan.publish("/slow", SMALL).pack()
    assert lists(io, titan) == [large, small]
    assert io.pull("titan", give_up_after=0).requested == [large]
    done = io.pull("titan", give_up_after=1)
    assert done.requested == [small, large]
    assert io.data("titan", "/slow") == SMALL
    newer = titan.publish("/map", LARGE[1:]).pack()  # its topic stays behind until it gets through
    assert lists(io, titan) == [small, newer]
    assert io.pull("titan").ended
    assert io.data("titan", "/map") == LARGE[1:]
    assert lists(io, titan) == [newer, small]
