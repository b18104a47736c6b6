"""Messages that have arrived in part, kept until the rest comes: in this contact or a later one.

Everything here grows with the bytes that came in, never with what a peer announces. What is kept on
disk may be lost or damaged there without harm: it is asked for again, and a whole message is
checked before it is taken.
"""

from __future__ import annotations

import heapq
import itertools
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from typing import NamedTuple, Protocol

MAX_RANGES = 16  # missing ranges that are asked for; more are taken together

SAVE_BYTES = 1024 * 1024  # that came since they were saved last: save
SAVE_S = 10.0  # the same

_LIMIT_BYTES = 128 * 1024 * 1024
_BLOCK_BYTES = 32_768  # growing what is larger would copy it too often
_SEGMENT_COST = 200  # what Python takes for a segment and for an entry, in bytes, roughly
_ENTRY_COST = 600

Range = tuple[int, int]
"""First byte and the one behind the last."""


class StoredFragment(NamedTuple):
    """A piece of a message as it is kept on disk."""

    message_id: int
    total: int  # bytes of the whole body
    start: int  # offset of the piece
    data: bytes


class FragmentStore(Protocol):
    """Where parts of messages are kept over a restart."""

    def keep_part(self, part: StoredFragment) -> None:
        """Keep another part."""

    def drop_parts(self, message_id: int, total: int) -> None:
        """All parts of a message need not be kept any longer."""


class Fragment:
    """Some bytes of a whole of `total`, from pieces in any order, repeated or overlapping.

    Attributes:
        held: how many bytes there are.
        unsaved: the ranges that have come since it was cleared.
    """

    __slots__ = ("_segments", "_starts", "held", "total", "unsaved")

    def __init__(self, total: int) -> None:
        self.total = total
        self.held = 0
        self.unsaved: list[Range] = []
        self._starts: list[int] = []  # of the segments, sorted
        self._segments: list[bytearray | memoryview] = []  # that do not touch

    @property
    def cost(self) -> int:
        """The memory that it takes, about."""
        return self.held + _ENTRY_COST + _SEGMENT_COST * len(self._segments)

    def add(self, offset: int, data: memoryview) -> None:
        """Take in a piece, which must lie within the whole. A large one is kept as it is."""
        starts, segments = self._starts, self._segments
        end = offset + len(data)
        place = bisect_right(starts, offset)  # of the first segment behind the offset
        while offset < end:
            before_end = starts[place - 1] + len(segments[place - 1]) if place else -1
            if before_end > offset:
                data = data[before_end - offset :]
                offset = before_end
                continue
            upto = min(end, starts[place]) if place < len(starts) else end
            count = upto - offset
            if count:
                piece = data[:count]
                last = segments[place - 1] if before_end == offset else None
                if isinstance(last, bytearray) and len(last) < _BLOCK_BYTES:
                    last += piece
                else:
                    whole = len(piece.obj)  # type: ignore[arg-type]
                    is_alone = count >= _BLOCK_BYTES and count * 8 >= whole * 7
                    starts.insert(place, offset)
                    segments.insert(place, piece if is_alone else bytearray(piece))
                    place += 1
                self.held += count
                self._note(offset, upto)
                data = data[count:]
                offset = upto
            else:
                place += 1

    def _note(self, start: int, end: int) -> None:
        if self.unsaved and self.unsaved[-1][1] == start:
            start = self.unsaved.pop()[0]
        self.unsaved.append((start, end))

    def read(self, start: int, end: int) -> bytes:
        """Some bytes, which must be there."""
        found = []
        place = bisect_right(self._starts, start) - 1
        while start < end:
            offset = start - self._starts[place]
            piece = memoryview(self._segments[place])[offset : offset + end - start]
            found.append(piece)
            start += len(piece)
            place += 1
        return b"".join(found)

    def whole(self) -> bytes | None:
        """All of it, if nothing is missing."""
        return b"".join(self._segments) if self.held == self.total else None

    def missing(self, limit: int = MAX_RANGES) -> list[Range]:
        """What has not come. Of more than `limit` ranges the closest are taken together."""
        gaps: list[Range] = []
        at = 0
        for start, segment in zip(self._starts, self._segments, strict=True):
            if start > at:
                gaps.append((at, start))
            at = start + len(segment)
        if at < self.total:
            gaps.append((at, self.total))
        if len(gaps) <= limit:
            return gaps
        between = range(1, len(gaps))
        widest = heapq.nlargest(limit - 1, between, key=lambda i: gaps[i][0] - gaps[i - 1][1])
        cuts = [0, *sorted(widest), len(gaps)]
        return [(gaps[first][0], gaps[last - 1][1]) for first, last in itertools.pairwise(cuts)]


