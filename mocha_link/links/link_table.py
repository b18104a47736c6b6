"""The metrics of all links of a node, from the events on them."""

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

SMOOTHING = 0.125  # weight of a new round trip in the smoothed one, as in TCP
MAX_CONTACTS = 32
QUIET_CONTACT_S = 25.0  # a contact without a radio ends so long after its last exchange
LEAST_BYTES = 16 * 1024  # smaller syncs do not measure the rate of the link
LEAST_ROUNDS = 2  # syncs of fewer round trips do not measure it either
STEP_S = 0.1  # a smaller step of the clock is the inaccuracy of reading it
REMIND_S = 600.0  # the log repeats a fault of a peer after this time


@dataclass(slots=True)
class _LinkRecord:
    """The state of one link."""

    metrics: LinkMetrics  # without the counters below, ages, and the current contact
    bytes_in: int = 0
    bytes_out: int = 0
    refused: int = 0
    # messages and bytes since the previous contact, by their names in `Contact`
    exchanged: Counter[str] = field(default_factory=Counter)
    warned_s: float | None = None  # when a fault of the peer was logged last, steady seconds
    began_s: float | None = None  # of the current contact; None: out of contact
    by_radio: bool = False  # the radio has begun it, and will end it
    active_s: float = 0.0  # Unix time of the last event

    def warn(self, log: NodeLog, now: Instant, text: str, *values: object) -> None:
        """Log a fault of the peer as a warning, unless one was logged recently."""
        if self.warned_s is not None and now.steady_s - self.warned_s <= REMIND_S:
            return
        self.warned_s = now.steady_s
        log.warning(text, *values)

    def set_state(self, direction: Direction, state: LinkState, **more: Any) -> None:
        """Change the state of the syncs in one direction, and `more` of the metrics."""
        now = self.metrics
        state_in = state if direction is Direction.IN else now.state_in
        state_out = state if direction is Direction.OUT else now.state_out
        busy = LinkState.STARTED in (state_in, state_out)
        both = LinkState.STARTED if busy else state
        self.metrics = replace(now, state=both, state_in=state_in, state_out=state_out, **more)

    def begin(self, at_s: float, *, by_radio: bool) -> None:
        """Note that the peer is within reach."""
        self.active_s = at_s
        self.by_radio = self.by_radio or by_radio
        if self.began_s is None:
            self.began_s = at_s

    def end(self, at_s: float, ending: str) -> None:
        """End the contact: the peer is out of reach."""
        if self.began_s is not None:  # the clock may have been set back since
            self.began_s = min(self.began_s, at_s)
        before, self.metrics = self.metrics, self.with_contact(at_s, ending)
        if self.metrics is not before:
            self.exchanged.clear()
        self.began_s, self.by_radio = None, False

    def with_contact(self, ended_s: float | None = None, ending: str = "") -> LinkMetrics:
        """The metrics with the current contact, ended at that time; None: it lasts.

        Without a radio a contact counts only if anything was exchanged in it.
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
        """End a contact that no radio has reported `quiet_s` after its last exchange."""
        idle = self.metrics.state is not LinkState.STARTED and not self.by_radio
        if idle and now_s - self.active_s > quiet_s:
            self.end(self.active_s, "quiet")


def throughput_bytes_s(size: int, taken_s: float, rtt_s: float | None) -> float | None:
    """The rate of a sync in bytes/s; None if it was too small to measure the link."""
    if size < LEAST_BYTES or taken_s <= 0 or taken_s < LEAST_ROUNDS * (rtt_s or 0.0):
        return None
    return size / taken_s


class LinkTable:
    """Keeps the metrics of all links from events, and logs the faults of links.

    Args:
        name: the robot of the node.
        quiet_s: a contact that no radio has reported ends so long after its last exchange.
        protected: peers to which the links are encrypted.
    """

    def __init__(
        self,
        peers: Iterable[str],
        name: str = "",
        *,
        quiet_s: float = QUIET_CONTACT_S,
        protected: Container[str] = (),
    ) -> None:
        self._name = name
        self._links = {
            peer: _LinkRecord(LinkMetrics(peer, protected=peer in protected)) for peer in peers
        }
        self._quiet_s = quiet_s
        self._offset_s = 0.0  # Unix time minus the time of the interval timers

    def update(self, event: LinkEvent) -> None:
        """Process an event."""
        link = self._links.get(event.peer)
        if link is None:
            return  # of our own message or disk
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
                link.active_s = event.at_s  # a peer that pushes is pulled from rarely
            case ContactBegan():
                link.close_if_quiet(event.at_s, self._quiet_s)
                link.begin(event.at_s, by_radio=True)
            case ContactEnded():
                link.end(event.at_s, event.reason)

    def catch_up(self, events: Iterable[LinkEvent], now: Instant) -> None:
        """Process the latest events; the clock may have been set after some of them."""
        step_s = self.keep_clock(now)
        for event in events:
            if step_s and abs(event.at_s - now.unix_s) > abs(step_s) / 2:
                event = replace(event, at_s=event.at_s + step_s)  # noqa: PLW2901
            self.update(event)

    def keep_clock(self, now: Instant) -> float:
        """Follow a step of the clock, so that current contacts keep their duration.

        Returns the seconds by which the clock was set; 0: it was not.
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
        """Note how the team file of a peer differs from that of `me`; None: it does not.

        A difference is logged, again after `REMIND_S`.
        """
        link = self._links[peer]
        link.metrics = replace(link.metrics, team_differs=why is not None)
        if why is not None:
            link.warn(NodeLog(me, peer), now, "%s: %s", me, why)

    def duplicate(self, me: str, peer: str, now: Instant, robot: str | None) -> None:
        """Note as which robot two processes run: as the peer, or as `me` by the peer's report.

        None: as neither.
        """
        link = self._links[peer]
        if link.metrics.duplicate != (robot is not None):
            link.metrics = replace(link.metrics, duplicate=robot is not None)
        if robot is not None:
            link.warn(
                NodeLog(me, peer),
                now,
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
        """Note the measurements of an exchange; None: not measured."""
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

        Contacts that are quiet at `now_s` end. `ages_s` is the age of the newest message by robot
        and topic.
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
        # The duration is from the peer's first frame to its last: no data moved in one round trip.
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
