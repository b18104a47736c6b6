"""The serving side: two paths, credit, original clients, and peers that send what they like."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.fleet.network_sim import pair_of
from mocha_link.clock import Instant
from mocha_link.datagram.datagram import Flow
from mocha_link.datagram.packet import parse
from mocha_link.links.metrics import Direction, SyncEnded, SyncStarted, SyncTimedOut
from mocha_link.store import wire
from mocha_link.store.database import Database
from mocha_link.store.record import Record
from mocha_link.store.wire import Header
from mocha_link.sync.credit import GRANT, MAX_CHUNK, MIN_CHUNK
from mocha_link.sync.flows import FLIGHT_BYTES, WINDOW_BYTES
from mocha_link.sync.frames import (
    CHUNKS,
    END,
    HELLO,
    OPEN,
    MessageAssembler,
    message_frames,
    read_chunks,
)
from mocha_link.sync.protocol import DIALLED, ID_BYTES, REQUEST_PATIENCE_S, Standing
from mocha_link.sync.server import Server
from mocha_link.sync.sync_messages import Have, Hello, Open, Reception
from mocha_link.sync.sync_receiver import SyncReceiver
from mocha_link.sync.sync_sender import MIN_ROOM
from tests.mocha_link.network import peer_of

NOW_S = 1_795_175_900.0
TOPICS = 100
TEAM = pair_of(TOPICS)
ROUTE, OTHER = (b"\0\0\0\1", b""), (b"\0\0\0\2", b"")
LOSING = Standing(loses_much=True)
PLENTY = GRANT.pack(1 << 40, 65_536)
OUT = Direction.OUT
MBIT = 125_000


def at(steady_s: float) -> Instant:
    return Instant(NOW_S + steady_s, 1000.0 + steady_s)


def record(topic_id: int, size: int = 100, age_ms: int = 60_000) -> Record:
    stamp_ms = int(NOW_S * 1000) - age_ms + topic_id
    data = random.Random(topic_id).randbytes(size)
    body = wire.pack(0, 0, data, stamp_ms=stamp_ms)
    return Record(Header.at(1, topic_id, stamp_ms), 0, body, stamp_ms, NOW_S)


class PullingPeer:
    """io: pulls over a connection, over datagrams, or both, and sends what a test wants."""

    def __init__(
        self,
        server: Server,
        request_id: bytes = b"ididid",
        *,
        follow: bool = False,
        address_token: int | None = None,
    ) -> None:
        self.server = server
        self.id = request_id
        self.database = Database()
        known = peer_of(self.database, name="titan", team=TEAM, boot_id=7, follow=follow)
        token = server.peer.tokens.next if address_token is None else address_token
        known.tokens.receive(token)  # by default they have met
        self.peer = known
        self.receiver = SyncReceiver(known, room=1100)
        (self.opening,) = self.receiver.open(at(0))
        self.outbox: list[bytes] = []  # for datagrams
        self.flow: Flow | None = None
        self.frames: list[bytes] = []  # that came on the connection
        self.last = b""  # datagram of the server

    # --- on the connection

    def open(
        self, grant: bytes = PLENTY, route: tuple[bytes, ...] = ROUTE, now: Instant | None = None
    ) -> bytes | None:
        return self.request(b"SYNC1" + grant + self.opening, route, now)

    def request(
        self, content: bytes, route: tuple[bytes, ...] = ROUTE, now: Instant | None = None
    ) -> bytes | None:
        return self.server.handle(route, [self.id + content], now or at(0))

    def drain(self, now: Instant | None = None) -> list[tuple[tuple[bytes, ...], bytes]]:
        """All that the server gives for connections now, without reading it."""
        given = []
        while supplied := self.server.supply():
            given.append((supplied[0], b"".join(supplied[1])))
        return given

    def read(self, now: Instant | None = None) -> None:
        """Receive all that the server supplies for connections, and send the replies."""
        now = now or at(0)
        while supplied := self.server.supply():
            frame, *more = supplied[1]
            assert frame[:ID_BYTES] == self.id
            self.frames.append(frame)
            for each in self.receiver.receive(frame[ID_BYTES:], now, more):
                self.request(b"SYNCF" + each, now=now)

    # --- by datagrams

    def cast(self, now: Instant, *, rate: float | None = None) -> None:
        """Begin by datagrams."""
        self.outbox.append(self.opening)
        self.flow = Flow(
            self.id, lambda _: self.outbox.pop(0) if self.outbox else None, rate_bytes_s=rate
        )
        self.flow.on_contact(now.steady_s)
        self.pass_on(now)

    def cast_probe(self, now: Instant) -> None:
        """What it sends when nothing of what it began with was answered."""
        self.flow = Flow(self.id, lambda _: self.outbox.pop(0) if self.outbox else None)
        self.flow.on_contact(now.steady_s)
        self.pass_on(now)

    def openings(self, now: Instant) -> list[bytes]:
        """The datagrams that begin, which are for the test to pass on."""
        self.outbox.append(self.opening)
        self.flow = Flow(self.id, lambda _: self.outbox.pop(0) if self.outbox else None)
        return self.flow.transmit(now.steady_s)

    def pass_on(self, now: Instant) -> None:
        for packet in self.flow.transmit(now.steady_s):
            self.server.packet(packet, now)

    def run(
        self, begin_s: float, delay_s: float, *, reading: bool = False, limit_s: float = 20
    ) -> float:
        """Let datagrams pass, each `delay_s` after it left; the time at the end."""
        time_s = begin_s
        way: list[tuple[float, bool, bytes]] = []
        while not self.receiver.over:
            assert time_s < begin_s + limit_s, "does not end"
            now = at(time_s)
            way += [(time_s + delay_s, False, packet) for packet in self.server.transmit(now)]
            sent = self.flow.transmit(now.steady_s)
            way += [(time_s + delay_s, True, packet) for packet in sent]
            if reading:
                self.read(now)
            wakes = [w - 1000 for w in (self.server.wake_s, self.flow.wake_s) if w is not None]
            wakes += [each[0] for each in way[:1]]
            time_s = max(min(wakes), time_s + 0.0005)
            while way and way[0][0] <= time_s:
                _, up, packet = way.pop(0)
                if up:
                    self.server.packet(packet, at(time_s))
                else:
                    self.last = packet
                    for frame in self.flow.receive(packet, at(time_s).steady_s):
                        self.outbox += self.receiver.receive(frame, at(time_s))
        self.pass_on(at(time_s))
        return time_s

    @property
    def got(self) -> dict[Header, bytes]:
        return {each.header: each.body for each in self.database.records()}


def take_events(server: Server) -> list[object]:
    """The events that it emitted since the last call."""
    return list(server.peer.log.take_events())


@pytest.fixture
def database() -> Database:
    result = Database()
    for topic_id in range(TOPICS):
        result.insert(record(topic_id), NOW_S)
    return result


@pytest.fixture
def server(database) -> Server:
    return Server(peer_of(database, team=TEAM))


@pytest.fixture
def io(server) -> PullingPeer:
    return PullingPeer(server)


def hello(reply: bytes) -> Hello:
    assert reply[:ID_BYTES] == b"ididid"
    return Hello.decode(MessageAssembler(HELLO).take(reply[ID_BYTES:]).content)


def reception(reply: bytes) -> Reception:
    """How an opening was taken."""
    return hello(reply).reception


def all_of(database: Database) -> dict[Header, bytes]:
    return {each.header: each.body for each in database.records()}


def fill(database: Database, topics: int = 4, size: int = 200_000) -> None:
    """Messages that take a while."""
    for topic_id in range(topics):
        database.insert(record(topic_id, size, age_ms=1_000), NOW_S)


# --- the connection


def test_a_sync_over_the_connection(server, io, database):
    assert io.open() is None
    assert take_events(server) == [SyncStarted("io", NOW_S, OUT)]
    io.read(at(2))
    assert io.got == all_of(database)
    assert io.receiver.complete
    (ended,) = take_events(server)
    assert ended == SyncEnded(
        "io", NOW_S + 2, OUT, TOPICS, ended.bytes, pytest.approx(2), complete=True
    )
    assert ended.bytes == io.receiver.bytes
    assert server.supply() is None
    assert server.wake_s is None


def test_frames_wait_for_credit_and_hardly_exceed_it(server, io, database):
    fill(database)
    limit = 5_000
    io.open(GRANT.pack(limit, MIN_CHUNK))
    sent = 0
    for _ in range(40):
        given = io.drain()
        assert given
        for route, frame in given:
            assert route == ROUTE
            assert len(frame) <= MIN_CHUNK
            assert sent < limit  # there was credit left
            sent += len(frame)
        assert sent < limit + MIN_ROOM + ID_BYTES
        assert io.drain() == []
        limit += 3_000
        assert io.request(b"SYNCC" + GRANT.pack(limit, MIN_CHUNK)) is None


@pytest.mark.parametrize(
    "grant",
    [
        GRANT.pack((1 << 64) - 1, (1 << 32) - 1),
        GRANT.pack((1 << 64) - 1, 0),
        GRANT.pack(0, (1 << 32) - 1),
        GRANT.pack(1, 1),
    ],
)
def test_hostile_grants(server, io, database, grant):
    """However much they promise, a frame has a size that a connection takes."""
    fill(database, topics=40)
    assert io.open(grant) is None
    io.request(b"SYNCC" + grant)
    io.request(b"SYNCC" + grant[:-1])  # one that is none changes nothing
    io.request(b"SYNCC" + grant + b"\0")
    io.request(b"SYNCC")
    for _ in range(10):
        supplied = server.supply()
        if supplied:
            assert sum(map(len, supplied[1])) <= max(MAX_CHUNK, MIN_CHUNK)
    assert [type(event) for event in take_events(server)] == [SyncStarted]


@pytest.mark.parametrize(
    "content",
    [
        b"SYNCF",
        b"SYNCF" + bytes(40),
        b"SYNCC" + PLENTY,
    ],
)
def test_what_opens_nothing_is_refused(server, io, content):
    """Like an original node does it: the client goes on with what it understands."""
    assert io.request(content) == b"idididSERRM"
    assert take_events(server) == []
    assert io.request(b"GHEAD").startswith(b"ididid\1")


@pytest.mark.parametrize(
    "rest", [b"", PLENTY[:-1], PLENTY, PLENTY + b"garbage", PLENTY + bytes(40)]
)
def test_a_damaged_opening_is_not_answered_as_an_original_node_does_it(server, io, rest):
    """Who begins so is a new node, and gets UNREADABLE; it must not go on with ids."""
    reply = io.request(b"SYNC1" + rest)
    assert reception(reply) is Reception.UNREADABLE
    assert hello(reply).boot_id == server.peer.node.boot_id
    io.receiver.receive(reply[ID_BYTES:], at(0))
    assert "could not decode our OPEN" in io.receiver.rejection
    assert take_events(server) == []
    assert io.request(b"GHEAD") is None


@pytest.mark.parametrize("code", [b"SYNC1" + PLENTY, b"SYNCF"])
@pytest.mark.parametrize("damaged", [b"", b"garbage", bytes(40)])
def test_a_damaged_frame_of_a_running_sync_is_ignored(server, io, database, code, damaged):
    """An error reply would mean that the sync is unknown, and the peer would abort it."""
    io.open()
    assert io.request(code + damaged) is None
    assert server.peer.log.take_refusals() == ["a damaged frame of a sync"]
    io.read()
    assert io.got == all_of(database)
    assert io.receiver.complete


def test_padding_that_comes_after_the_opening_is_no_damage(server, io):
    """After an opening that nearly fills it, the padding takes a packet of its own."""
    io.cast(at(0))
    io.outbox.append(bytes(20))
    io.pass_on(at(0.01))
    assert server.peer.log.take_refusals() == []
    io.outbox.append(b"garbage")
    io.pass_on(at(0.02))
    assert server.peer.log.take_refusals() == ["a damaged frame of a sync"]


def test_another_version_of_the_sync(server, io):
    opening = b"\x07" + Open(1, 0, Have(())).encode()[1:]
    (frame,) = message_frames(OPEN, 0, opening, 1000)
    assert reception(io.request(b"SYNC1" + PLENTY + frame)) is Reception.UNREADABLE
    began, ended = take_events(server)
    assert isinstance(began, SyncStarted)
    assert ended == SyncTimedOut("io", NOW_S, OUT, ended.reason)
    assert "io uses another version of the sync" in ended.reason


# --- the fallback for original nodes


def test_the_fallback_is_ignored_where_the_sync_is(server, io):
    io.open(GRANT.pack(0, 65_536))
    assert io.request(b"GHEAD") is None
    assert [type(event) for event in take_events(server)] == [SyncStarted]


def test_the_fallback_is_answered_elsewhere(server, io, database):
    """The same id on another connection, or another id on this one: the original protocol."""
    io.open(GRANT.pack(0, 65_536))
    take_events(server)
    assert io.request(b"GHEAD", OTHER) == b"ididid" + database.header_list()
    assert server.handle(ROUTE, [b"others" + b"GHEAD"], at(0)) == (
        b"others" + database.header_list()
    )
    assert io.request(b"DENDTio") == b"idididAck"
    assert io.request(b"GDATA" + record(3).header.pack()) == b"ididid" + record(3).body


# --- beginnings and ends


def test_a_new_pull_replaces_the_one_before(server, io, database):
    """After a cut the peer comes again, with another id, while the old pull is still open."""
    io.open(GRANT.pack(500, 1_400))
    io.drain()
    again = PullingPeer(server, b"again!")
    again.open(route=OTHER)
    events = take_events(server)
    assert [type(event) for event in events] == [SyncStarted, SyncTimedOut, SyncStarted]
    assert events[1].reason == "the peer began anew"
    assert io.request(b"SYNCC" + PLENTY) == b"idididSERRM"
    again.read()
    assert again.got == all_of(database)


def test_silence_ends_a_sync(server, io):
    io.open()
    io.drain(at(0))
    server.tick(at(REQUEST_PATIENCE_S))
    assert [type(event) for event in take_events(server)] == [SyncStarted]
    server.tick(at(REQUEST_PATIENCE_S + 0.1))
    (broken,) = take_events(server)
    assert broken == SyncTimedOut(
        "io", NOW_S + REQUEST_PATIENCE_S + 0.1, OUT, "the peer sent nothing for 13 s"
    )
    server.tick(at(60))
    assert take_events(server) == []
    assert server.supply() is None


# --- datagrams


def test_a_near_peer_is_moved_to_the_connection(server, io, database):
    fill(database)
    io.cast(at(0))
    io.open()
    io.run(0, 0.001, reading=True)
    assert io.got == all_of(database)
    assert len(io.frames) > 10
    assert not io.peer.log.refusals
    assert [type(event) for event in take_events(server)] == [SyncStarted, SyncEnded]


def test_a_connection_that_loses_much_serves_until_datagrams_are_known_to_reach_the_peer(
    server, io, database
):
    fill(database)
    io.open(GRANT.pack(3_000, 1_400))
    assert server.route(lambda _route: LOSING)
    assert io.drain()
    io.cast(at(0))
    (probe,) = server.transmit(at(0))
    assert parse(probe).frames == []
    io.request(b"SYNCC" + GRANT.pack(6_000, 1_400))
    assert io.drain()
    assert io.flow.receive(probe, at(0.05).steady_s) == []
    io.pass_on(at(0.1))
    io.request(b"SYNCC" + PLENTY, now=at(0.1))
    assert io.drain() == []
    assert any(parse(each).frames for each in server.transmit(at(0.1)))
    assert [type(event) for event in take_events(server)] == [SyncStarted]


def test_datagrams_of_a_near_peer_change_nothing_for_its_connection(server, io, database):
    fill(database)
    io.open(GRANT.pack(3_000, 1_400))
    io.drain()
    io.cast(at(0))
    (probe,) = server.transmit(at(0))
    io.flow.receive(probe, at(0.001).steady_s)
    io.pass_on(at(0.002))
    io.request(b"SYNCC" + PLENTY, now=at(0.002))
    assert io.drain()
    assert not any(parse(each).frames for each in server.transmit(at(0.1)))


def test_a_far_peer_gets_a_first_window_by_datagrams_and_the_rest_over_its_connection(
    server, io, database
):
    fill(database)
    io.cast(at(0), rate=MBIT)
    io.open(GRANT.pack(1 << 40, 65_536), now=at(0.05))
    assert io.drain() == []
    end_s, sent, under_way = 0.0, 0, []
    while not (given := io.drain()):
        end_s += 0.05
        for packet in under_way:
            io.flow.receive(packet, at(end_s).steady_s)
        io.pass_on(at(end_s))
        under_way = server.transmit(at(end_s))
        sent += sum(map(len, under_way))
        assert end_s < 60
    assert sent >= WINDOW_BYTES
    assert sum(len(frame) for _, frame in given) > 0


def test_beside_the_first_window_the_connection_sends_what_tcp_admits(server, io, database):
    """The window of TCP begins to open at once, and no message waits for it in the kernel."""
    fill(database)
    io.cast(at(0))
    under_way = server.transmit(at(0))
    io.open(GRANT.pack(1 << 40, 2816), now=at(0.05))
    for packet in under_way:
        io.flow.receive(packet, at(0.1).steady_s)
    io.pass_on(at(0.1))
    under_way = server.transmit(at(0.1))
    assert 0 < sum(map(len, under_way)) < WINDOW_BYTES
    assert server.route(lambda _route: Standing(unsent_bytes=FLIGHT_BYTES))
    assert io.drain() == []
    assert server.route(lambda _route: Standing())  # another kernel: not known
    assert io.drain() == []
    assert server.route(lambda _route: Standing(unsent_bytes=0))
    given = sum(len(frame) for _, frame in io.drain())
    assert FLIGHT_BYTES <= given < FLIGHT_BYTES + 2816


def test_on_a_link_that_holds_less_than_a_flight_the_connection_waits(server, io, database):
    """Its packets would only take the place of the datagrams."""
    fill(database)
    io.cast(at(0))
    for number, packet in enumerate(server.transmit(at(0))):  # 23 KB/s, 0.05 s
        io.flow.receive(packet, at(0.05 * (number + 1)).steady_s)
        io.pass_on(at(0.05 * (number + 1)))
    io.open(GRANT.pack(1 << 40, 2816), now=at(0.65))
    assert server.route(lambda _route: Standing(unsent_bytes=0))
    assert io.drain() == []


@pytest.mark.parametrize("content", [True, False])
def test_where_tcp_loses_much_datagrams_go_on_far_away(server, io, database, content):
    """The opening by datagrams, or all of them but a probe, came late or was lost."""
    fill(database, size=20_000)
    io.open(GRANT.pack(3_000, 1_400))
    assert server.route(lambda _route: LOSING)
    io.read()
    io.cast(at(0)) if content else io.cast_probe(at(0))
    io.run(0, 0.05)
    assert len(io.frames) == 3
    assert io.got == all_of(database)
    assert io.receiver.complete
    assert [type(event) for event in take_events(server)] == [SyncStarted, SyncEnded]


def test_what_comes_late_of_a_pull_that_is_over_takes_the_next_off_no_connection(server, database):
    fill(database, size=20_000)
    first, second = PullingPeer(server, b"first."), PullingPeer(server, b"second")
    first.cast(at(0))
    end_s = first.run(0, 0.05)
    second.open(GRANT.pack(3_000, 1_400), now=at(end_s + 0.1))
    assert second.drain()
    first.flow.receive(first.last, at(end_s + 0.2).steady_s)  # once more, so it is acknowledged
    (late,) = first.flow.transmit(at(end_s + 0.2).steady_s)
    server.packet(late, at(end_s + 0.2))
    second.request(b"SYNCC" + PLENTY, now=at(end_s + 0.2))
    assert second.drain()


def test_datagrams_that_were_in_doubt_carry_again_once_one_is_acknowledged(server, io, database):
    fill(database, size=20_000)
    io.cast(at(0))
    lost = server.transmit(at(0))
    assert lost
    io.open(GRANT.pack(3_000, 1_400), now=at(0.05))
    assert server.route(lambda _route: LOSING)
    server.tick(at(0.3))
    io.request(b"SYNCC" + GRANT.pack(6_000, 1_400), now=at(0.3))
    assert io.drain()
    io.run(0.4, 0.05)
    assert io.got == all_of(database)
    assert io.receiver.complete


def test_a_peer_that_is_gone_after_its_end_is_not_called_for_ever(server):
    """Its END was lost with the acknowledgement in it; what is repeated is the END alone."""
    io = PullingPeer(server)
    lost: list[bytes] = []
    io.pass_on = lambda now: lost.extend(io.flow.transmit(now.steady_s))
    io.cast(at(0))
    for packet in lost:
        assert server.packet(packet, at(0))
    end_s = io.run(0, 0.05) + 1
    for packet in io.flow.transmit(at(end_s).steady_s):
        server.packet(packet, at(end_s))
    assert [type(event) for event in take_events(server)] == [SyncStarted, SyncEnded]
    for tenth in range(1, 100):
        server.transmit(at(end_s + tenth / 10))
        server.tick(at(end_s + tenth / 10))
    assert server.transmit(at(end_s + 30)) == []
    assert server.wake_s is None


def test_what_was_lost_with_a_connection_is_sent_again_on_the_next(server, database):
    """The peer's first connection broke when we had sent something on it."""
    io = PullingPeer(server)
    io.open(route=ROUTE)
    assert io.drain()
    io.open(route=OTHER)
    io.read()
    assert io.got == all_of(database)
    assert io.receiver.complete


