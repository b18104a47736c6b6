"""The records of a database, and two indexes for long header lists: by age and by wire order.

Topics of robots are numbered here: key = robot id * 256 + topic id, as the first two bytes of a
header read.
"""

from __future__ import annotations

import struct
from array import array
from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter

from mocha_link.store.wire import AHEAD_MS, FUTURE_MS, WRAP_MS, Header

KEYS = 65_536
_UNSET_MS = 50 * 365 * 86_400_000  # a clock at 1970 or soon after was never set
_FUTURE_MS = AHEAD_MS // 3
_TURNED_MS = WRAP_MS - 2 * AHEAD_MS
_DAY_MS = 86_400_000  # more than nodes stamp beyond one another: see `Publisher`
VOID_MS = FUTURE_MS + _DAY_MS - AHEAD_MS
"""So far beyond the latest time that a header may stand for, a stamp is void."""

_LAST_MS = 999  # of a second; a header may hold more, which is no time
_FIELDS = struct.Struct(">HHH")  # of a header: key, seconds, milliseconds


@dataclass(frozen=True, slots=True)
class Record:
    """A message as it is stored and passed on: `body` is the bytes of the wire.

    `stamp_ms` is when the robot published it, Unix milliseconds below 2**47 that agree with the
    header modulo 65536 s; `received_s` is when we got or made it. `extrapolated`: the stamp
    was guessed from the header by our clock, as that of an original node has to be: if the clock
    was wrong, it is wrong by a multiple of 65536 s, and comparisons bear with that. `body` is a
    read-only view if it came in a buffer of its own.
    """

    header: Header
    priority: int  # of the topic; greater is more urgent
    body: bytes | memoryview
    stamp_ms: int
    received_s: float
    extrapolated: bool = False

    @property
    def stamp_s(self) -> float:
        """Unix seconds of publication."""
        return self.stamp_ms / 1000


@dataclass(frozen=True, slots=True)
class Knowledge:
    """What we know of a peer's database.

    Everything that it held up to its number `sequence` of its `epoch` has been offered to us. What
    we held then up to our own number `own_sequence` we reported to it, or it sent us. Each is a
    u64.
    """

    epoch: int
    sequence: int
    own_sequence: int


@dataclass(slots=True)
class Kept:
    """A record in the database with its derived values."""

    record: Record
    raw: bytes  # its header
    rank: int  # its place in the wire order
    number: int  # in the sequence of what was stored


def today(stamp_ms: int, latest_ms: int) -> int:
    """A stamp as its header is seen now, if the node that made it up had another idea of the time.

    It is from beyond `latest_ms`, because our clock was set back since, or from a clock that was
    not set at all.
    """
    if stamp_ms > latest_ms or stamp_ms < _UNSET_MS:
        return latest_ms - (latest_ms - stamp_ms) % WRAP_MS
    return stamp_ms


def follows(stamp_ms: int, stored_ms: int, latest_ms: int) -> bool:
    """Whether a stamp is newer than the stored one, where a header is all that is known of it.

    Both are seen as of now. If one of them is more than an hour in the future, a clock is wrong,
    and the border between past and future may run between the two: what seems more than 12 h older
    is newer then, and the other way round. If our clock is not set at all, the shorter way round
    the 18 h counts.
    """
    if stored_ms < 0:
        return True
    seen, stored = today(stamp_ms, latest_ms), today(stored_ms, latest_ms)
    border_ms, far_ms = _turn(latest_ms)
    turned = max(seen, stored) > border_ms and far_ms <= abs(seen - stored) < WRAP_MS
    return (seen > stored) != turned


def is_void(stored_ms: int, latest_ms: int) -> bool:
    """Whether a stored stamp is one that no node takes today: a clock was wrong by 139 years.

    Such a message gives way to any other of its topic, so a clock that is right again heals it.
    """
    return stored_ms - latest_ms >= VOID_MS


def _turn(latest_ms: int) -> tuple[int, int]:
    """Beyond which time, and how far apart, two stamps are the other way round."""
    if latest_ms < _UNSET_MS:
        return -1, WRAP_MS // 2
    return latest_ms - AHEAD_MS + _FUTURE_MS, _TURNED_MS


