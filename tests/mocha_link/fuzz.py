"""Frames of every kind as nodes really exchange them, and what becomes of them in bad hands."""

import os
import random

from benchmarks.fleet.network_sim import NetworkSim
from mocha_link.datagram import packet as wire
from mocha_link.sync import frames as sync
from mocha_link.sync.credit import GRANT
from mocha_link.sync.frames import MESSAGE_HEADER_BYTES
from mocha_link.sync.protocol import (
    CODE_BYTES,
    DENDT,
    GDATA,
    GHEAD,
    ID_BYTES,
    SYNC1,
    SYNCC,
    SYNCF,
    Action,
    ReplyDatagram,
    Send,
    SendDatagram,
)
from mocha_link.team.team import Team
from tests.mocha_link.network import mutated as mutated_sync

EXPLORE = os.environ.get("HYPOTHESIS_PROFILE") == "explore"  # take the time that it takes
HEAD_BYTES = ID_BYTES + CODE_BYTES
CODES = (GHEAD, GDATA, DENDT, SYNC1, SYNCF, SYNCC, b"SYNC2", b"SERRM", b"\xff\xfe\x80\0\x01")
NUMBERS = (0, 1, 2, 127, 128, 255, 65_535, 65_536, 2**31 - 1, 2**31, 2**32 - 1, 2**47, 2**64 - 1)
MAX_BYTES = 60_000
TOKEN = slice(1, 1 + wire.TOKEN_BYTES)


class Recorder(NetworkSim):
    """Records all that robots send to one another."""

    def __init__(self, team: Team, **options: object) -> None:
        super().__init__(team, **options)
        self.requests: list[bytes] = []
        self.replies: list[bytes] = []
        self.up: list[bytes] = []
        self.down: list[bytes] = []

    def _do(self, name: str, action: Action) -> None:
        match action:
            case Send(frame=frame):
                self.requests.append(frame)
            case SendDatagram(packet=packet):
                self.up.append(packet)
            case ReplyDatagram(packet=packet):
                self.down.append(packet)
        super()._do(name, action)

    def _answer(self, server: str, route: tuple[bytes, ...], frame: bytes) -> None:
        self.replies.append(frame)
        super()._answer(server, route, frame)


def record(team: Team, puller: str, server: str, seed: int = 0) -> Recorder:
    """What two robots send in many meetings: new and old ways, connections and datagrams."""
    rng = random.Random(seed)
    pair = (puller, server)
    everything = Recorder(team, names=pair)
    for original in (False, True):
        changed = team.with_robots({name: {"original": original} for name in pair})
        for datagrams in (False, True):
            recorder = Recorder(changed, names=pair, datagrams=datagrams)
            if datagrams and not original:
                recorder.blocked = {("zmq", *pair), ("zmq", *pair[::-1])}
            for number in range(8):
                for name in pair:
                    for topic in changed.topics_of(name):
                        for _ in range(rng.choice((0, 1, topic.history))):
                            data = rng.randbytes(rng.choice((0, 20, 300, 9000)))
                            node, now = recorder.nodes[name], recorder.at(name)
                            node.publish(topic, data, now, at_once=True)
                recorder.part(rng.uniform(1, 100))
                recorder.meet(*pair, cut=rng.choice((None, 4, 9, 30)))
                if number % 3 == 2:
                    recorder.restart(puller)
                if number == 4:
                    recorder.restart(server)
            everything.requests += recorder.requests
            everything.replies += recorder.replies
            everything.up += recorder.up
            everything.down += recorder.down
    return everything


