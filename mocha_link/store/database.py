"""The newest messages of every robot and topic, and what a peer still lacks of them.

In memory; `mocha_link.store.storage` keeps a copy on disk.

Two orders hold it together. Every message that enters gets the next *sequence number*, so "what
came after number n" has a short reply. And the *wire order* (most urgent first, then newest first)
is that of the header lists for original nodes.
"""

from __future__ import annotations

import secrets
import struct
import threading
from collections.abc import Mapping
from dataclasses import replace
from functools import reduce
from hashlib import blake2b
from math import isfinite
from operator import xor

from mocha_link.store.record import (
    Floors,
    Kept,
    Knowledge,
    Record,
    WireOrder,
    follows,
    is_void,
)
from mocha_link.store.storage import Storage
from mocha_link.store.storage_file import Contents
from mocha_link.store.wire import STAMPS_MS, WRAP_MS, Header, is_taken, latest_ms

GROUPS = 16
"""A robot's topics fall into so many groups, each with a digest: group = topic id % GROUPS."""

# Peers may know numbers that a crash has undone: after a restart ours go on beyond
# them, and at random, so that a file restored from a copy does not give the same ones again.
_GAP_BITS = 44
_GAP = 1 << 32
_RAW = struct.Struct(f"{Header.SIZE}s")


