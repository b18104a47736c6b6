"""The events and the metrics of links, as programs receive them."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field

from mocha_link.links.reading import Reading
from mocha_link.store import Header


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
    """A sync ended: `messages` messages in `bytes` bytes of replies.

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
    """A sync was aborted; the messages received until then are kept."""

    peer: str
    at_s: float
    direction: Direction
    reason: str  # for the operator


@dataclass(frozen=True, slots=True)
class MessageStored:
    """A message was stored. It was received from `peer`; our own name: we published it.

    `robot` published it first; `size` is its size on the wire, in bytes.
    """

    peer: str
    at_s: float
    robot: str
    topic: str
    header: Header
    size: int


@dataclass(frozen=True, slots=True)
class RssiChanged:
    """The signal of a peer changed; `signal` None: the radio lost it.

    `rssi_dbm` is the signal where it is in dBm.
    """

    peer: str
    at_s: float
    rssi_dbm: float | None
    signal: Reading | None = None


@dataclass(frozen=True, slots=True)
class ContactBegan:
    """The signal of a peer became strong enough to pull from it."""

    peer: str
    at_s: float
    signal: Reading | None  # None: the contact began without one


@dataclass(frozen=True, slots=True)
class ContactEnded:
    """The signal of a peer became too weak; `duration_s` on the node's clock."""

    peer: str
    at_s: float
    duration_s: float
    reason: str  # for the operator


@dataclass(frozen=True, slots=True)
class StorageFailed:
    """Messages are not written to disk any more; the node goes on. `peer` is the node's robot."""

    peer: str
    at_s: float
    reason: str  # for the operator


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


class LinkState(enum.Enum):
    """The state of the latest sync of a link."""

    IDLE = "idle"
    STARTED = "started"
    ENDED = "ended"
    TIMED_OUT = "timed_out"


@dataclass(frozen=True, slots=True)
class Contact:
    """A period in which a peer was within reach, and what was exchanged in it.

    Attributes:
        began_s: when the signal became strong enough, or the first sync without such a signal.
        ended_s: when it ended; None: it lasts.
        messages_in: messages received from the peer.
        messages_out: messages in the syncs that the peer completed.
        bytes_in: bytes of replies received since the previous contact.
        bytes_out: bytes of replies sent since the previous contact.
        ending: how it ended: "too weak", "no signal", "the radio is silent" (by the
            radio), "timed out" (a sync was aborted), "quiet" (no more syncs); empty: it lasts.
    """

    began_s: float
    ended_s: float | None
    messages_in: int
    messages_out: int
    bytes_in: int
    bytes_out: int
    ending: str


@dataclass(frozen=True, slots=True)
class LinkMetrics:
    """The link to one peer. Times are Unix seconds of the node's clock.

    Attributes:
        state: of the latest sync in either direction; STARTED while one is under way.
        state_in: of our latest pull from the peer.
        state_out: of the peer's latest pull from us.
        last_sync_in_s: when our last pull ended.
        last_sync_out_s: when the peer's last pull ended.
        rtt_s: round trip of the connection in real seconds, without the time a node takes to reply:
            the lowest that the kernel has measured recently (TCP, on Linux), or of our packets
            (UDP).
        rtt_smoothed_s: the same, smoothed over syncs.
        bandwidth_bytes_s: rate of the last sync, in either direction, that had at least 16 KiB and
            took two round trips; per real second.
        rssi_dbm: `signal` where that is in dBm.
        bytes_in: bytes of replies received, also in pulls that were aborted.
        bytes_out: bytes of replies sent.
        syncs_in: pulls of ours that ended.
        syncs_out: pulls of the peer that ended.
        timeouts: syncs of both directions that were aborted.
        refused: headers, messages, requests and replies of the peer that were refused, and
            connections to the port for it.
        newest_age_s: age of the newest message that the peer itself published and we hold; if its
            stamp is in the future, since it was received.
        signal: the reading of the radio, with unit and source; None: no signal.
        topic_ages_s: age of the newest message of each topic of the peer that we hold.
        contacts: the last 32 contacts, oldest first; one that lasts has no end.
        contacts_begun: the number of contacts so far.
        path: the path of the last exchange: "zmq", "udp", or "original" (an original node).
        team_differs: the peer's team file assigns ids differently, by its latest report; the
            nodes exchange only topics that both define alike.
        duplicate: two processes run as the peer, or as this robot, by their boot ids.
        protected: whether the link is encrypted and its ends are known by their keys.
    """

    peer: str
    state: LinkState = LinkState.IDLE
    state_in: LinkState = LinkState.IDLE
    state_out: LinkState = LinkState.IDLE
    last_sync_in_s: float | None = None
    last_sync_out_s: float | None = None
    rtt_s: float | None = None
    rtt_smoothed_s: float | None = None
    bandwidth_bytes_s: float | None = None
    rssi_dbm: float | None = None
    bytes_in: int = 0
    bytes_out: int = 0
    syncs_in: int = 0
    syncs_out: int = 0
    timeouts: int = 0
    refused: int = 0
    newest_age_s: float | None = None
    signal: Reading | None = None
    topic_ages_s: Mapping[str, float] = field(default_factory=dict, hash=False)
    contacts: tuple[Contact, ...] = ()
    contacts_begun: int = 0
    path: str | None = None
    protected: bool = False
    team_differs: bool = False
    duplicate: bool = False
