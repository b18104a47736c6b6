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


class Saved(NamedTuple):
    """A piece of a message as it is kept on disk."""

    long: int
    total: int
    start: int
    data: bytes


class Keeper(Protocol):
    """Where parts of messages are kept over a restart."""

    def keep_part(self, part: Saved) -> None:
        """Keep another part."""

    def drop_parts(self, long: int, total: int) -> None:
        """All parts of a message need not be kept any longer."""


class Partial:
    """Some bytes of a whole of `total`, from pieces in any order, repeated or overlapping.

    Attributes:
        held: how many bytes there are.
        unsaved: the ranges that have come since somebody cleared it.
    """

    __slots__ = ("_segments", "_starts", "held", "total", "unsaved")

    def __init__(self, total: int) -> None:
        self.total = total
        self.held = 0
        self.unsaved: list[Range] = []
        self._starts: list[int] = []
        self._segments: list[bytearray | memoryview] = []

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


class Shelf:
    """The partial messages of a node, whichever peers they came from.

    A message is known by its long id (`sync.long_id`) and the size of its body. The ones that have
    not grown for longest go when all take more than `limit` bytes.

    Args:
        limit: bytes that all may take.
        keeper: where they are kept over a restart.
        saved: what it has kept, the earliest first.
    """

    def __init__(
        self,
        limit: int = _LIMIT_BYTES,
        *,
        keeper: Keeper | None = None,
        saved: Iterable[Saved] = (),
    ) -> None:
        self._limit = limit
        self._keeper = keeper
        self._partials: dict[tuple[int, int], Partial] = {}  # the latest grown last
        self._kept: set[tuple[int, int]] = set()  # of which the keeper has something
        self._cost = 0
        self._unsaved = 0
        self._saved_s: float | None = None
        for long, total, start, data in saved:
            self._kept.add((long, total))
            if self.add(long, total, start, memoryview(data)) is not None:
                self._forget((long, total))  # whole, so it has been taken or refused already
        for partial in self._partials.values():
            partial.unsaved.clear()
        self._unsaved = 0

    def __len__(self) -> int:
        return len(self._partials)

    @property
    def cost(self) -> int:
        """The memory that all take, about."""
        return self._cost

    def __iter__(self) -> Iterator[tuple[int, Partial]]:
        """Long ids and what there is of them, those of which most is there first."""
        found = sorted(self._partials.items(), key=lambda item: -item[1].held)
        return iter([(key[0], partial) for key, partial in found])

    def add(self, long: int, total: int, offset: int, data: memoryview) -> bytes | None:
        """Take in a piece within `total`; the whole body if it is complete, which then goes.

        The keeper keeps it until `drop`: it has to be safe elsewhere first.
        """
        key = (long, total)
        partial = self._partials.pop(key, None)
        if partial is None:
            partial = Partial(total)
        else:
            self._cost -= partial.cost
        self._unsaved += len(data)
        partial.add(offset, data)
        if partial.held == total:
            return partial.whole()
        self._partials[key] = partial
        self._cost += partial.cost
        while self._cost > self._limit:
            self._drop(next(iter(self._partials)))
        return None

    def save(self, now_s: float, *, at_once: bool = False) -> None:
        """Hand to the keeper what is new, if it is time (in steady seconds) or enough."""
        if self._keeper is None or not self._unsaved:
            return
        if self._saved_s is None:
            self._saved_s = now_s
        if not at_once and self._unsaved < SAVE_BYTES and now_s - self._saved_s < SAVE_S:
            return
        for (long, total), partial in self._partials.items():
            for start, end in partial.unsaved:
                self._keeper.keep_part(Saved(long, total, start, partial.read(start, end)))
                self._kept.add((long, total))
            partial.unsaved.clear()
        self._unsaved = 0
        self._saved_s = None

    def drop(self, long: int) -> None:
        """Forget a message, of whatever size."""
        if self._partials or self._kept:
            for key in [key for key in self._partials if key[0] == long]:
                self._drop(key)
            for key in [key for key in self._kept if key[0] == long]:
                self._forget(key)

    def _drop(self, key: tuple[int, int]) -> None:
        self._cost -= self._partials.pop(key).cost
        self._forget(key)

    def _forget(self, key: tuple[int, int]) -> None:
        if key in self._kept:
            self._kept.remove(key)
            if self._keeper:
                self._keeper.drop_parts(*key)