class Database:
    """Messages by robot and topic: the newest `history` versions of each. Any thread may use it.

    Args:
        histories: how many versions to keep, by topic key (see `Header`); 1 of those not in it.
        storage: where a copy is kept; what it has is here at once. Its owner closes it.
    """

    def __init__(
        self, histories: Mapping[int, int] | None = None, storage: Storage | None = None
    ) -> None:
        self._histories = histories or {}
        self._storage: Storage | None = None
        self._epoch = secrets.randbits(64) or 1  # random: another database has other numbers
        self._sequence = 0  # number of the newest record
        self._lock = threading.Lock()
        self._versions: dict[int, list[Kept]] = {}  # by topic key, newest first
        self._by_raw: dict[bytes, Kept] = {}  # by their headers
        self._by_number: dict[int, Kept] = {}  # in the order of the numbers
        self._floors = Floors()
        self._wire = WireOrder()
        self._groups: dict[int, list[int]] = {}  # digests by robot id
        self._knowledge: dict[str, Knowledge] = {}  # of peers' databases
        if storage:
            self._begin(storage)

    @property
    def epoch(self) -> int:
        """The name of this database, a random u64 that is not 0. A restart from a file keeps it."""
        return self._epoch

    @property
    def sequence(self) -> int:
        """The last number that was given to a message."""
        return self._sequence

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
            return self._wire.records(self._versions)

    def kept(self) -> tuple[Record, ...]:
        """All versions of all messages, in the order in which they entered."""
        with self._lock:
            return tuple(kept.record for kept in self._by_number.values())

    def header_list(self) -> bytes:
        """The headers of `records()`, 6 bytes each, as an original node wants them."""
        with self._lock:
            return self._wire.headers(self._versions)

    def snapshot(self) -> Mapping[bytes, Kept]:
        """All that is kept now, by its 6-byte header; it does not change any more."""
        with self._lock:
            return dict(self._by_raw)

    def wants(self, header: Header, now_s: float, stamp_ms: int | None = None) -> bool:
        """Whether a message of that header would be stored, seen at Unix `now_s`.

        `stamp_ms` is its time, where that is known in full.
        """
        with self._lock:
            if header.pack() in self._by_raw:
                return False
            floor_ms = self._floors.stamps_ms[header.key]
            versions, latest = self._versions.get(header.key), latest_ms(now_s)
            if versions and is_void(versions[0].record.stamp_ms, latest):
                return stamp_ms is None or is_taken(stamp_ms, now_s)
            if stamp_ms is None:
                stamp_ms = header.stamp_ms(now_s)
            elif floor_ms < 0 or not self._versions[header.key][-1].record.extrapolated:
                return stamp_ms > floor_ms
            return follows(stamp_ms, floor_ms, latest)

    def wanted(self, header_list: bytes, now_s: float) -> list[bytes]:
        """Those of a list of headers that are not here and would be stored, in their order.

        Of several versions of a topic only the newest. Headers with an impossible time are among
        them, and those of unknown robots: the caller checks what comes out of here.
        `header_list` has a multiple of 6 bytes.
        """
        latest = latest_ms(now_s)
        offered = [raw for (raw,) in _RAW.iter_unpack(header_list)]
        with self._lock:
            unknown = [raw for raw in offered if raw not in self._by_raw]
            wanted = self._floors.exceeded(unknown, latest)
        return self._floors.newest_of_each(wanted, latest)

    def insert(self, record: Record, now_s: float) -> bool:
        """Store a message if it is among the newest of its topic; whether it was.

        A message whose header is already here is the same one, and is not stored again. Refused
        is one whose stamp is not the time of its header, or whose time of reception is not finite.
        """
        header = record.header
        is_of_header = record.stamp_ms % WRAP_MS == header.seconds * 1000 + header.milliseconds
        is_time = 0 <= record.stamp_ms < STAMPS_MS and isfinite(record.received_s)
        if not (is_of_header and is_time):
            return False
        with self._lock:
            return self._keep(record, self._sequence + 1, now_s)

    def since(self, sequence: int) -> list[Record]:
        """Everything kept that got a number after `sequence`, in the order of the numbers."""
        return [record for _, record in self.numbered_since(sequence)]

    def numbered_since(self, sequence: int, limit: int | None = None) -> list[tuple[int, Record]]:
        """The same with the numbers; the first `limit` of them."""
        found = []
        with self._lock:
            for number, kept in reversed(self._by_number.items()):
                if number <= sequence:
                    break
                found.append((number, kept.record))
        found.reverse()
        return found[:limit]

    def remembers(self, epoch: int, sequence: int) -> bool:
        """Whether `since(sequence)` is valid for a peer that has these numbers from us.

        Not if they are of another database, or of a later state than the one that we came back
        with, e.g. from a copy of the file.
        """
        return epoch == self._epoch and sequence <= self._sequence

    def digests(self) -> dict[int, int]:
        """For every robot id that has messages, the digest of the headers of all that is kept.

        It is the exclusive or of `digest(header)`, so it does not matter how they came.
        """
        with self._lock:
            return {robot_id: reduce(xor, groups) for robot_id, groups in self._groups.items()}

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
        """Remember it. The messages that it covers must have been inserted before."""
        with self._lock:
            self._knowledge[peer] = knowledge
            if self._storage:
                self._storage.learn(peer, knowledge)

    def _keep(self, record: Record, number: int, now_s: float) -> bool:
        header = record.header
        raw = header.pack()
        if raw in self._by_raw:
            return False
        key = int.from_bytes(raw[:2], "big")
        versions = self._versions.get(key, [])
        depth = max(1, self._histories.get(key, 1))
        if versions and is_taken(record.stamp_ms, now_s):
            self._drop_void(key, versions, now_s)
        place = len(versions)
        while place and _newer(record, versions[place - 1].record, now_s):
            place -= 1
        if place >= depth:
            return False
        self._sequence = number
        # Sorts as the wire does: most urgent first, then newest first, then by key.
        rank = -((record.priority * STAMPS_MS + record.stamp_ms) << 16 | key)
        if place == 0:
            self._wire.changed.setdefault(key, versions[0].rank if versions else None)
        kept = Kept(record, raw, rank, number)
        versions.insert(place, kept)
        self._versions[key] = versions
        self._by_raw[raw] = self._by_number[number] = kept
        group = self._groups.setdefault(header.robot_id, [0] * GROUPS)
        group[header.topic_id % GROUPS] ^= digest(raw)
        if self._storage:
            self._storage.put(number, record)
        while len(versions) > depth:
            self._drop(versions.pop(), group)
        if len(versions) == depth:
            self._floors.stamps_ms[key] = versions[-1].record.stamp_ms
        return True

    def _drop_void(self, key: int, versions: list[Kept], now_s: float) -> None:
        """Drop what was stored under a clock that was wrong by more than a century."""
        latest, newest = latest_ms(now_s), versions[0]
        if is_void(newest.record.stamp_ms, latest):
            self._wire.changed.setdefault(key, newest.rank)
            self._floors.stamps_ms[key] = -1
            while versions and is_void(versions[0].record.stamp_ms, latest):
                self._drop(versions.pop(0), self._groups[newest.record.header.robot_id])

    def _drop(self, old: Kept, group: list[int]) -> None:
        del self._by_raw[old.raw], self._by_number[old.number]
        group[old.record.header.topic_id % GROUPS] ^= digest(old.raw)
        if self._storage:
            self._storage.drop(old.number, old.record.header.key)

    def _begin(self, storage: Storage) -> None:
        """Take the messages of the file, with their numbers if all of it could be read.

        Otherwise they are numbered anew under a new epoch: the numbers of lost messages would be
        given to others.
        """
        found = storage.load(self._epoch)
        last_s = found.last_s()
        for number, record in found.records.items():
            self._keep(record, number if found.epoch else self._sequence + 1, last_s)
        if found.epoch:
            self._epoch = found.epoch
            newest = max(found.records, default=0)
            self._sequence = newest + _GAP + secrets.randbits(_GAP_BITS)
            for peer, known in found.knowledge.items():
                # A number beyond the newest may be given to another message now.
                own_sequence = min(known.own_sequence, newest)
                self._knowledge[peer] = replace(known, own_sequence=own_sequence)
            for number in found.records.keys() - self._by_number.keys():
                key = found.records[number].header.key
                storage.drop(number, key)  # the history is shorter now
        self._storage = storage
        storage.start(self._epoch, self._reconcile)

    def _reconcile(self, found: Contents, storage: Storage) -> None:
        """Take what only the file has, and have written what only we have.

        The file was out of reach for a while, and may be another one now. Runs on its thread.
        """
        with self._lock:
            same = set()
            for number, record in found.records.items():
                kept = self._by_number.get(number)
                if kept and kept.record.header == record.header:
                    same.add(number)
                else:
                    storage.drop(number, record.header.key)
            last_s = found.last_s()
            for number, record in found.records.items():
                if number not in same:
                    self._keep(record, self._sequence + 1, last_s)
            for number, kept in self._by_number.items():
                if number not in same:
                    storage.put(number, kept.record)
            for peer, known in found.knowledge.items():
                self._knowledge.setdefault(peer, replace(known, own_sequence=0))
            for peer, known in self._knowledge.items():
                storage.learn(peer, known)


def digest(header: bytes) -> int:
    """The number that stands for a header in digests: BLAKE2b-64 of its 6 bytes, big endian."""
    return int.from_bytes(blake2b(header, digest_size=8).digest(), "big")


def _newer(record: Record, stored: Record, now_s: float) -> bool:
    if not record.extrapolated and not stored.extrapolated:
        return record.stamp_ms > stored.stamp_ms
    return follows(record.stamp_ms, stored.stamp_ms, latest_ms(now_s))