class Floors:
    """For every topic the stamp that a version must exceed to be among those that are kept."""

    def __init__(self) -> None:
        self.stamps_ms = array("q", [-1]) * KEYS  # by topic key; -1: any

    def exceeded(self, headers: Iterable[bytes], latest_ms: int) -> list[bytes]:
        """Those of the headers whose time exceeds the floor, and those whose time is impossible.

        A time is taken for the last one up to `latest_ms`. It decides as `follows` does, for up to
        65,536 headers in a row: that is why the same comparison stands here without calls.
        """
        floors = self.stamps_ms
        border_ms, far_ms = _turn(latest_ms)
        void_ms = latest_ms + VOID_MS
        chosen = []
        for raw in headers:
            key, seconds, milliseconds = _FIELDS.unpack(raw)
            stored = floors[key]
            if 0 <= stored < void_ms and milliseconds <= _LAST_MS:
                seen = latest_ms - (latest_ms - seconds * 1000 - milliseconds) % WRAP_MS
                if stored > latest_ms or stored < _UNSET_MS:
                    stored = latest_ms - (latest_ms - stored) % WRAP_MS
                later, apart = (seen, seen - stored) if seen > stored else (stored, stored - seen)
                turned = later > border_ms and far_ms <= apart < WRAP_MS
                if (seen > stored) == turned:
                    continue
            chosen.append(raw)
        return chosen

    @staticmethod
    def newest_of_each(headers: Sequence[bytes], latest_ms: int) -> list[bytes]:
        """Of several headers of a topic only the newest, at the place of the first."""
        if len({raw[:2] for raw in headers}) == len(headers):
            return list(headers)
        best: dict[int, tuple[int, bytes]] = {}
        for raw in headers:
            key, seconds, milliseconds = _FIELDS.unpack(raw)
            age = (latest_ms - seconds * 1000 - milliseconds) % WRAP_MS
            if key not in best or age < best[key][0]:
                best[key] = (age, raw)
        return [raw for _, raw in best.values()]


class WireOrder:
    """The newest version of every topic, sorted. Brought up to date only on request.

    Attributes:
        changed: topics that have another newest version, by key, with the rank of the one that is
            in the lists, if any is.
    """

    def __init__(self) -> None:
        self._ranks: list[int] = []  # sorted
        self._records: list[Record] = []  # in the same order
        self._raws = bytearray()  # their headers in a row
        self._headers = b""  # copy of `_raws`
        self.changed: dict[int, int | None] = {}

    def records(self, versions: Mapping[int, Sequence[Kept]]) -> tuple[Record, ...]:
        """The newest records in order. `versions` by topic key, newest first."""
        self._update(versions)
        return tuple(self._records)

    def headers(self, versions: Mapping[int, Sequence[Kept]]) -> bytes:
        """Their headers in order."""
        self._update(versions)
        return self._headers

    def _update(self, versions: Mapping[int, Sequence[Kept]]) -> None:
        if not self.changed:
            return
        if len(self.changed) > 16 + len(self._ranks) // 16:
            newest = sorted((each[0] for each in versions.values()), key=attrgetter("rank"))
            self._ranks = [kept.rank for kept in newest]
            self._records = [kept.record for kept in newest]
            self._raws = bytearray(b"".join([kept.raw for kept in newest]))
        else:
            for key, old_rank in self.changed.items():
                self._move(old_rank, versions[key][0])
        self.changed.clear()
        self._headers = bytes(self._raws)

    def _move(self, old_rank: int | None, newest: Kept) -> None:
        if old_rank is not None:
            place = bisect_left(self._ranks, old_rank)
            del self._ranks[place], self._records[place]
            del self._raws[place * Header.SIZE : (place + 1) * Header.SIZE]
        place = bisect_left(self._ranks, newest.rank)
        self._ranks.insert(place, newest.rank)
        self._records.insert(place, newest.record)
        self._raws[place * Header.SIZE : place * Header.SIZE] = newest.raw
