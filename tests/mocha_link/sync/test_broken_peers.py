"""What a peer gets that breaks the rules: docs/protocol.md sums it up.

Here the peer is a new node. What an original one gets: test_original.py; its bodies, one by one:
test_payload.py; what is refused of them: test_sync_receiver.py; mutated frames: test_hostile.py.
"""

from __future__ import annotations

import contextlib
import logging
from typing import TYPE_CHECKING

import lz4.frame
import pytest

from mocha_link.store import payload
from mocha_link.store.config_hash import config_hash_of
from mocha_link.store.payload import STAMPS_MS
from mocha_link.sync.frames import DONE, HELLO, WHOLE, chunks_parts, message_frame, message_id_of
from mocha_link.sync.protocol import ID_BYTES
from mocha_link.sync.sync_messages import Done, Hello
from tests.mocha_link.load import (
    HANDSHAKE_OF_ROUTER,
    TIMEOUT_S,
    Liar,
    NodeUnderLoad,
    message,
    requests,
    say,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

IO, TITAN = 1, 2
POSE, MAP = 0, 0
T_MS = 1_795_175_900_000
MISSING = 2


@pytest.fixture
def loaded(field, monkeypatch, caplog) -> Iterator[NodeUnderLoad]:
    with contextlib.ExitStack() as stack:
        loaded = NodeUnderLoad(field, monkeypatch)
        for node in loaded.nodes.values():
            stack.enter_context(node)
        yield loaded
        loaded.check()
    assert [each for each in caplog.records if each.levelno >= logging.ERROR] == []


@contextlib.contextmanager
def io_says(
    loaded: NodeUnderLoad, *frames: bytes, name: bytes | None = None, patient: bool = False
) -> Iterator[Liar]:
    """It begins a sync as it should, says this, under another `name` perhaps, and goes."""
    hello = message_frame(
        HELLO, 0, Hello(config_hash=config_hash_of(loaded.field.team)).encode(), 0, 1000
    )
    with Liar(loaded) as liar, liar.asked() as (connection, parser):
        say(connection, HANDSHAKE_OF_ROUTER)
        request_id = requests(connection, parser)[0][:ID_BYTES]
        say(connection, message(request_id + hello))
        for frame in frames:
            say(connection, message((name or request_id) + frame))
        yield liar
        while requests(connection, parser) and patient:
            pass  # until titan hangs up


def whole(robot_id: int, topic_id: int, stamp_ms: int, body: bytes) -> bytes:
    long = message_id_of(robot_id, topic_id, stamp_ms)
    return b"".join(chunks_parts((0, 0), [WHOLE.pack(long, len(body))], [], [body]))


def done(frames: int = 1) -> bytes:
    return message_frame(DONE, 0, Done(7, 7, frames, cut_short=False).encode(), 0, 1000)


GOOD = payload.pack(3, 3, b"good")
SLY_BOMB = b"\3\3" + lz4.frame.compress(bytes(payload.MAX_BYTES + 1), store_size=False)
BROKEN = {
    "a sly bomb": (whole(IO, POSE, T_MS, SLY_BOMB), "unpacks to more than 67108864 bytes"),
    "an unknown robot": (whole(77, POSE, T_MS, GOOD), "no such robot or topic"),
    "the last time of all": (
        whole(TITAN, MAP, STAMPS_MS - 1, payload.pack(0, 3, b"what comes after?")),
        "impossible time",
    ),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_message_is_refused_and_the_next_one_is_taken(loaded, caplog, what):
    frame, why = BROKEN[what]
    titan = loaded.titan
    with caplog.at_level(logging.DEBUG), io_says(loaded, frame, done()):
        pass
    assert why in caplog.text
    assert titan.links()["io"].refused == 1
    assert titan.messages() == []
    with io_says(loaded, whole(IO, POSE, T_MS, GOOD), done()):
        pass
    assert titan.latest("io", "/pose").data == b"good"


def test_a_reply_with_a_wrong_id_ends_the_pull(loaded):
    with io_says(loaded, done(), name=b"wrong!") as liar:
        pass
    assert liar.end.reason == "the peer answered what was not asked"
    assert loaded.titan.links()["io"].refused == 1


@pytest.mark.parametrize("frames", [(), (done(MISSING),)], ids=["at first", "in the middle"])
def test_a_peer_that_never_answers_costs_the_time_out(loaded, frames):
    with io_says(loaded, *frames, patient=True) as liar:
        loaded.check()  # meanwhile the others are served
    assert liar.end.reason.startswith(f"no byte for {TIMEOUT_S:g} s")
