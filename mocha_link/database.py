"""The newest messages of every robot and topic, and what a peer still lacks of them.

In memory; `mocha_link.storage` keeps a copy on disk.

Two orders hold it together. Every message that enters gets the next *sequence number*, so "what
came after number n" is a short answer. And the *wire order* (most urgent first, then newest first)
is the one in which an original node is told what there is.
"""

from __future__ import annotations

import secrets
import struct
import threading
from bisect import bisect_left
from dataclasses import dataclass
from hashlib import blake2b
from typing import TYPE_CHECKING

from mocha_link.header import AHEAD_MS, WRAP_MS, Header, as_ms

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

GROUPS = 16
"""A robot's topics fall into so many groups, each with a digest: group = topic id % GROUPS."""

_STAMP_BITS = 47
_RAW = struct.Struct("6s")
_TOPIC_TIME = struct.Struct(">HHH")


@dataclass(frozen=True, slots=True)
class Record:
    """A message as it is stored and passed on: `body` is what the wire carries, untouched.

    `stamp_ms` is when the robot published it, Unix milliseconds below 2**47 that agree with the
    header modulo 65536 s; `received_s` is when we got or made it. `inferred` says that the stamp
    was guessed from the header by our clock, as that of an original node has to be: if the clock
    was wrong, it is wrong by a multiple of 65536 s, and comparisons bear with that.
    """

    header: Header
    priority: int
    body: bytes
    stamp_ms: int
    received_s: float
    inferred: bool = False

    @property
    def stamp_s(self) -> float:
        """Unix seconds of publication."""
        return self.stamp_ms / 1000


@dataclass(frozen=True, slots=True)
class Knowledge:
    """What we know of a peer's database.

    Everything that it held up to its number `sequence` of its `epoch` has been offered to us. Our
    own last number was `own_sequence` then. Each is a u64; ValueError otherwise.
    """

    epoch: int
    sequence: int
    own_sequence: int

    def __post_init__(self) -> None:
        for value in (self.epoch, self.sequence, self.own_sequence):
            if not 0 <= value < 1 << 64:
                raise ValueError(f"{value} is not within 0 to 2**64 - 1")


@dataclass(slots=True)
class _Kept:
    """A record with what is computed from it once."""

    record: Record
    raw: bytes  # its header
    rank: int  # its place in the wire order
    number: int


