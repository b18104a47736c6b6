"""12,000 bad frames against live nodes, in both roles and on every way in; to explore, 94,000.

Frames are those of real exchanges with something wrong in them (`fuzz.py`). After some hundred a
friend must still be served, and serve; the log must be free of errors, and the memory must not
grow. Bytes that are no frames: tests/mocha_link/node, test_zmtp and test_router.
"""

import contextlib
import logging
import socket
from collections.abc import Iterator

import pytest
import zmq

from benchmarks.fleet.network_sim import team_of
from mocha_link.store.wire import Header, as_ms
from mocha_link.sync.frames import HELLO
from mocha_link.sync.protocol import CODE_BYTES, GHEAD, ID_BYTES, SERRM, SYNC1
from tests.mocha_link.conftest import TEAM
from tests.mocha_link.fuzz import EXPLORE, Fuzzer, Recorder, record
from tests.mocha_link.load import (
    HANDSHAKE_OF_ROUTER,
    Liar,
    NodeUnderLoad,
    message,
    requests,
    send,
)

pytestmark = pytest.mark.long

SHARE = 8 if EXPLORE else 1
CHECK_EVERY = 500
BATCH = 50  # frames after which the node has to have dealt with all of them


@pytest.fixture
def loaded(field, monkeypatch, caplog) -> Iterator[NodeUnderLoad]:
    with contextlib.ExitStack() as stack:
        loaded = NodeUnderLoad(field, monkeypatch)
        for node in loaded.nodes.values():
            stack.enter_context(node)
        loaded.check()
        yield loaded
        loaded.check()
    assert [each for each in caplog.records if each.levelno >= logging.ERROR] == []


@pytest.fixture(scope="module")
def recorded() -> Recorder:
    """Topics with a history: so much to compare that digests are worth it."""
    text = TEAM.replace("priority: medium}", "priority: medium, history: 200}")
    text = text.replace("priority: none}", "priority: none, history: 200}")
    team = team_of(text)
    return record(team, "io", "titan")


def test_bad_requests(loaded, recorded):
    """On the ROUTER: syncs that begin well, and what must not follow."""
    fuzzer = Fuzzer(recorded, 1)
    with zmq.Context() as context:
        while loaded.frames < 2_500 * SHARE:
            with context.socket(zmq.DEALER) as dealer:
                dealer.linger = 0
                dealer.connect("tcp://{}:{}".format(*loaded.place))
                for _ in range(CHECK_EVERY // BATCH):
                    request_id = fuzzer.random.randbytes(ID_BYTES)
                    frames = [fuzzer.opening(request_id)]
                    frames += [fuzzer.request(request_id) for _ in range(BATCH - 1)]
                    for frame in frames:
                        parts = [frame] if fuzzer.random.random() < 0.98 else [frame, frame[:9]]
                        dealer.send_multipart([b"", *parts])
                    loaded.wait(BATCH)
                    while dealer.poll(0):
                        dealer.recv_multipart()
            loaded.check()


def test_bad_datagrams(loaded, recorded):
    """On the port's datagram socket, from the address that is io's."""
    fuzzer = Fuzzer(recorded, 2)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as caster:
        caster.bind((loaded.field.host, 0))
        caster.setblocking(False)
        while loaded.frames < 4_500 * SHARE:
            for _ in range(CHECK_EVERY // BATCH):
                token = fuzzer.random.randbytes(ID_BYTES)
                packets = [fuzzer.opening_packet(token)]
                packets += [fuzzer.packet("up", token) for _ in range(BATCH - 1)]
                for packet in packets:
                    caster.sendto(packet, loaded.place)
                loaded.wait(BATCH)
                with contextlib.suppress(BlockingIOError):
                    while True:
                        caster.recv(2000)
            loaded.check()


def test_bad_answers_of_a_new_node(loaded, recorded):
    """A sync that begins well, and goes on with anything."""
    fuzzer = Fuzzer(recorded, 4)
    checked = 0
    with Liar(loaded) as liar:
        while loaded.frames < 1_875 * SHARE:
            with liar.pulled() as (connection, parser):
                send(connection, HANDSHAKE_OF_ROUTER)
                request_id = requests(connection, parser)[0][:ID_BYTES]
                answers = [fuzzer.good_reply(HELLO, request_id)]
                answers += [fuzzer.reply(request_id) for _ in range(20)]
                send(connection, b"".join(map(message, answers)))
            if loaded.frames - checked > CHECK_EVERY:
                checked = loaded.frames
                loaded.check()


def test_bad_answers_of_an_original_node(loaded, recorded):
    """It refuses the sync, offers new messages of all robots, and sends anything instead."""
    fuzzer = Fuzzer(recorded, 5)
    checked = 0
    with Liar(loaded) as liar:
        while loaded.frames < 1_000 * SHARE:
            with liar.pulled() as (connection, parser):
                send(connection, HANDSHAKE_OF_ROUTER)
                left = 60
                while left > 0 and (received := requests(connection, parser)):
                    for each in received:
                        request_id, code = each[:ID_BYTES], each[ID_BYTES:][:CODE_BYTES]
                        answer = fuzzer.reply(request_id)
                        if code == SYNC1:
                            answer = request_id + SERRM
                        elif code == GHEAD:
                            answer = request_id + some_list(fuzzer, loaded.field.clock.now_s())
                        send(connection, message(answer))
                        left -= 1
            if loaded.frames - checked > CHECK_EVERY:
                checked = loaded.frames
                loaded.check()


def some_list(fuzzer: Fuzzer, now_s: float) -> bytes:
    """Headers of nearly all that there may be, sometimes with something wrong in them."""
    rng = fuzzer.random
    keys = [(robot, topic) for robot in range(4) for topic in range(4)]
    headers = [
        Header.at(*key, as_ms(now_s) + rng.randint(-(10**6), 10**4)).pack()
        for key in rng.sample(keys, rng.randint(0, len(keys)))
    ]
    listed = b"".join(headers)
    return fuzzer.spoil(listed, listed) if rng.random() < 0.2 else listed


def test_bad_datagrams_in_answer(loaded, recorded):
    """titan believes that datagrams are the way to io."""
    fuzzer = Fuzzer(recorded, 7)
    peer = loaded.titan._gossip._links.by_peer["io"].peer
    with Liar(loaded) as liar:
        while loaded.frames < 1_875 * SHARE:
            for _ in range(CHECK_EVERY // BATCH):
                peer.path.measured(0.05)
                peer.path.datagrams_carried()
                with liar.pulled() as (connection, parser):
                    send(connection, HANDSHAKE_OF_ROUTER)
                    token = requests(connection, parser)[0][:ID_BYTES]
                    source = liar.called(token)
                    for _ in range(BATCH):
                        liar.caster.sendto(fuzzer.packet("down", token), source)
                    loaded.wait(1)  # they are taken in one after another before anything else
                    send(connection, message(b"no such id"))
            loaded.check()
