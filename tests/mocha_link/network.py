"""Two nodes and a model of what is between them, for the tests of the sync between new nodes."""

from __future__ import annotations

import contextlib
import itertools
import random
import struct
import zlib
from collections import Counter
from collections.abc import Callable

from benchmarks.fleet.network_sim import team_of
from mocha_link.clock import Instant
from mocha_link.store import wire
from mocha_link.store.database import Database
from mocha_link.store.reassembly_buffer import ReassemblyBuffer
from mocha_link.store.record import Record
from mocha_link.store.wire import Header
from mocha_link.sync import frames as sync
from mocha_link.sync.frames import SyncFrameError, read_chunks, record_id
from mocha_link.sync.peer import NodeContext, Peer
from mocha_link.sync.sync_receiver import SyncReceiver
from mocha_link.sync.sync_sender import SyncSender
from mocha_link.team.team import Team

NOW = Instant(1_795_175_900.0, 1.0)
START_MS = 1_795_175_000_000
ROBOTS, TOPICS = 256, 256
KINDS = ", ".join(
    f"{{name: /t{topic}, type: a/B, history: {3 if topic % 4 == 3 else 1}}}"
    for topic in range(TOPICS)
)
TEAM = team_of(
    "robots:\n"
    + "".join(
        f"  r{robot:03}: {{kind: k, address: a{robot}, base_port: 10, clients: []}}\n"
        for robot in range(ROBOTS)
    )
    + f"kinds: {{k: {{topics: [{KINDS}]}}}}\n"
)


def peer_of(  # noqa: PLR0913 - what makes peers differ
    database: Database | None = None,
    *,
    name: str = "io",
    team: Team = TEAM,
    boot_id: int = 9,
    reassembly: ReassemblyBuffer | None = None,
    follow: bool = False,
    own: str = "titan",
    new_id: Callable[[], bytes] | None = None,
    **options: object,
) -> Peer:
    """What titan knows of a peer, by default of io."""
    numbers = itertools.count()
    context = NodeContext(
        name=own,
        team=team,
        database=Database() if database is None else database,
        reassembly=ReassemblyBuffer() if reassembly is None else reassembly,
        new_id=new_id or (lambda: next(numbers).to_bytes(6)),
        boot_id=boot_id,
        follow=follow,
    )
    return Peer(name, context, **options)


class Node:
    """A database with what belongs to it."""

    def __init__(self, name: str, seed: int = 0) -> None:
        self.name = name
        self.random = random.Random(f"{name} {seed}")
        self.published: dict[tuple[int, int], int] = {}
        self.start()

    def start(self) -> None:
        """Begin a new process with an empty memory."""
        self.database = Database(TEAM.histories)
        self.reassembly = ReassemblyBuffer()
        self.peers: dict[str, Peer] = {}

    def peer(self, name: str) -> Peer:
        if name not in self.peers:
            self.peers[name] = peer_of(
                self.database,
                name=name,
                boot_id=self.random.getrandbits(64),
                reassembly=self.reassembly,
            )
        return self.peers[name]

    def store(  # noqa: PLR0913
        self,
        robot_id: int,
        topic_id: int,
        stamp_ms: int,
        *,
        size: int = 20,
        priority: int = 0,
        extrapolated: bool = False,
    ) -> Record:
        data = random.Random(f"{robot_id} {topic_id} {stamp_ms}").randbytes(size)
        body = wire.pack(0, priority, data, stamp_ms=stamp_ms)
        header = Header.at(robot_id, topic_id, stamp_ms)
        record = Record(header, priority, body, stamp_ms, NOW.unix_s, extrapolated)
        self.database.insert(record, NOW.unix_s)
        return record

    @property
    def content(self) -> dict[int, bytes]:
        return {record_id(record): record.body for record in self.database.kept()}


