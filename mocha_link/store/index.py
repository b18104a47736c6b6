"""Two indexes of the database that make long header lists cheap: what is newer, and in what order.

Topics of robots are numbered here: key = robot id * 256 + topic id, as the first two bytes of a
header read.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from mocha_link.store.record import AHEAD_MS, WRAP_MS, Header, Record

KEYS = 65_536
_STAMP_BITS = 47
_UNSET_MS = 50 * 365 * 86_400_000  # a clock that says 1970 or soon after was never set
_FUTURE_MS = AHEAD_MS // 3
_TURNED_MS = WRAP_MS - 2 * AHEAD_MS


@dataclass(slots=True)
class Kept:
    """A record in the database with what is computed from it once."""

    record: Record
    raw: bytes  # its header
    rank: int  # its place in the wire order
    number: int  # in the sequence of what was stored


def rank(record: Record, key: int) -> int:
    """A number that sorts as the wire does: most urgent first, then newest first, then by key."""
    return -((record.priority << _STAMP_BITS | record.stamp_ms) << 16 | key)


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


def _turn(latest_ms: int) -> tuple[int, int]:
    """Beyond which time, and how far apart, two stamps are the other way round."""
    if latest_ms < _UNSET_MS:
        return -1, WRAP_MS // 2
    return latest_ms - AHEAD_MS + _FUTURE_MS, _TURNED_MS


class Floors:
    """For every topic the stamp that a version must exceed to be among those that are kept."""

    def __init__(self) -> None:
        self._stamps_ms = array("q", [-1]) * KEYS  # by topic key; -1: any
        self._view = np.frombuffer(self._stamps_ms, np.int64)  # the same, for numpy

    def __getitem__(self, key: int) -> int:
        return self._stamps_ms[key]

    def __setitem__(self, key: int, stamp_ms: int) -> None:
        self._stamps_ms[key] = stamp_ms

    def exceeded(self, headers: bytes, latest_ms: int) -> list[bytes]:
        """Those of the headers whose time exceeds the floor, and those whose time is impossible.

        A time is taken for the last one up to `latest_ms`.
        """
        fields = np.frombuffer(headers, ">u2").reshape(-1, 3).astype(np.int64)
        milliseconds = fields[:, 2]
        seen = latest_ms - (latest_ms - fields[:, 1] * 1000 - milliseconds) % WRAP_MS
        floors = self._view[fields[:, 0]]
        # As `follows` does.
        strange = (floors > latest_ms) | ((floors < _UNSET_MS) & (floors >= 0))
        stored = np.where(strange, latest_ms - (latest_ms - floors) % WRAP_MS, floors)
        apart = np.abs(seen - stored)
        border_ms, far_ms = _turn(latest_ms)
        turned = (np.maximum(seen, stored) > border_ms) & (floors >= 0)
        turned &= (apart >= far_ms) & (apart < WRAP_MS)
        chosen = ((seen > stored) ^ turned) | (milliseconds > 999)
        raws: list[bytes] = np.frombuffer(headers, f"V{Header.SIZE}")[chosen].tolist()
        return raws

    @staticmethod
    def newest_of_each(headers: Sequence[bytes], latest_ms: int) -> list[bytes]:
        """Of several headers of a topic only the newest, at the place of the first."""
        fields = np.frombuffer(b"".join(headers), ">u2").reshape(-1, 3).astype(np.int64)
        keys = fields[:, 0]
        if np.bincount(keys).max(initial=0) < 2:
            return list(headers)
        ages = (latest_ms - fields[:, 1] * 1000 - fields[:, 2]) % WRAP_MS
        best: dict[int, tuple[int, bytes]] = {}
        for key, age, raw in zip(keys.tolist(), ages.tolist(), headers, strict=True):
            if key not in best or age < best[key][0]:
                best[key] = (age, raw)
        return [raw for _, raw in best.values()]


class WireOrder:
    """The newest version of every topic, sorted. Brought up to date only on request."""

    def __init__(self) -> None:
        self._ranks: list[int] = []  # sorted
        self._records: list[Record] = []  # in the same order
        self._raws = bytearray()  # their headers in a row
        self._headers = b""  # copy of `_raws`
        self._changed: dict[int, int | None] = {}  # topic key -> its rank in the lists

    def changed(self, key: int, old_rank: int | None) -> None:
        """A topic has another newest version; the one before, if any, had `old_rank`."""
        self._changed.setdefault(key, old_rank)

    def records(self, versions: Mapping[int, Sequence[Kept]]) -> tuple[Record, ...]:
        """The newest records in order. `versions` by topic key, newest first."""
        self._update(versions)
        return tuple(self._records)

    def headers(self, versions: Mapping[int, Sequence[Kept]]) -> bytes:
        """Their headers in order."""
        self._update(versions)
        return self._headers

    def _update(self, versions: Mapping[int, Sequence[Kept]]) -> None:
        if not self._changed:
            return
        if len(self._changed) > 16 + len(self._ranks) // 16:
            newest = sorted((each[0] for each in versions.values()), key=attrgetter("rank"))
            self._ranks = [kept.rank for kept in newest]
            self._records = [kept.record for kept in newest]
            self._raws = bytearray(b"".join([kept.raw for kept in newest]))
        else:
            for key, old_rank in self._changed.items():
                self._move(old_rank, versions[key][0])
        self._changed.clear()
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
