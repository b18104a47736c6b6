"""What becomes of the links: their metrics, kept from what happens on them."""

from __future__ import annotations

import dataclasses
import logging
from collections import deque
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field

from mocha_link.clock import Instant
from mocha_link.links.link_events import (
    ContactBegan,
    ContactEnded,
    Direction,
    LinkEvent,
    MessageStored,
    RssiChanged,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.links.metrics import Contact, LinkMetrics, LinkState
from mocha_link.links.reading import Reading, Unit, as_reading
from mocha_link.store.trust import difference

SMOOTHING = 0.125  # weight of a new round trip in the smoothed one, as TCP has it
MAX_CONTACTS = 32
QUIET_S = 25.0  # longer than pulls are apart
LEAST_BYTES = 16 * 1024  # what smaller syncs move says nothing of the link,
LEAST_ROUNDS = 2  # nor do those that are over in fewer round trips
STEP_S = 0.1  # by so much a clock is set at least; less is how finely it is read
REMIND_S = 600.0  # so often the log repeats that a peer has another team file

LOG = logging.getLogger("mocha_link")


@dataclass(slots=True)
class _Totals:
    messages_in: int = 0  # that we pulled and stored
    messages_out: int = 0  # that the peer pulled
    bytes_in: int = 0  # of replies, as the next
    bytes_out: int = 0  # of what left for the peer


@dataclass(slots=True)
class _LinkRecord:
    """All that is known of one link; `LinkMetrics` is made from it on request."""

    states: dict[Direction, LinkState] = field(  # of the latest sync
        default_factory=lambda: dict.fromkeys(Direction, LinkState.IDLE)
    )
    state: LinkState = LinkState.IDLE
    last_sync_s: dict[Direction, float] = field(default_factory=dict)  # Unix time
    # syncs ended well
    syncs: dict[Direction, int] = field(default_factory=lambda: dict.fromkeys(Direction, 0))
    timeouts: int = 0  # syncs broken off
    refused: int = 0  # headers, messages and replies that were not accepted
    rtt_s: float | None = None  # of the last sync
    rtt_smoothed_s: float | None = None  # over the last syncs
    bandwidth_bytes_s: float | None = None  # of the last sync that moved enough
    signal: Reading | None = None  # as the radio said last
    path: str | None = None  # how it was synced last
    protected: bool = False  # encrypted
    team_differs: bool = False  # its configuration hash is another
    warned_s: float | None = None  # steady time when that was logged last
    totals: _Totals = field(default_factory=_Totals)
    counted: _Totals = field(default_factory=_Totals)  # the totals when the last contact ended
    # contacts that are over
    contacts: deque[Contact] = field(default_factory=lambda: deque(maxlen=MAX_CONTACTS))
    contacts_over: int = 0  # how many contacts ended
    began_s: float | None = None  # of the contact that lasts
    by_radio: bool = False  # the radio has begun it, and will end it
    active_s: float = 0.0  # Unix time of the last event

    def set_state(self, direction: Direction, state: LinkState) -> None:
        """A sync of one direction stands otherwise."""
        self.states[direction] = state
        busy = LinkState.STARTED in self.states.values()
        self.state = LinkState.STARTED if busy else state

    def begin(self, at_s: float, *, by_radio: bool) -> None:
        """The peer is within reach."""
        self.active_s = at_s
        self.by_radio = self.by_radio or by_radio
        if self.began_s is None:
            self.began_s = at_s

    def end(self, at_s: float, ending: str) -> None:
        """The peer is out of reach."""
        if self.began_s is not None:  # the clock may have been set back since
            self.began_s = min(self.began_s, at_s)
        contact = self.contact(at_s, ending)
        if contact:
            self.contacts.append(contact)
            self.contacts_over += 1
            self.counted = dataclasses.replace(self.totals)
        self.began_s, self.by_radio = None, False

    def contact(self, ended_s: float | None = None, ending: str = "") -> Contact | None:
        """The contact that lasts, as one that ends so; a try that brings nothing is none."""
        now, before = self.totals, self.counted
        if self.began_s is None or (now == before and not self.by_radio):
            return None
        return Contact(
            began_s=self.began_s,
            ended_s=ended_s,
            messages_in=now.messages_in - before.messages_in,
            messages_out=now.messages_out - before.messages_out,
            bytes_in=now.bytes_in - before.bytes_in,
            bytes_out=now.bytes_out - before.bytes_out,
            ending=ending,
        )

    def close_if_quiet(self, now_s: float, quiet_s: float) -> None:
        """End a contact that only exchanges have shown when there are none any more."""
        idle = self.state is not LinkState.STARTED and not self.by_radio
        if idle and now_s - self.active_s > quiet_s:
            self.end(self.active_s, "quiet")

    def metrics(self, peer: str, ages_s: Mapping[str, float]) -> LinkMetrics:
        """The metrics as they stand."""
        contact, signal = self.contact(), self.signal
        return LinkMetrics(
            peer=peer,
            state=self.state,
            state_in=self.states[Direction.IN],
            state_out=self.states[Direction.OUT],
            last_sync_in_s=self.last_sync_s.get(Direction.IN),
            last_sync_out_s=self.last_sync_s.get(Direction.OUT),
            rtt_s=self.rtt_s,
            rtt_smoothed_s=self.rtt_smoothed_s,
            bandwidth_bytes_s=self.bandwidth_bytes_s,
            rssi_dbm=signal.value if signal and signal.unit is Unit.DBM else None,
            bytes_in=self.totals.bytes_in,
            bytes_out=self.totals.bytes_out,
            syncs_in=self.syncs[Direction.IN],
            syncs_out=self.syncs[Direction.OUT],
            timeouts=self.timeouts,
            refused=self.refused,
            newest_age_s=min(ages_s.values(), default=None),
            signal=signal,
            topic_ages_s=dict(ages_s),
            contacts=(*self.contacts, contact)[-MAX_CONTACTS:] if contact else tuple(self.contacts),
            contacts_begun=self.contacts_over + (contact is not None),
            path=self.path,
            protected=self.protected,
            team_differs=self.team_differs,
        )


def throughput_bytes_s(size: int, taken_s: float, rtt_s: float | None) -> float | None:
    """Bytes per second that a sync moved; None if it was too small to say."""
    if size < LEAST_BYTES or taken_s <= 0 or taken_s < LEAST_ROUNDS * (rtt_s or 0.0):
        return None
    return size / taken_s


class LinkTable:
    """Keeps the metrics of all links from what is reported to it, and logs what goes wrong on them.

    Args:
        quiet_s: a contact that only exchanges have shown is over so long after the last one.
        protected: peers to which the links are encrypted.
    """

    def __init__(
        self, peers: Iterable[str], *, quiet_s: float = QUIET_S, protected: Container[str] = ()
    ) -> None:
        self._links = {peer: _LinkRecord(protected=peer in protected) for peer in peers}  # by peer
        self._quiet_s = quiet_s
        self._offset_s = 0.0  # of Unix time from what intervals are counted in

    def update(self, event: LinkEvent) -> None:
        """Take in an event."""
        link = self._links.get(event.peer)
        if link is None:
            return  # our own message, our own disk
        match event:
            case SyncStarted():
                link.close_if_quiet(event.at_s, self._quiet_s)
                link.begin(event.at_s, by_radio=False)
                link.set_state(event.direction, LinkState.STARTED)
            case SyncEnded():
                _ended(link, event)
            case SyncTimedOut():
                link.timeouts += 1
                link.set_state(event.direction, LinkState.TIMED_OUT)
                if link.state is not LinkState.STARTED and not link.by_radio:
                    link.end(event.at_s, "timed out")
            case RssiChanged():
                link.signal = event.signal or as_reading(event.rssi_dbm)
            case MessageStored():
                link.totals.messages_in += 1
                link.active_s = event.at_s  # pushed, perhaps, by a peer that is pulled from rarely
            case ContactBegan():
                link.close_if_quiet(event.at_s, self._quiet_s)
                link.begin(event.at_s, by_radio=True)
            case ContactEnded():
                link.end(event.at_s, event.reason)

    def catch_up(self, events: Iterable[LinkEvent], now: Instant) -> None:
        """Take in events of just now, of which the clock may have been set after some."""
        step_s = self.keep_clock(now)
        for event in events:
            if step_s and abs(event.at_s - now.unix_s) > abs(step_s) / 2:
                event = dataclasses.replace(event, at_s=event.at_s + step_s)  # noqa: PLW2901
            self.update(event)

    def keep_clock(self, now: Instant) -> float:
        """Go by the clock as it is set now: contacts that last are as long as before.

        Returns the seconds by which it was set; 0: it was not.
        """
        step_s = now.unix_s - now.timer_s - self._offset_s
        if abs(step_s) < STEP_S:
            return 0.0
        self._offset_s += step_s
        for link in self._links.values():
            link.active_s += step_s
            link.began_s = None if link.began_s is None else link.began_s + step_s
        return step_s

    def count(self, peer: str, *, bytes_in: int = 0, bytes_out: int = 0) -> None:
        """Add to the counters of a link."""
        totals = self._links[peer].totals
        totals.bytes_in += bytes_in
        totals.bytes_out += bytes_out

    def refuse(self, peer: str, reason: str) -> None:
        """Something of a peer was not accepted; the log is told loudly of the first only."""
        link = self._links[peer]
        level = logging.DEBUG if link.refused else logging.WARNING
        link.refused += 1
        LOG.log(level, "refused from %s: %s", peer, reason)

    def compare_teams(self, me: str, peer: str, now: Instant, *, differs: bool) -> None:
        """Take in whether a peer has another team file than `me`; logged, and at times again."""
        link = self._links[peer]
        link.team_differs = differs
        recently = link.warned_s is not None and now.steady_s - link.warned_s <= REMIND_S
        if differs and not recently:
            link.warned_s = now.steady_s
            LOG.warning("%s: nothing is exchanged: %s", me, difference(peer))

    def measure(
        self,
        peer: str,
        *,
        rtt_s: float | None = None,
        bandwidth_bytes_s: float | None = None,
        path: str | None = None,
    ) -> None:
        """Take in what an exchange measured; None: nothing new."""
        link = self._links[peer]
        if rtt_s is not None:
            smoothed = link.rtt_smoothed_s
            link.rtt_s = rtt_s
            link.rtt_smoothed_s = (
                rtt_s if smoothed is None else smoothed + SMOOTHING * (rtt_s - smoothed)
            )
        if bandwidth_bytes_s is not None:
            link.bandwidth_bytes_s = bandwidth_bytes_s
        link.path = path or link.path

    def links(
        self,
        now_s: float | None = None,
        ages_s: Mapping[str, Mapping[str, float]] | None = None,
    ) -> dict[str, LinkMetrics]:
        """The metrics of every link.

        `now_s` ends contacts that have become quiet; `ages_s` is the age of the newest message by
        robot and topic.
        """
        if now_s is not None:
            for link in self._links.values():
                link.close_if_quiet(now_s, self._quiet_s)
        ages_s = ages_s or {}
        return {
            peer: link.metrics(peer, ages_s.get(peer, {})) for peer, link in self._links.items()
        }


def _ended(link: _LinkRecord, event: SyncEnded) -> None:
    link.active_s = event.at_s
    link.last_sync_s[event.direction] = event.at_s
    link.syncs[event.direction] += 1
    if event.direction is Direction.OUT:
        link.totals.messages_out += event.messages
        # From the peer's first word to its last: a round trip of that nothing moved.
        moved_s = event.duration_s - (link.rtt_s or 0.0)
        link.bandwidth_bytes_s = (
            throughput_bytes_s(event.bytes, moved_s, link.rtt_s) or link.bandwidth_bytes_s
        )
    link.set_state(event.direction, LinkState.ENDED)
