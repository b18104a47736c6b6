"""The answering side: any bytes get an answer, offered messages stay available."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.clock import Instant
from mocha_link.links.metrics import Direction, SyncStarted, SyncTimedOut
from mocha_link.store.database import Database
from mocha_link.store.record import Record
from mocha_link.store.wire import Header
from mocha_link.sync.original import ServerSession
from tests.mocha_link.network import peer_of

OUT = Direction.OUT
ID = b"\0\xffabcd"


def record(second: int, body: bytes = b"\0\0body") -> Record:
    return Record(Header(0, 0, second, 0), 0, body, second * 1000, float(second))


def at(steady_s: float) -> Instant:
    return Instant(2000.0, steady_s)


class Session:
    """A session that returns its events as well."""

    def __init__(self, database: Database) -> None:
        self._peer = peer_of(database)
        self._session = ServerSession(self._peer)

    def handle(self, parts: list[bytes], now: Instant) -> tuple[bytes, list[object]]:
        return self._session.handle(parts, now), self._events()

    def tick(self, now: Instant) -> list[object]:
        self._session.tick(now)
        return self._events()

    def _events(self) -> list[object]:
        return self._peer.log.take_events()


@pytest.fixture
def database() -> Database:
    result = Database()
    result.insert(record(1500), 2000)
    return result


@given(
    st.lists(
        st.one_of(
            st.binary(max_size=24),
            st.builds(
                lambda code, rest: ID + code + rest,
                st.sampled_from([b"GHEAD", b"GDATA", b"DENDT", b"SERRM", b"ghead"]),
                st.binary(max_size=8),
            ),
        ),
        max_size=3,
    )
)
def test_any_parts_are_answered(parts):
    held = Database()
    held.insert(record(1500), 2000)
    reply, _ = Session(held).handle(parts, at(0))
    first = parts[0] if parts else b""
    assert reply.startswith(first[:6])
    body, code = reply[len(first[:6]) :], first[6:11]
    if len(parts) == 1 and code == b"GHEAD":
        assert body == record(1500).header.pack()
    elif len(parts) == 1 and code == b"DENDT":
        assert body == b"Ack"
    elif len(parts) == 1 and first[6:] == b"GDATA" + record(1500).header.pack():
        assert body == b"\0\0body"
    else:
        assert body == b"SERRM"


def test_silence_and_a_new_beginning_break_a_pull_off(database):
    session = Session(database)
    session.handle([ID + b"GHEAD"], at(0))
    assert session.tick(at(13)) == []
    (broken,) = session.tick(at(13.1))
    assert broken == SyncTimedOut("io", 2000, OUT, "the peer requested nothing for 13 s")
    assert session.tick(at(50)) == []
    session.handle([ID + b"GHEAD"], at(60))
    assert session.handle([ID + b"GHEAD"], at(61))[1] == [
        SyncTimedOut("io", 2000, OUT, "the peer began anew"),
        SyncStarted("io", 2000, OUT),
    ]


def test_what_was_offered_stays_available(database):
    session = Session(database)
    request = ID + b"GDATA" + record(1500).header.pack()
    session.handle([ID + b"GHEAD"], at(0))
    database.insert(record(1600, b"\0\0newer"), 2000)
    # Old nodes would store an error reply as a message: a slow one gets what it was promised.
    assert session.handle([request], at(100))[0] == ID + b"\0\0body"
    assert session.handle([ID + b"GDATA" + record(1600).header.pack()], at(100))[0] == (
        ID + b"\0\0newer"
    )
    session.handle([ID + b"GHEAD"], at(101))
    # It may still be busy with the list before: 13 s after the new one it is not.
    assert session.handle([request], at(114))[0] == ID + b"\0\0body"
    assert session.handle([request], at(114.1))[0] == ID + b"SERRM"
    assert Session(database).handle([request], at(0))[0] == ID + b"SERRM"


def test_a_list_makes_no_header_anew(database, monkeypatch):
    """Original nodes request it every few seconds, and it may have 65,536 messages."""
    for topic_id in range(1, 50):
        database.insert(Record(Header(0, topic_id, 1500, 0), 0, b"\0\0body", 1_500_000, 1500), 2000)
    made = []
    pack = Header.pack
    monkeypatch.setattr(Header, "pack", lambda header: made.append(header) or pack(header))
    reply, _ = Session(database).handle([ID + b"GHEAD"], at(0))
    assert len(reply) == len(ID) + 50 * Header.SIZE
    assert made == []


def test_a_peer_that_keeps_requesting_does_not_fill_the_memory(database):
    """Only the two last lists are remembered, each with one message of a topic."""
    session = Session(database)
    for second in range(1501, 1600):
        database.insert(record(second, bytes(1000)), 2000)
        session.handle([ID + b"GHEAD"], at(0))
    database.insert(record(1600), 2000)

    def holds(second: int, steady_s: float) -> bool:
        request = ID + b"GDATA" + record(second).header.pack()
        return not session.handle([request], at(steady_s))[0].endswith(b"SERRM")

    assert [second for second in range(1500, 1601) if holds(second, 1)] == [1598, 1599, 1600]
    assert [second for second in range(1500, 1601) if holds(second, 14)] == [1599, 1600]


def test_what_was_offered_is_forgotten_when_the_peer_is_gone(database):
    """Otherwise every peer ever met would keep all that there was then."""
    session = Session(database)
    request = ID + b"GDATA" + record(1500).header.pack()
    session.handle([ID + b"GHEAD"], at(0))
    database.insert(record(1600, b"\0\0newer"), 2000)
    session.tick(at(50))
    assert session.handle([request], at(50))[0] == ID + b"\0\0body"
    session.tick(at(111))
    assert session.handle([request], at(111))[0] == ID + b"SERRM"