class ReassemblyBuffer:
    """The partial messages of a node, whichever peers they came from.

    A message is known by its message id (`frames.message_id_of`) and the size of its body. Those
    that have not grown for longest go when all take more than `limit` bytes.

    Args:
        limit: bytes that all may take.
        keeper: where they are kept over a restart.
        saved: what it has kept, the earliest first.
    """

    def __init__(
        self,
        limit: int = _LIMIT_BYTES,
        *,
        keeper: FragmentStore | None = None,
        saved: Iterable[StoredFragment] = (),
    ) -> None:
        self._limit = limit
        self._keeper = keeper
        self._fragments: dict[tuple[int, int], Fragment] = {}  # the latest grown last
        self._kept: set[tuple[int, int]] = set()  # of which the keeper has something
        self._cost = 0  # bytes held, overhead included
        self._unsaved = 0  # bytes that came since
        self._saved_s: float | None = None  # when they were saved last
        for message_id, total, start, data in saved:
            self._kept.add((message_id, total))
            if self.add(message_id, total, start, memoryview(data)) is not None:
                self._forget((message_id, total))  # whole, so it has been taken or refused already
        for fragment in self._fragments.values():
            fragment.unsaved.clear()
        self._unsaved = 0

    def __len__(self) -> int:
        return len(self._fragments)

    @property
    def cost(self) -> int:
        """The memory that all take, about."""
        return self._cost

    def __iter__(self) -> Iterator[tuple[int, Fragment]]:
        """Message ids and what there is of them, those of which most is there first."""
        found = sorted(self._fragments.items(), key=lambda item: -item[1].held)
        return iter([(key[0], fragment) for key, fragment in found])

    def add(self, message_id: int, total: int, offset: int, data: memoryview) -> bytes | None:
        """Take in a piece within `total`; the whole body if it is complete, which then goes.

        The keeper keeps it until `drop`: it has to be safe elsewhere first.
        """
        key = (message_id, total)
        fragment = self._fragments.pop(key, None)
        if fragment is None:
            fragment = Fragment(total)
        else:
            self._cost -= fragment.cost
        self._unsaved += len(data)
        fragment.add(offset, data)
        if fragment.held == total:
            return fragment.whole()
        self._fragments[key] = fragment
        self._cost += fragment.cost
        while self._cost > self._limit:
            self._drop(next(iter(self._fragments)))
        return None

    def save(self, now_s: float, *, at_once: bool = False) -> None:
        """Hand to the keeper what is new, if it is time (in steady seconds) or enough."""
        if self._keeper is None or not self._unsaved:
            return
        if self._saved_s is None:
            self._saved_s = now_s
        if not at_once and self._unsaved < SAVE_BYTES and now_s - self._saved_s < SAVE_S:
            return
        for (message_id, total), fragment in self._fragments.items():
            for start, end in fragment.unsaved:
                self._keeper.keep_part(
                    StoredFragment(message_id, total, start, fragment.read(start, end))
                )
                self._kept.add((message_id, total))
            fragment.unsaved.clear()
        self._unsaved = 0
        self._saved_s = None

    def drop(self, message_id: int) -> None:
        """Forget a message, of whatever size."""
        if self._fragments or self._kept:
            for key in [key for key in self._fragments if key[0] == message_id]:
                self._drop(key)
            for key in [key for key in self._kept if key[0] == message_id]:
                self._forget(key)

    def _drop(self, key: tuple[int, int]) -> None:
        self._cost -= self._fragments.pop(key).cost
        self._forget(key)

    def _forget(self, key: tuple[int, int]) -> None:
        if key in self._kept:
            self._kept.remove(key)
            if self._keeper:
                self._keeper.drop_parts(*key)
