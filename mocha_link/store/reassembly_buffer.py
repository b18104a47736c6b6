"""Messages that have arrived in part, kept until the rest comes: in this contact or a later one.

Everything here grows with the bytes that came in, never with what a peer announces. Of every byte
it is known who brought it, and of every large message who is bringing it.
"""

from __future__ import annotations

import heapq
import itertools
from bisect import bisect_right
from dataclasses import dataclass
from operator import attrgetter
from typing import NamedTuple

MAX_RANGES = 16  # missing ranges in a request; more are merged

_LIMIT_BYTES = 128 * 1024 * 1024
_MAX_MESSAGES = 4_096  # every pull checks each of them when it begins
_BLOCK_BYTES = 32_768  # growing a larger block would copy it too often
MAX_SEGMENTS = 65_536  # of a message; the largest has fewer in datagrams, and begins anew with more
_SEGMENT_COST = 200  # what Python takes for a segment and for an entry, in bytes, roughly
_ENTRY_COST = 600
STALL_S = 2.0  # a peer of which nothing of a message has come for so long does not bring it,
SLOW_S = 5.0  # nor does one that has been at it for so long, if another one can
_MAX_BRINGERS = 1_024

Range = tuple[int, int]
"""First byte and the one behind the last."""


def is_alone(data: memoryview) -> bool:
    """Whether a large piece has its buffer nearly for itself: to keep it keeps not much else."""
    whole = len(data.obj)  # type: ignore[arg-type]
    return len(data) >= _BLOCK_BYTES and len(data) * 8 >= whole * 7


@dataclass(slots=True)
class _Segment:
    """Bytes in a row, and the peer that has brought them."""

    start: int  # offset in the whole
    data: bytearray | memoryview
    peer: str

    @property
    def end(self) -> int:
        """The offset behind them."""
        return self.start + len(self.data)


class Fragment:
    """Some bytes of a whole of `total`, from pieces in any order, repeated or overlapping.

    Attributes:
        held: how many bytes there are.
    """

    def __init__(self, total: int) -> None:
        self.total = total
        self.held = 0
        self._segments: list[_Segment] = []  # sorted; they do not overlap

    @property
    def cost(self) -> int:
        """The memory that it takes, about."""
        return self.held + _ENTRY_COST + _SEGMENT_COST * len(self._segments)

    def add(self, offset: int, data: memoryview, peer: str = "") -> None:
        """Store a piece, which must lie within the whole. A large one is stored without a copy."""
        segments = self._segments
        end = offset + len(data)
        place = bisect_right(segments, offset, key=attrgetter("start"))  # of the next segment
        while offset < end:
            before = segments[place - 1] if place else None
            if before and before.end > offset:
                data = data[before.end - offset :]
                offset = before.end
                continue
            piece = data
            if place < len(segments) and segments[place].start < end:
                piece = data[: segments[place].start - offset]
            last = before.data if before and (before.end, before.peer) == (offset, peer) else None
            if isinstance(last, bytearray) and len(last) < _BLOCK_BYTES:
                last += piece
            elif piece:
                if len(segments) >= MAX_SEGMENTS:
                    segments.clear()
                    self.held = place = 0
                kept = piece if is_alone(piece) else bytearray(piece)
                segments.insert(place, _Segment(offset, kept, peer))
            self.held += len(piece)
            data = data[len(piece) :]
            offset += len(piece)
            place += 1

    def whole(self) -> bytes | None:
        """All of it, if nothing is missing."""
        complete = self.held == self.total
        return b"".join(each.data for each in self._segments) if complete else None

    def split(self) -> dict[str, Fragment]:
        """What each peer has brought of it."""
        parts: dict[str, Fragment] = {}
        for each in self._segments:
            part = parts.setdefault(each.peer, Fragment(self.total))
            part.add(each.start, memoryview(each.data), each.peer)
        return parts

    def missing(self, limit: int = MAX_RANGES) -> list[Range]:
        """What has not come. Of more than `limit` ranges the closest are taken together."""
        gaps: list[Range] = []
        at = 0
        for each in self._segments:
            if each.start > at:
                gaps.append((at, each.start))
            at = each.end
        if at < self.total:
            gaps.append((at, self.total))
        if len(gaps) <= limit:
            return gaps
        between = range(1, len(gaps))
        widest = heapq.nlargest(limit - 1, between, key=lambda i: gaps[i][0] - gaps[i - 1][1])
        cuts = [0, *sorted(widest), len(gaps)]
        return [(gaps[first][0], gaps[last - 1][1]) for first, last in itertools.pairwise(cuts)]


