"""What happens on the links: events as they happen, and the state of each link at any time."""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

from mocha_link.header import Header

SMOOTHING = 0.125  # weight of a new round trip in the smoothed one, as TCP has it


class Direction(enum.Enum):
    """IN: we pull from the peer. OUT: the peer pulls from us."""

    IN = "in"
    OUT = "out"


class LinkState(enum.Enum):
    """How the latest sync of a link stands."""

    IDLE = "idle"
    STARTED = "started"
    ENDED = "ended"
    TIMED_OUT = "timed_out"


@dataclass(frozen=True, slots=True)
class SyncStarted:
    """A sync began. `at_s` is Unix time on the node's clock, in every event."""

    peer: str
    at_s: float
    direction: Direction


@dataclass(frozen=True, slots=True)
class SyncEnded:
    """A sync is complete: `messages` messages in `bytes` bytes of replies.

    `duration_s` is real time, also when the node's clock runs faster.
    """

    peer: str
    at_s: float
    direction: Direction
    messages: int
    bytes: int
    duration_s: float


@dataclass(frozen=True, slots=True)
class SyncTimedOut:
    """A sync broke off; the messages that had arrived are kept."""

    peer: str
    at_s: float
    direction: Direction
    reason: str


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
    """The radio hears a peer at another strength; None: not any more."""

    peer: str
    at_s: float
    rssi_dbm: float | None


LinkEvent = SyncStarted | SyncEnded | SyncTimedOut | MessageStored | RssiChanged


@dataclass(frozen=True, slots=True)
class LinkMetrics:
    """The link to one peer. Times are Unix seconds of the node's clock.

    Attributes:
        state: of the latest sync in either direction; STARTED while one is under way.
        state_in: of our latest pull from the peer.
        state_out: of the peer's latest pull from us.
        last_sync_in_s: when our last complete pull ended.
        last_sync_out_s: when the peer's last complete pull ended.
        rtt_s: last round trip of a small request on a standing connection (real seconds).
        rtt_smoothed_s: the same, smoothed as TCP does.
        bandwidth_bytes_s: what the last pull with any message moved per real second.
        rssi_dbm: as the radio says; None if it does not hear the peer.
        bytes_in: bytes of replies received, complete pulls or not.
        bytes_out: bytes of replies sent.
        syncs_in: complete pulls of ours.
        syncs_out: complete pulls of the peer.
        timeouts: syncs of both directions that broke off.
        refused: headers, messages and replies of the peer that were not accepted.
        newest_age_s: age of the newest message that the peer itself made and we hold.
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


class LinkBook:
    """Keeps the metrics of all links from what is reported to it."""

    def __init__(self, peers: tuple[str, ...]) -> None:
        self._links = {peer: LinkMetrics(peer) for peer in peers}

    def note(self, event: LinkEvent) -> None:
        """Take in an event."""
        if event.peer not in self._links:
            return  # our own message
        link = self._links[event.peer]
        match event:
            case SyncStarted():
                link = _with_state(link, event.direction, LinkState.STARTED)
            case SyncEnded(direction=Direction.IN):
                link = replace(link, last_sync_in_s=event.at_s, syncs_in=link.syncs_in + 1)
                link = _with_state(link, event.direction, LinkState.ENDED)
            case SyncEnded():
                link = replace(link, last_sync_out_s=event.at_s, syncs_out=link.syncs_out + 1)
                link = _with_state(link, event.direction, LinkState.ENDED)
            case SyncTimedOut():
                link = replace(link, timeouts=link.timeouts + 1)
                link = _with_state(link, event.direction, LinkState.TIMED_OUT)
            case RssiChanged():
                link = replace(link, rssi_dbm=event.rssi_dbm)
            case MessageStored():
                pass
        self._links[event.peer] = link

    def count(self, peer: str, *, bytes_in: int = 0, bytes_out: int = 0, refused: int = 0) -> None:
        """Add to the counters of a link."""
        link = self._links[peer]
        self._links[peer] = replace(
            link,
            bytes_in=link.bytes_in + bytes_in,
            bytes_out=link.bytes_out + bytes_out,
            refused=link.refused + refused,
        )

    def measure(self, peer: str, *, rtt_s: float | None, bandwidth_bytes_s: float | None) -> None:
        """Take in what a pull measured."""
        link = self._links[peer]
        if rtt_s is not None:
            smoothed = link.rtt_smoothed_s
            smoothed = rtt_s if smoothed is None else smoothed + SMOOTHING * (rtt_s - smoothed)
            link = replace(link, rtt_s=rtt_s, rtt_smoothed_s=smoothed)
        if bandwidth_bytes_s is not None:
            link = replace(link, bandwidth_bytes_s=bandwidth_bytes_s)
        self._links[peer] = link

    def links(self) -> dict[str, LinkMetrics]:
        """The metrics of every link."""
        return dict(self._links)


def _with_state(link: LinkMetrics, direction: Direction, state: LinkState) -> LinkMetrics:
    if direction is Direction.IN:
        link = replace(link, state_in=state)
    else:
        link = replace(link, state_out=state)
    busy = LinkState.STARTED in (link.state_in, link.state_out)
    return replace(link, state=LinkState.STARTED if busy else state)