class Fuzzer:
    """Makes bad frames of good ones, always the same for a seed."""

    def __init__(self, recorded: Recorder, seed: int) -> None:
        self.random = random.Random(seed)
        self._requests = _by_kind(recorded.requests, _code_of)
        self._replies = _by_kind(recorded.replies, _kind_of_reply)
        self._openings = [packet for packet in recorded.up if _opens(packet)]
        self._packets = {
            "up": _by_kind(recorded.up, _kind_of_packet),
            "down": _by_kind(recorded.down, _kind_of_packet),
        }

    def _pick(self, kinds: dict[object, list[bytes]]) -> bytes:
        return self.random.choice(kinds[self.random.choice(list(kinds))])

    def opening(self, request_id: bytes) -> bytes:
        """A good request that begins a sync."""
        return request_id + self.random.choice(self._requests[SYNC1])[ID_BYTES:]

    def request(self, request_id: bytes) -> bytes:
        """A request that may be anything, mostly under an id that is known."""
        rng = self.random
        frame = self._pick(self._requests)
        choice = rng.random()
        if choice < 0.3:
            code = frame[ID_BYTES:HEAD_BYTES]
            at = HEAD_BYTES + (GRANT.size if code == SYNC1 else 0)
            frame = frame[:at] + mutated_sync(rng, frame[at:] or b"\0")
        elif choice < 0.4:
            frame = frame[:ID_BYTES] + rng.choice(CODES) + frame[HEAD_BYTES:]
        elif choice < 0.95:
            frame = self.spoil(frame, self._pick(self._requests))
        return request_id + frame[ID_BYTES:] if rng.random() < 0.9 else frame

    def reply(self, request_id: bytes) -> bytes:
        """A reply that may be anything, under the id of the request."""
        rng = self.random
        frame = self._pick(self._replies)
        choice = rng.random()
        if choice < 0.5:
            frame = frame[:ID_BYTES] + mutated_sync(rng, frame[ID_BYTES:] or b"\0")
        elif choice < 0.95:
            frame = self.spoil(frame, self._pick(self._replies))
        return request_id + frame[ID_BYTES:]

    def good_reply(self, kind: object, request_id: bytes) -> bytes:
        """A reply as a node has given it once: `kind` is the kind of a sync's frame."""
        return request_id + self.random.choice(self._replies[kind])[ID_BYTES:]

    def opening_packet(self, token: bytes) -> bytes:
        """A good datagram that begins a sync."""
        packet = self.random.choice(self._openings)
        return packet[:1] + token + packet[TOKEN.stop :]

    def packet(self, way: str, token: bytes) -> bytes:
        """A datagram that may be anything, mostly of the flow that is known."""
        rng = self.random
        packet = self._pick(self._packets[way])
        choice = rng.random()
        if 0.1 <= choice < 0.5:
            packet = self._packet_of_bad_frames(packet)
        elif choice >= 0.5:
            packet = self.spoil(packet, self._pick(self._packets[way]))[:1400]
        return packet[:1] + token + packet[TOKEN.stop :] if rng.random() < 0.95 else packet

    def _packet_of_bad_frames(self, packet: bytes) -> bytes:
        """As the flow sends it, with a number of its own, around sync frames that are wrong."""
        parsed = wire.parse(packet)
        if parsed is None or not parsed.frames:
            return packet
        rng = self.random
        number = rng.choice((rng.randrange(300), rng.randrange(300), 2**32 - 1, 2**32 - 2))
        frames = [mutated_sync(rng, frame)[:1100] for frame in parsed.frames if frame]
        return wire.data(
            packet[TOKEN],
            number,
            floor=max(0, number - rng.randrange(40)),
            content=number,
            body=wire.join(frames),
            ack=b"",
        )

    def spoil(self, frame: bytes, other: bytes) -> bytes:
        """Something is wrong with a frame: bits, lengths, numbers, what is where."""
        rng = self.random
        at = rng.randrange(len(frame) + 1)
        head, tail = frame[:at], frame[at:]
        some = rng.randbytes(rng.randint(1, 40))
        size = rng.choice((1, 2, 4, 8))
        number = rng.choice(NUMBERS) & (1 << 8 * size) - 1
        made = (
            lambda: head,
            lambda: head + tail[len(some) :],
            lambda: head + some + tail,
            lambda: head + other[rng.randrange(len(other) + 1) :],
            lambda: self._flip(frame),
            lambda: head + number.to_bytes(size, rng.choice(("big", "little"))) + tail[size:],
            lambda: rng.randbytes(rng.choice((0, 1, 5, 6, 11, 30, 300, 1200))),
            lambda: head + tail[:400] * rng.randint(2, 20) + tail,
            lambda: frame + some * rng.randint(1, 9),
        )
        return rng.choice(made)()[:MAX_BYTES]

    def _flip(self, frame: bytes) -> bytes:
        raw = bytearray(frame or b"\0")
        for _ in range(self.random.randint(1, 8)):
            raw[self.random.randrange(len(raw))] ^= 1 << self.random.randrange(8)
        return bytes(raw)


def _by_kind(frames: list[bytes], kind_of) -> dict[object, list[bytes]]:
    kinds: dict[object, list[bytes]] = {}
    for frame in frames:
        kinds.setdefault(kind_of(frame), []).append(frame)
    return kinds


def _code_of(frame: bytes) -> bytes:
    return frame[ID_BYTES:HEAD_BYTES]


def _kind_of_reply(frame: bytes) -> object:
    """The kind of a sync's frame, or about the length of what is none."""
    body = frame[ID_BYTES:]
    if len(body) >= MESSAGE_HEADER_BYTES and sync.OPEN <= body[0] <= sync.CHUNKS:
        return body[0]
    return "original", len(body).bit_length()


def _opens(packet: bytes) -> bool:
    parsed = wire.parse(packet)
    return parsed is not None and any(frame[:1] == bytes((sync.OPEN,)) for frame in parsed.frames)


def _kind_of_packet(packet: bytes) -> int:
    return packet[0]