def test_a_pull_whose_connection_is_gone_goes_on_over_the_next(server, io, database):
    io.open(GRANT.pack(1 << 40, 1_400))
    assert server.supply()
    assert server.supply()
    assert server.route(lambda _route: None) is None
    assert server.supply() is None
    io.open(route=OTHER)
    assert server.route(lambda route: Standing() if route == OTHER else None) == OTHER
    io.read()
    assert io.got == all_of(database)


@pytest.mark.parametrize("stands", [True, False])
def test_who_followed_on_a_connection_that_is_gone_does_not_any_more(server, database, stands):
    io = PullingPeer(server, follow=True)
    io.open()
    io.read()
    assert [type(event) for event in take_events(server)] == [SyncStarted, SyncEnded]
    assert server.route(lambda _route: Standing() if stands else None) == (
        ROUTE if stands else None
    )
    assert database.insert(record(0, age_ms=0), NOW_S)
    assert server.wants_push({1}) is stands
    assert (server.wake_s is not None) is bool(io.drain()) is stands
    assert take_events(server) == []


def test_who_follows_by_datagrams_needs_no_connection(server, database):
    io = PullingPeer(server, follow=True)
    io.cast(at(0))
    io.open()
    end_s = io.run(0, 0.05)
    assert server.route(lambda _route: None) is None
    assert database.insert(record(0, size=5, age_ms=0), NOW_S)
    assert server.transmit(at(end_s))