class Database:
    """Messages by robot and topic: the newest `history` versions of each. Any thread may use it.

    Args:
        history: how many versions to keep of a robot id and topic id; default: 1.
    """

    def __init__(self, history: Callable[[int, int], int] | None = None) -> None:
        self.epoch = secrets.randbits(64) or 1
        self.sequence = 0
        self._history = history
        self._lock = threading.RLock()
        self._versions: dict[int, list[_Kept]] = {}  # by topic key, newest first
        self._by_raw: dict[bytes, _Kept] = {}
        self._by_number: dict[int, _Kept] = {}  # in the order of the numbers
        self._floors: dict[int, int] = {}  # by topic key: stamp that a new version must exceed
        self._groups: dict[int, list[int]] = {}
        self._knowledge: dict[str, Knowledge] = {}
        self._wire = _WireOrder()

    def newest(self, robot_id: int, topic_id: int) -> Record | None:
        """The newest message of a topic of a robot, if there is any."""
        with self._lock:
            versions = self._versions.get(robot_id << 8 | topic_id)
            return versions[0].record if versions else None

    def get(self, header: Header) -> Record | None:
        """The message with that header, if it is still kept."""
        with self._lock:
            kept = self._by_raw.get(header.pack())
            return kept.record if kept else None

    def history(self, robot_id: int, topic_id: int) -> tuple[Record, ...]:
        """All kept versions of a topic of a robot, newest first."""
        with self._lock:
            return tuple(k.record for k in self._versions.get(robot_id << 8 | topic_id, ()))

    def records(self) -> tuple[Record, ...]:
        """The newest message of every topic in the order of the wire."""
        with self._lock:
            versions = self._versions
            return tuple(versions[key][0].record for key in self._wire.keys(versions))

    def kept(self) -> tuple[Record, ...]:
        """All versions of all messages, in the order in which they entered."""
        with self._lock:
            return tuple(kept.record for kept in self._by_number.values())

    def header_list(self) -> bytes:
        """The headers of `records()`, 6 bytes each, as an original node wants them."""
        with self._lock:
            return self._wire.headers(self._versions)

    def wants(self, header: Header, now_s: float) -> bool:
        """Whether a message of that header would be stored, seen at Unix `now_s`."""
        return bool(self.wanted(header.pack(), now_s))

    def wanted(self, header_list: bytes, now_s: float) -> list[bytes]:
        """Those of a list of headers that are not here and would be stored, in their order.

        Of several versions of a topic only the newest. Headers with an impossible time are among
        them, and those of robots that nobody knows: whoever asks checks what comes out of here.
        `header_list` has a multiple of 6 bytes.
        """
        latest_ms = as_ms(now_s) + AHEAD_MS
        with self._lock:
            held = self._by_raw
            new = [raw for (raw,) in _RAW.iter_unpack(header_list) if raw not in held]
            if not new:
                return []
            floor_of = self._floors.get
            wanted = []
            times = _TOPIC_TIME.iter_unpack(b"".join(new))
            for raw, (key, seconds, milliseconds) in zip(new, times, strict=True):
                floor_ms = floor_of(key, -1)
                if floor_ms > latest_ms:
                    floor_ms = _today(floor_ms, latest_ms)
                seen_ms = latest_ms - (latest_ms - seconds * 1000 - milliseconds) % WRAP_MS
                if seen_ms > floor_ms or milliseconds > 999:
                    wanted.append(raw)
        if len({raw[:2] for raw in wanted}) == len(wanted):
            return wanted
        return _newest_of_each(wanted, latest_ms)

    def wants_stamp(
        self, robot_id: int, topic_id: int, stamp_ms: int, now_s: float | None = None
    ) -> bool:
        """Whether a message of that full stamp would be stored.

        With `now_s` a stored stamp that was inferred is seen with today's eyes, as `wants` does.
        """
        raw = Header.at(robot_id, topic_id, stamp_ms).pack()
        key = robot_id << 8 | topic_id
        with self._lock:
            if raw in self._by_raw:
                return False
            floor_ms = self._floors.get(key)
            if floor_ms is None:
                return True
            if now_s is not None and self._versions[key][-1].record.inferred:
                latest_ms = as_ms(now_s) + AHEAD_MS
                return _today(stamp_ms, latest_ms) > _today(floor_ms, latest_ms)
            return stamp_ms > floor_ms

    def insert(self, record: Record, now_s: float) -> bool:
        """Store a message if it is among the newest of its topic; says whether it was.

        One with a header that is already here is the same message, and not stored again.
        """
        with self._lock:
            return self._insert(record, as_ms(now_s) + AHEAD_MS)

    def since(self, sequence: int) -> list[Record]:
        """Everything kept that got a number after `sequence`, in the order of the numbers."""
        found = []
        with self._lock:
            for number, kept in reversed(self._by_number.items()):
                if number <= sequence:
                    break
                found.append(kept.record)
        found.reverse()
        return found

    def remembers(self, epoch: int, sequence: int) -> bool:
        """Whether `since(sequence)` answers a peer that learnt these numbers from us.

        Not if they are of another database, or of a later state than the one that we came back
        with, e.g. from a copy of the file.
        """
        return epoch == self.epoch and sequence <= self.sequence

    def digests(self) -> dict[int, int]:
        """For every robot id that has messages, the digest of the headers of all that is kept.

        It is the exclusive or of `digest(header)`, so the order in which they came is nothing.
        """
        with self._lock:
            return {robot_id: _xor(groups) for robot_id, groups in self._groups.items()}

    def group_digests(self, robot_id: int) -> tuple[int, ...]:
        """The same by groups of a robot's topics: GROUPS numbers."""
        with self._lock:
            return tuple(self._groups.get(robot_id) or [0] * GROUPS)

    def headers_in(self, robot_id: int, group: int) -> list[Record]:
        """All that is kept of one group of a robot's topics."""
        keys = range(robot_id << 8 | group, (robot_id + 1) << 8, GROUPS)
        with self._lock:
            return [kept.record for key in keys for kept in self._versions.get(key, ())]

    def knowledge(self, peer: str) -> Knowledge | None:
        """What we know of a peer's database, if we have ever learnt it."""
        with self._lock:
            return self._knowledge.get(peer)

    def learn(self, peer: str, knowledge: Knowledge) -> None:
        """Remember it. What it speaks of must have been inserted before."""
        with self._lock:
            self._knowledge[peer] = knowledge

    def _insert(self, record: Record, latest_ms: int) -> bool:
        header = record.header
        raw = header.pack()
        if raw in self._by_raw:
            return False
        key = header.robot_id << 8 | header.topic_id
        depth = self._history(header.robot_id, header.topic_id) if self._history else 1
        versions = self._versions.setdefault(key, [])
        place = 0
        while place < len(versions) and not _newer(record, versions[place].record, latest_ms):
            place += 1
        if place >= depth:
            return False
        self.sequence += 1
        kept = _Kept(record, raw, _rank(record, key), self.sequence)
        if place == 0:
            self._wire.changed(key, versions[0].rank if versions else None)
        versions.insert(place, kept)
        self._by_raw[raw] = self._by_number[self.sequence] = kept
        group = self._groups.setdefault(header.robot_id, [0] * GROUPS)
        group[header.topic_id % GROUPS] ^= digest(raw)
        while len(versions) > depth:
            old = versions.pop()
            del self._by_raw[old.raw], self._by_number[old.number]
            group[header.topic_id % GROUPS] ^= digest(old.raw)
        if len(versions) == depth:
            self._floors[key] = versions[-1].record.stamp_ms
        return True