class Pull:
    """One node's pull from another, frame by frame; each begins some seconds after the others."""

    steady_s = NOW.steady_s

    def __init__(self, asker: Node, server: Node, *, budget: int = 0, room: int = 1_100) -> None:
        Pull.steady_s += 1.5
        self.peer = asker.peer(server.name)
        self.sender = SyncSender(server.peer(asker.name))
        self.receiver = SyncReceiver(asker.peer(server.name), budget=budget, room=room)
        self.up: list[bytes] = []
        self.down: list[bytes] = []
        self.events: list[object] = []
        self.refusals: list[str] = []
        self.bytes_up = self.bytes_down = self.data_down = 0
        self.seen: set[bytes] = set()
        self.arrived: Counter[int] = Counter()  # data bytes by long id
        self.take(self.receiver.open(self.now))

    @property
    def now(self) -> Instant:
        return Instant(NOW.unix_s, Pull.steady_s)

    def take(self, frames: list[bytes]) -> None:
        self.up += frames
        self.bytes_up += sum(map(len, frames))
        self.events += self.peer.log.take_events()
        self.refusals += self.peer.log.take_refusals()

    def give(self, room: int = 1_100) -> bytes | None:
        """The next frame of the serving side, under way now."""
        frame = self.sender.next(room)
        if frame is not None:
            assert len(frame) <= room
            self.down.append(frame)
            self.bytes_down += len(frame)
            self.data_down += data_bytes(frame)
        return frame

    def deliver_up(self, place: int = 0) -> None:
        """One frame of the pulling side arrives."""
        frame = self.up.pop(place)
        try:
            self.sender.receive(frame)
        except SyncFrameError as error:
            self.refusals.append(str(error))

    def deliver(self, place: int = 0) -> None:
        """One frame of the serving side arrives."""
        frame = self.down.pop(place)
        if frame[0] == sync.CHUNKS and frame not in self.seen:
            self.seen.add(frame)
            self.count(frame)
        self.take(self.receiver.receive(frame, self.now))

    def count(self, frame: bytes) -> None:
        with contextlib.suppress(SyncFrameError):
            chunks = read_chunks(frame)
            for message_id, *_, data in (*chunks.wholes, *chunks.pieces):
                self.arrived[message_id] += len(data)

    def run(self, room: int = 65_536) -> Pull:
        """All of it, with nothing in its way."""
        for _ in range(1_000_000):
            if self.up:
                self.deliver_up()
            elif self.down:
                self.deliver()
            elif self.give(room) is None:
                break
        return self

    def run_badly(
        self, rng: random.Random, *, ordered: bool, cut: int, meanwhile, damage: float = 0
    ) -> None:
        """At most `cut` steps, with frames out of order and twice unless `ordered`."""
        window = rng.randint(1, 12)
        for _ in range(cut):
            choice = rng.random()
            if choice < 0.05:
                meanwhile()
            elif choice < 0.35 and len(self.down) < window:
                self.give(rng.choice((300, 500, 1_100, 5_000)))
            else:
                side, arrive = rng.choice(((self.up, self.deliver_up), (self.down, self.deliver)))
                if side:
                    place = 0 if ordered else rng.randrange(len(side))
                    if not ordered and rng.random() < 0.1:
                        side.insert(rng.randrange(len(side)), side[place])
                        place = rng.randrange(len(side))
                    if rng.random() < damage:
                        side[place] = damaged(rng, side[place])
                    arrive(place)


def data_bytes(frame: bytes) -> int:
    if frame[0] != sync.CHUNKS:
        return 0
    chunks = read_chunks(frame)
    return sum(len(each[-1]) for each in (*chunks.wholes, *chunks.pieces))


def damaged(rng: random.Random, frame: bytes) -> bytes:
    """A frame with one wrong bit."""
    raw = bytearray(frame)
    raw[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
    return bytes(raw)


def mutated(rng: random.Random, frame: bytes) -> bytes:
    """A frame with something wrong in it; often its checksum fits again."""
    raw = bytearray(frame)
    for _ in range(rng.randint(1, 3)):
        place = rng.randrange(len(raw) + 1)
        match rng.randrange(5):
            case 0:
                del raw[place:]
            case 1:
                del raw[place : place + rng.randint(1, 9)]
            case 2:
                raw[place:place] = rng.randbytes(rng.randint(1, 9))
            case 3:
                raw[place : place + 1] = bytes((rng.choice((0, 1, 127, 255)),))
            case 4:
                raw[place : place + 4] = rng.randbytes(4)
    return signed(bytes(raw)) if rng.random() < 0.7 else bytes(raw)


def signed(frame: bytes) -> bytes:
    """The frame with the checksum that it should have."""
    if len(frame) < sync.CHUNKS_BYTES:
        return frame
    end = len(frame)
    if frame[0] == sync.CHUNKS:
        wholes, pieces = struct.unpack_from(">HH", frame, 10)
        end = sync.CHUNKS_BYTES + wholes * sync.WHOLE.size + pieces * sync.PIECE.size
    return frame[:1] + zlib.crc32(frame[5:end], frame[0]).to_bytes(4) + frame[5:]