@pytest.mark.parametrize("by_datagram", [False, True])
def test_only_an_opening_begins_a_sync(server, by_datagram):
    """An END of a pull that no node remembers."""
    io = PullingPeer(server)
    (io.opening,) = message_frames(END, 0, b"", 1100)
    if by_datagram:
        (packet,) = io.openings(at(0))
        assert not server.packet(packet, at(0))
    else:
        assert reception(io.open()) is Reception.UNREADABLE
    assert take_events(server) == []


CODES = [b"SYNC1", b"SYNCF", b"SYNCC", b"GHEAD", b"GDATA", b"DENDT", b"SERRM"]


@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("request"), st.sampled_from(CODES), st.binary(max_size=60)),
            st.tuples(st.just("good"), st.sampled_from(CODES), st.just(b"")),
            st.tuples(st.just("packet"), st.just(b""), st.binary(max_size=80)),
            st.tuples(st.just("open"), st.just(b""), st.just(b"")),
            st.tuples(st.just("supply"), st.just(b""), st.just(b"")),
            st.tuples(st.just("wait"), st.just(b""), st.just(b"")),
        ),
        max_size=30,
    ),
    st.randoms(use_true_random=False),
)
def test_whatever_a_peer_sends_the_next_pull_succeeds(steps, rng):
    held = Database()
    for topic_id in range(3):
        held.insert(record(topic_id), NOW_S)
    server = Server(peer_of(held, team=TEAM))
    peer = PullingPeer(server)
    time_s = 0.0
    for what, code, rest in steps:
        now = at(time_s)
        route = rng.choice((ROUTE, OTHER))
        if what == "request":
            server.handle(route, [rng.choice((b"ididid", b"others")) + code + rest], now)
        elif what == "good":
            peer.request(code + PLENTY + peer.opening, route, now)
            peer.request(code + peer.opening, route, now)
        elif what == "packet":
            server.packet(b"\x51ididid" + rest, now)
        elif what == "open":
            caster = PullingPeer(server, rng.choice((b"ididid", b"casted")))
            server.packet(caster.openings(at(0))[0], now)
        elif what == "supply":
            server.supply()
            server.transmit(now)
        else:
            time_s += 5
            server.tick(at(time_s))
    last = PullingPeer(server, b"last!!")
    assert last.open(now=at(time_s)) is None
    last.read(at(time_s))
    assert last.got == all_of(held)
    started = ended = 0
    for event in take_events(server):
        assert event.direction is OUT
        started += isinstance(event, SyncStarted)
        ended += isinstance(event, SyncEnded | SyncTimedOut)
    assert ended <= started + 1  # one that was given up may still end