class _Bringer(NamedTuple):
    """Who brings a message, since when, and when a part came last; steady seconds."""

    peer: str
    began_s: float
    received_s: float

    def is_at_it(self, now_s: float) -> bool:
        """Whether it is to be left to it."""
        return now_s - self.received_s < STALL_S and now_s - self.began_s < SLOW_S


class ReassemblyBuffer:
    """The partial messages of a node, whichever peers they came from.

    A message is known by its message id (`frames.message_id_of`) and the size of its body. What all
    peers bring of it is put together; if that makes a wrong one, what each has brought goes on by
    itself. Those messages that have not grown for longest go when all take more than `limit` bytes,
    or are too many.

    Attributes:
        cost: the memory that all take, about; 0: there are none.
    """

    def __init__(self, limit: int = _LIMIT_BYTES) -> None:
        self.cost = 0
        self._limit = limit
        # By message id, the latest grown last; by size and the one peer they are of, "": of any.
        self._fragments: dict[int, dict[tuple[int, str], Fragment]] = {}
        self._bringers: dict[int, _Bringer] = {}  # by message id, the last active one last

    def __len__(self) -> int:
        return len(self._fragments)

    def of(self, peer: str) -> list[tuple[int, Fragment]]:
        """Message ids and what there is of them for a peer to complete.

        First what goes on with this peer alone, then those of which most is there.
        """
        found = [
            (by == "", -fragment.held, message_id, fragment)
            for message_id, fragments in self._fragments.items()
            for (_, by), fragment in fragments.items()
            if by in ("", peer)
        ]
        found.sort(key=lambda each: each[:2])
        return [each[2:] for each in found]

    def add(
        self, message_id: int, total: int, offset: int, data: memoryview, peer: str = ""
    ) -> bytes | None:
        """Take in a piece within `total`; the whole body if it is complete: `drop` or `fail` it."""
        fragments = self._fragments[message_id] = self._fragments.pop(message_id, {})
        key = (total, peer) if (total, peer) in fragments else (total, "")
        fragment = fragments.setdefault(key, Fragment(total))
        self.cost -= fragment.cost if fragment.held else 0
        fragment.add(offset, data, peer)
        self.cost += fragment.cost
        if fragment.held == total:
            return fragment.whole()
        while self.cost > self._limit or len(self._fragments) > _MAX_MESSAGES:
            self.drop(next(iter(self._fragments)))
        return None

    def fail(self, message_id: int, but: str = "") -> bool:
        """What is complete of a message was refused; whether several peers had a part in it.

        What each of them has brought, `but` for one, is kept apart then; otherwise it goes.
        """
        several = False
        fragments = self._fragments.pop(message_id, {})
        self.cost -= sum(each.cost for each in fragments.values())
        for total, by in [key for key, each in fragments.items() if each.held == each.total]:
            parts = fragments.pop((total, by)).split()
            if len(parts) > 1:
                several = True
                fragments |= {(total, peer): parts[peer] for peer in parts if peer != but}
        self.cost += sum(each.cost for each in fragments.values())
        if fragments:
            self._fragments[message_id] = fragments
        return several

    def drop(self, message_id: int) -> None:
        """Forget a message, of whatever size."""
        self._bringers.pop(message_id, None)
        self.cost -= sum(each.cost for each in self._fragments.pop(message_id, {}).values())

    def comes_from(self, message_id: int, peer: str, now_s: float) -> bool:
        """Whether a message is to come from a peer: no other one is bringing it, so this one is."""
        known = self._bringers.get(message_id)
        if known and known.peer != peer and known.is_at_it(now_s):
            return False
        began_s = known.began_s if known and known.peer == peer else now_s
        self._bringers.pop(message_id, None)
        self._bringers[message_id] = _Bringer(peer, began_s, now_s)
        if len(self._bringers) > _MAX_BRINGERS:
            del self._bringers[next(iter(self._bringers))]
        return True

    def elsewhere(self, peer: str, now_s: float) -> set[int]:
        """The messages that other peers are bringing."""
        bringers = self._bringers.items()
        return {number for number, by in bringers if by.peer != peer and by.is_at_it(now_s)}

    def brings_no_more(self, peer: str) -> None:
        """A peer is out of reach or has ended.

        Another peer may send the messages it was sending.
        """
        bringers = self._bringers.items()
        self._bringers = {number: by for number, by in bringers if by.peer != peer}