class _WireOrder:
    """The newest version of every topic, sorted. Brought up to date when somebody asks."""

    def __init__(self) -> None:
        self._ranks: list[int] = []
        self._raws = bytearray()
        self._headers = b""
        self._changed: dict[int, int | None] = {}  # topic key -> its rank in the list

    def changed(self, key: int, rank: int | None) -> None:
        """A topic has another newest version; `rank` was that of the one before."""
        self._changed.setdefault(key, rank)

    def keys(self, versions: dict[int, list[_Kept]]) -> list[int]:
        """The topic keys in order."""
        self._update(versions)
        return [-rank & 0xFFFF for rank in self._ranks]

    def headers(self, versions: dict[int, list[_Kept]]) -> bytes:
        """The headers in order."""
        self._update(versions)
        return self._headers

    def _update(self, versions: dict[int, list[_Kept]]) -> None:
        if not self._changed:
            return
        if len(self._changed) > 16 + len(self._ranks) // 16:
            newest = sorted((v[0].rank, v[0].raw) for v in versions.values())
            self._ranks = [rank for rank, _ in newest]
            self._raws = bytearray(b"".join([raw for _, raw in newest]))
        else:
            for key, rank in self._changed.items():
                self._move(rank, versions[key][0])
        self._changed.clear()
        self._headers = bytes(self._raws)

    def _move(self, rank: int | None, newest: _Kept) -> None:
        if rank is not None:
            place = bisect_left(self._ranks, rank)
            del self._ranks[place], self._raws[place * Header.SIZE : (place + 1) * Header.SIZE]
        place = bisect_left(self._ranks, newest.rank)
        self._ranks.insert(place, newest.rank)
        self._raws[place * Header.SIZE : place * Header.SIZE] = newest.raw


def digest(header: bytes) -> int:
    """The number that stands for a header in digests: BLAKE2b-64 of its 6 bytes, big endian."""
    return int.from_bytes(blake2b(header, digest_size=8).digest(), "big")


def _rank(record: Record, key: int) -> int:
    """Sorts as the wire does; ends in the topic's key."""
    return -((record.priority << _STAMP_BITS | record.stamp_ms) << 16 | key)


def _xor(numbers: Iterable[int]) -> int:
    result = 0
    for number in numbers:
        result ^= number
    return result


def _newer(record: Record, stored: Record, latest_ms: int) -> bool:
    if not record.inferred and not stored.inferred:
        return record.stamp_ms > stored.stamp_ms
    return _today(record.stamp_ms, latest_ms) > _today(stored.stamp_ms, latest_ms)


def _today(stamp_ms: int, latest_ms: int) -> int:
    """A stamp from the future is seen as its header is today: our clock was set back since."""
    return min(stamp_ms, latest_ms - (latest_ms - stamp_ms) % WRAP_MS)


def _newest_of_each(headers: list[bytes], latest_ms: int) -> list[bytes]:
    best: dict[bytes, tuple[int, bytes]] = {}
    for raw in headers:
        _, seconds, milliseconds = _TOPIC_TIME.unpack(raw)
        seen_ms = latest_ms - (latest_ms - seconds * 1000 - milliseconds) % WRAP_MS
        old = best.get(raw[:2])
        if old is None or seen_ms > old[0]:
            best[raw[:2]] = (seen_ms, raw)
    return [raw for _, raw in best.values()]