def test_datagrams_without_an_answer_open_nothing_for_a_while():
    server = Server(peer_of(team=TEAM))
    taken = []
    for number in range(5):
        (opening,) = PullingPeer(server, b"open %d" % number).openings(at(number))
        taken.append(server.packet(opening, at(number)))
    assert taken == [True, True, True, True, False]


def test_an_old_opening_does_not_end_a_sync_that_goes_well():
    database = Database()
    database.insert(record(0, 20_000), NOW_S)
    server = Server(peer_of(database, team=TEAM))
    first, second = (
        PullingPeer(server, token).openings(at(0))[0] for token in (b"first.", b"second")
    )
    assert server.packet(first, at(0))
    assert not server.packet(second, at(0.3))
    assert server.packet(second, at(0.9))


def test_a_pull_takes_nothing_of_the_datagrams_of_the_pull_before(server, database):
    before = PullingPeer(server, b"before")
    before.cast(at(0))
    assert server.transmit(at(0))  # none of these arrives
    before.open(now=at(0.01))
    server.tick(at(0.02))
    before.request(b"SYNCF" + message_frames(END, 0, b"", 1100)[0], now=at(0.02))
    after = PullingPeer(server, b"after.")
    after.open(now=at(0.5))
    server.tick(at(0.51))
    frames = [frame for _, frame in after.drain()]
    assert [frame[ID_BYTES] for frame in frames].count(HELLO) == 1
    numbers = [read_chunks(f[ID_BYTES:]).number for f in frames if f[ID_BYTES] == CHUNKS]
    assert numbers == sorted(set(numbers))


def test_an_old_opening_does_not_end_a_pull_over_the_connection_that_we_opened(server):
    goes_well = PullingPeer(server, b"goes.w")
    goes_well.open(route=DIALLED)
    stranger = PullingPeer(server, b"strang", address_token=5)
    stranger.cast(at(0.9))
    assert server.transmit(at(0.9)) == []
    assert {frame[:ID_BYTES] for _, frame in goes_well.drain()} == {goes_well.id}
