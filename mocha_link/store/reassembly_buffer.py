"""Partly received messages, kept until the rest is received: in this contact or a later one.

All memory here grows with the received bytes, never with what a peer announces. For every byte the
peer that sent it is known, and for every large message the peer that is sending it.
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
_SEGMENT_COST = 200  # approximate bytes that Python needs for a segment
_ENTRY_COST = 600  # the same for an entry
STALL_S = 2.0  # another peer may send a message of which nothing was received for this time,
SLOW_S = 5.0  # or that takes longer than this
_MAX_SENDERS = 1_024

Range = tuple[int, int]
"""The first byte, and the one after the last."""


def is_alone(data: memoryview) -> bool:
    """Whether a large piece is most of its buffer, so that keeping it keeps little else."""
    whole = len(data.obj)  # type: ignore[arg-type]
    return len(data) >= _BLOCK_BYTES and len(data) * 8 >= whole * 7


@dataclass(slots=True)
class _Segment:
    """Consecutive bytes, and the peer that sent them."""

    start: int  # offset in the whole
    data: bytearray | memoryview
    peer: str

    @property
    def end(self) -> int:
        """The offset after the last one."""
        return self.start + len(self.data)


class Fragment:
    """Part of a message, from pieces in any order, repeated or overlapping.

    Attributes:
        total: bytes of the whole message.
        held: bytes that were received.
    """

    def __init__(self, total: int) -> None:
        self.total = total
        self.held = 0
        self._segments: list[_Segment] = []  # sorted; they do not overlap

    @property
    def cost(self) -> int:
        """The approximate memory that it takes, in bytes."""
        return self.held + _ENTRY_COST + _SEGMENT_COST * len(self._segments)

    def add(self, offset: int, data: memoryview, peer: str = "") -> None:
        """Store a piece, which must be within the whole. A large one is stored without a copy."""
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
        """The whole message; None: bytes are missing."""
        complete = self.held == self.total
        return b"".join(each.data for each in self._segments) if complete else None

    def split(self) -> dict[str, Fragment]:
        """The part that each peer sent."""
        parts: dict[str, Fragment] = {}
        for each in self._segments:
            part = parts.setdefault(each.peer, Fragment(self.total))
            part.add(each.start, memoryview(each.data), each.peer)
        return parts

    def missing(self, limit: int = MAX_RANGES) -> list[Range]:
        """The missing ranges. Of more than `limit` the closest are merged."""
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


class _Sender(NamedTuple):
    """The peer that is sending a message."""

    peer: str
    began_s: float  # since when, steady seconds
    received_s: float  # when a part was received last

    def is_active(self, now_s: float) -> bool:
        """Whether it is fast enough, so that no other peer should send the message."""
        return now_s - self.received_s < STALL_S and now_s - self.began_s < SLOW_S


class ReassemblyBuffer:
    """The partial messages of a node, from all peers.

    A message is identified by its message id (`frames.message_id_of`) and the size of its body. The
    parts from all peers are combined; if the result is invalid, the part of each peer is continued
    separately. If all take more than `limit` bytes, or are too many, those that have not grown for
    longest are dropped.

    Attributes:
        cost: the approximate memory that all take, in bytes; 0: there are none.
    """

    def __init__(self, limit: int = _LIMIT_BYTES) -> None:
        self.cost = 0
        self._limit = limit
        # By message id, the last grown one last; then by size, and by the peer; "": of all peers.
        self._fragments: dict[int, dict[tuple[int, str], Fragment]] = {}
        self._senders: dict[int, _Sender] = {}  # by message id, the last active one last

    def __len__(self) -> int:
        return len(self._fragments)

    def of(self, peer: str) -> list[tuple[int, Fragment]]:
        """The ids and parts of the messages that a peer can complete.

        First those that only this peer continues, then those of which most was received.
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
        """Store a piece within `total`; returns a complete body, to be dropped or failed."""
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
        """Note that a complete message was refused; returns whether several peers sent parts of it.

        In that case the part of each peer, except `but`, is kept separately; otherwise it is
        dropped.
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
        """Drop a message, of any size."""
        self._senders.pop(message_id, None)
        self.cost -= sum(each.cost for each in self._fragments.pop(message_id, {}).values())

    def assign(self, message_id: int, peer: str, now_s: float) -> bool:
        """Note that a peer sends a message; False: another one is sending it."""
        known = self._senders.get(message_id)
        if known and known.peer != peer and known.is_active(now_s):
            return False
        began_s = known.began_s if known and known.peer == peer else now_s
        self._senders.pop(message_id, None)
        self._senders[message_id] = _Sender(peer, began_s, now_s)
        if len(self._senders) > _MAX_SENDERS:
            del self._senders[next(iter(self._senders))]
        return True

    def elsewhere(self, peer: str, now_s: float) -> set[int]:
        """The messages that other peers are sending."""
        senders = self._senders.items()
        return {number for number, by in senders if by.peer != peer and by.is_active(now_s)}

    def release(self, peer: str) -> None:
        """Note that a peer is out of reach or has ended: others may send what it was sending."""
        senders = self._senders.items()
        self._senders = {number: by for number, by in senders if by.peer != peer}
