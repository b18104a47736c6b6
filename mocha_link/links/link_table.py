"""What becomes of the links: their metrics, kept from what happens on them."""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from mocha_link.clock import Instant
from mocha_link.links.metrics import (
    Contact,
    ContactBegan,
    ContactEnded,
    Direction,
    LinkEvent,
    LinkMetrics,
    LinkState,
    MessageStored,
    RssiChanged,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.links.reading import Unit, as_reading
from mocha_link.logs import NodeLog

SMOOTHING = 0.125  # weight of a new round trip in the smoothed one, as TCP has it
MAX_CONTACTS = 32
QUIET_S = 25.0  # longer than pulls are apart
LEAST_BYTES = 16 * 1024  # smaller syncs do not measure the link,
LEAST_ROUNDS = 2  # nor do those that are over in fewer round trips
STEP_S = 0.1  # by so much a clock is set at least; less is how finely it is read
REMIND_S = 600.0  # so often the log repeats that a peer has another team file


@dataclass(slots=True)
class _LinkRecord:
    """What is known of one link."""

    metrics: LinkMetrics  # without the counters here, ages, and the present contact
    bytes_in: int = 0
    bytes_out: int = 0
    refused: int = 0
    # messages and bytes since the contact before, by the names that `Contact` has for them
    exchanged: Counter[str] = field(default_factory=Counter)
    warned_s: float | None = None  # steady time when another team file was logged last
    began_s: float | None = None  # of the contact that lasts
    by_radio: bool = False  # the radio has begun it, and will end it
    active_s: float = 0.0  # Unix time of the last event

    def is_to_be_reminded(self, now: Instant) -> bool:
        """Whether the log has not had for a while that a peer does not fit; it has now."""
        recently = self.warned_s is not None and now.steady_s - self.warned_s <= REMIND_S
        if not recently:
            self.warned_s = now.steady_s
        return not recently

    def set_state(self, direction: Direction, state: LinkState, **more: Any) -> None:
        """A sync of one direction stands otherwise, and `more` of the metrics does."""
        now = self.metrics
        state_in = state if direction is Direction.IN else now.state_in
        state_out = state if direction is Direction.OUT else now.state_out
        busy = LinkState.STARTED in (state_in, state_out)
        both = LinkState.STARTED if busy else state
        self.metrics = replace(now, state=both, state_in=state_in, state_out=state_out, **more)

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
        before, self.metrics = self.metrics, self.with_contact(at_s, ending)
        if self.metrics is not before:
            self.exchanged.clear()
        self.began_s, self.by_radio = None, False

    def with_contact(self, ended_s: float | None = None, ending: str = "") -> LinkMetrics:
        """The metrics with the contact that lasts, as one that ends so.

        A try that brings nothing is none.
        """
        now, some = self.metrics, self.exchanged
        if self.began_s is None or not (self.by_radio or any(some.values())):
            return now
        messages = some["messages_in"], some["messages_out"]
        moved = some["bytes_in"], some["bytes_out"]
        contact = Contact(self.began_s, ended_s, *messages, *moved, ending)
        contacts = (*now.contacts, contact)[-MAX_CONTACTS:]
        return replace(now, contacts=contacts, contacts_begun=now.contacts_begun + 1)

    def close_if_quiet(self, now_s: float, quiet_s: float) -> None:
        """End a contact that only exchanges have shown when there are none any more."""
        idle = self.metrics.state is not LinkState.STARTED and not self.by_radio
        if idle and now_s - self.active_s > quiet_s:
            self.end(self.active_s, "quiet")


def throughput_bytes_s(size: int, taken_s: float, rtt_s: float | None) -> float | None:
    """Bytes per second that a sync moved; None if it was too small to measure."""
    if size < LEAST_BYTES or taken_s <= 0 or taken_s < LEAST_ROUNDS * (rtt_s or 0.0):
        return None
    return size / taken_s


class LinkTable:
    """Keeps the metrics of all links from events, and logs the faults of links.

    Args:
        name: the robot of the node.
        quiet_s: a contact that only exchanges have shown is over so long after the last one.
        protected: peers to which the links are encrypted.
    """

    def __init__(
        self,
        peers: Iterable[str],
        name: str = "",
        *,
        quiet_s: float = QUIET_S,
        protected: Container[str] = (),
    ) -> None:
        self._name = name
        self._links = {
            peer: _LinkRecord(LinkMetrics(peer, protected=peer in protected)) for peer in peers
        }
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
                timeouts = link.metrics.timeouts + 1
                link.set_state(event.direction, LinkState.TIMED_OUT, timeouts=timeouts)
                if link.metrics.state is not LinkState.STARTED and not link.by_radio:
                    link.end(event.at_s, "timed out")
            case RssiChanged():
                signal = event.signal or as_reading(event.rssi_dbm)
                rssi_dbm = signal.value if signal and signal.unit is Unit.DBM else None
                link.metrics = replace(link.metrics, signal=signal, rssi_dbm=rssi_dbm)
            case MessageStored():
                link.exchanged["messages_in"] += 1
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
                event = replace(event, at_s=event.at_s + step_s)  # noqa: PLW2901
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
        link = self._links[peer]
        link.bytes_in += bytes_in
        link.bytes_out += bytes_out
        link.exchanged["bytes_in"] += bytes_in
        link.exchanged["bytes_out"] += bytes_out

    def refuse(self, peer: str, reason: str) -> None:
        """Count a refusal; the first one is logged as a warning."""
        link = self._links[peer]
        level = logging.DEBUG if link.refused else logging.WARNING
        link.refused += 1
        NodeLog(self._name, peer).log(level, "refused from %s: %s", peer, reason)

    def compare_teams(self, me: str, peer: str, now: Instant, why: str | None) -> None:
        """Take in how the team file of a peer differs from that of `me`; None: it does not.

        Logged, and at times again.
        """
        link = self._links[peer]
        link.metrics = replace(link.metrics, team_differs=why is not None)
        if why is not None and link.is_to_be_reminded(now):
            NodeLog(me, peer).warning("%s: %s", me, why)

    def duplicate(self, me: str, peer: str, now: Instant, robot: str | None) -> None:
        """Take in as which robot two processes run: the peer, or `me` by the peer's report.

        None: as neither, or not any more.
        """
        link = self._links[peer]
        if link.metrics.duplicate != (robot is not None):
            link.metrics = replace(link.metrics, duplicate=robot is not None)
        if robot is not None and link.is_to_be_reminded(now):
            NodeLog(me, peer).warning(
                "%s: two processes run as %s, by their boot ids%s; end one, or give each robot its "
                "own name",
                me,
                robot,
                f" (so {peer} reports)" if robot == me else "",
            )

    def measure(
        self,
        peer: str,
        *,
        rtt_s: float | None = None,
        bandwidth_bytes_s: float | None = None,
        path: str | None = None,
    ) -> None:
        """Take in what an exchange measured; None: nothing new."""
        link, now = self._links[peer], self._links[peer].metrics
        smoothed_s = now.rtt_smoothed_s
        if rtt_s is not None:
            before_s = rtt_s if smoothed_s is None else smoothed_s
            smoothed_s = before_s + SMOOTHING * (rtt_s - before_s)
        rate = now.bandwidth_bytes_s if bandwidth_bytes_s is None else bandwidth_bytes_s
        link.metrics = replace(
            now,
            rtt_s=now.rtt_s if rtt_s is None else rtt_s,
            rtt_smoothed_s=smoothed_s,
            bandwidth_bytes_s=rate,
            path=path or now.path,
        )

    def links(
        self,
        now_s: float = -math.inf,
        ages_s: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
    ) -> dict[str, LinkMetrics]:
        """The metrics of every link.

        `now_s` ends contacts that have become quiet; `ages_s` is the age of the newest message by
        robot and topic.
        """
        found: dict[str, LinkMetrics] = {}
        for peer, link in self._links.items():
            link.close_if_quiet(now_s, self._quiet_s)
            ages = dict(ages_s.get(peer, {}))
            newest_age_s = min(ages.values(), default=None)
            found[peer] = replace(
                link.with_contact(),
                bytes_in=link.bytes_in,
                bytes_out=link.bytes_out,
                refused=link.refused,
                topic_ages_s=ages,
                newest_age_s=newest_age_s,
            )
        return found


def _ended(link: _LinkRecord, event: SyncEnded) -> None:
    link.active_s = event.at_s
    now = link.metrics
    if event.direction is Direction.OUT:
        link.exchanged["messages_out"] += event.messages
        # From the peer's first frame to its last: one round trip of that moved no data.
        moved_s = event.duration_s - (now.rtt_s or 0.0)
        rate = throughput_bytes_s(event.bytes, moved_s, now.rtt_s) or now.bandwidth_bytes_s
        link.set_state(
            event.direction,
            LinkState.ENDED,
            last_sync_out_s=event.at_s,
            syncs_out=now.syncs_out + 1,
            bandwidth_bytes_s=rate,
        )
    else:
        link.set_state(
            event.direction,
            LinkState.ENDED,
            last_sync_in_s=event.at_s,
            syncs_in=now.syncs_in + 1,
        )
