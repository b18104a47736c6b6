"""Messages that have arrived in part, kept until the rest comes: in this contact or a later one.

Everything here grows with the bytes that came in, never with what a peer announces.
"""

from __future__ import annotations

import heapq
import itertools
from bisect import bisect_right
from collections.abc import Iterator

MAX_RANGES = 16  # missing ranges that are asked for; more are taken together

_LIMIT_BYTES = 128 * 1024 * 1024
_BLOCK_BYTES = 32_768  # growing what is larger would copy it too often
_SEGMENT_COST = 200  # what Python takes for a segment and for an entry, in bytes, roughly
_ENTRY_COST = 600

Range = tuple[int, int]
"""First byte and the one behind the last."""


class Fragment:
    """Some bytes of a whole of `total`, from pieces in any order, repeated or overlapping.

    Attributes:
        held: how many bytes there are.
    """

    __slots__ = ("_segments", "_starts", "held", "total")

    def __init__(self, total: int) -> None:
        self.total = total
        self.held = 0
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
                data = data[count:]
                offset = upto
            else:
                place += 1

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

    Attributes:
        cost: the memory that all take, about; 0: there are none.
    """

    def __init__(self, limit: int = _LIMIT_BYTES) -> None:
        self.cost = 0
        self._limit = limit
        self._fragments: dict[tuple[int, int], Fragment] = {}  # the latest grown last

    def __len__(self) -> int:
        return len(self._fragments)

    def __iter__(self) -> Iterator[tuple[int, Fragment]]:
        """Message ids and what there is of them, those of which most is there first."""
        found = sorted(self._fragments.items(), key=lambda item: -item[1].held)
        return iter([(key[0], fragment) for key, fragment in found])

    def add(self, message_id: int, total: int, offset: int, data: memoryview) -> bytes | None:
        """Take in a piece within `total`; the whole body if it is complete, which then goes."""
        key = (message_id, total)
        fragment = self._fragments.pop(key, None) or Fragment(total)
        self.cost -= fragment.cost if fragment.held else 0
        fragment.add(offset, data)
        if fragment.held == total:
            return fragment.whole()
        self._fragments[key] = fragment
        self.cost += fragment.cost
        while self.cost > self._limit:
            self._drop(next(iter(self._fragments)))
        return None

    def drop(self, message_id: int) -> None:
        """Forget a message, of whatever size."""
        for key in [key for key in self._fragments if key[0] == message_id]:
            self._drop(key)

    def _drop(self, key: tuple[int, int]) -> None:
        self.cost -= self._fragments.pop(key).cost
