"""What a database holds, and which of two messages is the newer one."""

from __future__ import annotations

from dataclasses import dataclass

from mocha_link.store.wire import AHEAD_MS, WRAP_MS, Header

_UNSET_MS = 50 * 365 * 86_400_000  # a clock that says 1970 or soon after was never set
_FUTURE_MS = AHEAD_MS // 3
_TURNED_MS = WRAP_MS - 2 * AHEAD_MS


@dataclass(frozen=True, slots=True)
class Record:
    """A message as it is stored and passed on: `body` is what the wire carries, untouched.

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
    we held then up to our own number `own_sequence` it was told, or gave us itself. Each is a u64.
    """

    epoch: int
    sequence: int
    own_sequence: int


@dataclass(slots=True)
class Kept:
    """A record in the database with what is computed from it once."""

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
    seen, stored = today(stamp_ms, latest_ms), today(stored_ms, latest_ms)
    border_ms, far_ms = latest_ms - AHEAD_MS + _FUTURE_MS, _TURNED_MS
    if latest_ms < _UNSET_MS:
        border_ms, far_ms = -1, WRAP_MS // 2
    turned = max(seen, stored) > border_ms and far_ms <= abs(seen - stored) < WRAP_MS
    return (seen > stored) != turned
