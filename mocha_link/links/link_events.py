"""What happens on the links, as it happens."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from mocha_link.links.reading import Reading
from mocha_link.store.wire import Header


class Direction(enum.Enum):
    """IN: we pull from the peer. OUT: the peer pulls from us."""

    IN = "in"
    OUT = "out"


@dataclass(frozen=True, slots=True)
class SyncStarted:
    """A sync began. `at_s` is Unix time on the node's clock, in every event."""

    peer: str
    at_s: float
    direction: Direction


@dataclass(frozen=True, slots=True)
class SyncEnded:
    """A sync came to its end: `messages` messages in `bytes` bytes of replies.

    `duration_s` is real time, also when the node's clock runs faster. `complete` is False if the
    contact's byte budget was used up before all was exchanged.
    """

    peer: str
    at_s: float
    direction: Direction
    messages: int
    bytes: int
    duration_s: float
    complete: bool = True


@dataclass(frozen=True, slots=True)
class SyncTimedOut:
    """A sync broke off; the messages that had arrived are kept."""

    peer: str
    at_s: float
    direction: Direction
    reason: str  # in words


@dataclass(frozen=True, slots=True)
class MessageStored:
    """A message entered the database. `peer` handed it to us (our own name: we published it).

    `robot` made it; `size` is what it takes on the wire, in bytes.
    """

    peer: str
    at_s: float
    robot: str
    topic: str
    header: Header
    size: int


@dataclass(frozen=True, slots=True)
class RssiChanged:
    """The radio hears a peer at another strength; `signal` None: not any more.

    `rssi_dbm` is the signal where it is in dBm.
    """

    peer: str
    at_s: float
    rssi_dbm: float | None
    signal: Reading | None = None


@dataclass(frozen=True, slots=True)
class ContactBegan:
    """The radio hears a peer well enough to pull from it."""

    peer: str
    at_s: float
    signal: Reading | None  # None: the contact began without one


@dataclass(frozen=True, slots=True)
class ContactEnded:
    """The radio does not hear a peer well enough any more; `duration_s` on the node's clock."""

    peer: str
    at_s: float
    duration_s: float
    reason: str  # in words


@dataclass(frozen=True, slots=True)
class StorageFailed:
    """Messages are not written to disk any more; the node goes on. `peer` is the node's robot."""

    peer: str
    at_s: float
    reason: str  # in words


@dataclass(frozen=True, slots=True)
class StorageRecovered:
    """Messages are written to disk again. `peer` is the node's own robot."""

    peer: str
    at_s: float


LinkEvent = (
    SyncStarted
    | SyncEnded
    | SyncTimedOut
    | MessageStored
    | RssiChanged
    | ContactBegan
    | ContactEnded
    | StorageFailed
    | StorageRecovered
)
