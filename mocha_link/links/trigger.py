"""When to pull from which peer: while its signal is strong enough, or by the timer alone."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import inf

from mocha_link.links.metrics import ContactBegan, ContactEnded, RssiChanged
from mocha_link.links.reading import Reading, Unit, as_reading
from mocha_link.team import Trigger

QUIET_PULL_S = 15.0  # shortest interval of pulls from a peer that pushes its messages
FOLLOWED_PULLS_S = 5  # of all peers that push their messages, together
SILENT_INTERVALS = 3  # after a longer silence of the radio there is no signal
MAX_SOURCES = 4  # that are remembered of a peer

TOO_WEAK, NO_SIGNAL, SILENT = "too weak", "no signal", "the radio is silent"


@dataclass(slots=True)
class _Signal:
    """The reading of a peer from one source; the threshold of its unit applies."""

    reading: Reading
    reported_s: float
    in_contact: bool  # by the threshold, with hysteresis


@dataclass(slots=True)
class _Link:
    signals: dict[tuple[str, Unit], _Signal] = field(default_factory=dict)  # the last one is newest
    contact_began_s: float | None = None  # None: out of contact
    last_sync_s: float = -inf  # -inf: none in this contact
    rest_s: float = 0.0  # until the next pull, while the peer pushes
    pull_requested: bool = False  # the peer pulled, so we pull back


def threshold(settings: Trigger, unit: Unit) -> float:
    """The reading, in its unit, at which a contact begins."""
    return {
        Unit.DBM: settings.rssi_threshold_dbm,
        Unit.SNR_DB: settings.snr_threshold_db,
        Unit.DEVICE: settings.device_threshold,
    }[unit]


class SyncTrigger:
    """Decides when a sync is due: at once when a contact begins, then every interval.

    The trigger pulls ever less often from peers that push, and less where there are many of them:
    nodes must not spend their time on pulls without result. If a peer pulls after a while the
    trigger pulls from it too: it may have been away.

    A contact begins when the reading of any source reaches the threshold of its unit, and
    ends when every reading is below threshold minus hysteresis, or absent.
    Readings of different sources are never compared. With `by_timer` every peer is due every
    interval (a robot without a radio that reports). All times are seconds of one clock.
    """

    def __init__(self, peers: Iterable[str], settings: Trigger, *, by_timer: bool) -> None:
        self._settings = settings
        self._by_timer = by_timer
        self._links = {peer: _Link() for peer in peers}  # by peer
        self._events: list[RssiChanged | ContactBegan | ContactEnded] = []  # to be fetched
        self._followed: frozenset[str] = frozenset()  # peers that push what they store
        self._checked_s = inf  # when it was seen last who is due
        # By peer, to keep a turn of a node short: when it is due (-inf: now, inf: not
        # by time), and when its oldest reading does not stand any more.
        self._pulls_s: dict[str, float] = {}
        self._silences_s: dict[str, float] = {}
        for peer in self._links:
            self._schedule(peer)

    def signal_received(self, peer: str, reading: Reading | float | None, now_s: float) -> bool:
        """Process a report of the radio; whether a contact begins with it.

        None: no source has a signal of the peer. A bare number is in dBm; RadioError if it
        cannot be.
        """
        link, before = self._links[peer], self.reading(peer)
        reading = as_reading(reading)
        if reading is None:
            link.signals.clear()
        else:
            self._note(link, reading, now_s)
        if self.reading(peer) != before:
            self._signal_changed(peer, now_s)
        begins = self._judge(peer, link, now_s, NO_SIGNAL if reading is None else TOO_WEAK)
        self._schedule(peer)
        return begins

    def reading(self, peer: str) -> Reading | None:
        """The newest reading of a peer that still stands."""
        signals = self._links[peer].signals
        return next(reversed(signals.values())).reading if signals else None

    def expire_signals(self, now_s: float) -> None:
        """Expire the signals of peers that the radio has not reported for too long."""
        if not self._may_be_due(now_s):
            return
        limit_s = SILENT_INTERVALS * self._settings.interval_s
        reporting = [(peer, link) for peer, link in self._links.items() if link.signals]
        for peer, link in reporting:
            for key, signal in list(link.signals.items()):
                signal.reported_s = min(signal.reported_s, now_s)  # the clock may be set back
                if now_s - signal.reported_s > limit_s:
                    del link.signals[key]
            if not link.signals:
                self._signal_changed(peer, now_s)
        for peer, link in reporting:
            self._judge(peer, link, now_s, SILENT)
            self._schedule(peer)

    def follow(self, peers: Iterable[str]) -> None:
        """These push what they store, and no others."""
        self._followed = frozenset(peers)
        for peer in self._links:
            self._schedule(peer)

    def peer_pulled(self, peer: str, now_s: float, *, restarted: bool = False) -> None:
        """A peer pulls from us: pull as well.

        Not if it was pulled from just now, unless it has `restarted` since.
        """
        link = self._links[peer]
        latest_s = now_s if restarted else now_s - self._settings.interval_s
        if -inf < link.last_sync_s <= latest_s:
            link.pull_requested = True
            self._schedule(peer)

    def due(self, now_s: float) -> list[str]:
        """The peers to pull from now; each counts as pulled from by this call."""
        if not self._may_be_due(now_s):
            return []
        due = [
            peer
            for peer, at_s in self._pulls_s.items()
            if at_s <= now_s or (at_s < inf and now_s < self._links[peer].last_sync_s)
        ]
        for peer in due:
            link = self._links[peer]
            quiet = peer in self._followed and link.last_sync_s > -inf
            link.rest_s = min(2 * self._interval_s(peer), QUIET_PULL_S) if quiet else 0.0
            link.last_sync_s, link.pull_requested = now_s, False
            self._schedule(peer)
        self._checked_s = now_s
        return due

    @property
    def due_s(self) -> float:
        """When `due` or `expire_signals` has a result; inf: not by time."""
        pull_s = min(self._pulls_s.values(), default=inf)
        return min(pull_s, min(self._silences_s.values(), default=inf))

    def _may_be_due(self, now_s: float) -> bool:
        """A clock that was set back must not stop the syncs until it comes round again."""
        return not self._checked_s <= now_s < self.due_s

    def _schedule(self, peer: str) -> None:
        """Note when something is due of a peer of which something has changed."""
        link = self._links[peer]
        due_s = inf
        if link.contact_began_s is not None or self._by_timer:
            due_s = link.last_sync_s + self._interval_s(peer)
            due_s = -inf if link.pull_requested else due_s
        self._pulls_s[peer] = due_s
        if link.signals:
            oldest_s = min(signal.reported_s for signal in link.signals.values())
            self._silences_s[peer] = oldest_s + SILENT_INTERVALS * self._settings.interval_s
        else:
            self._silences_s.pop(peer, None)

    def _interval_s(self, peer: str) -> float:
        interval_s = self._settings.interval_s
        if peer not in self._followed:
            return interval_s
        return max(interval_s, self._links[peer].rest_s, len(self._followed) / FOLLOWED_PULLS_S)

    def take_events(self) -> list[RssiChanged | ContactBegan | ContactEnded]:
        """The signals that changed, the contacts that began and ended since the last call."""
        events, self._events = self._events, []
        return events

    def _note(self, link: _Link, reading: Reading, now_s: float) -> None:
        """Store a reading of a peer."""
        key = reading.source, reading.unit
        before = link.signals.pop(key, None)
        if before is None and len(link.signals) >= MAX_SOURCES:
            del link.signals[next(iter(link.signals))]
        limit = threshold(self._settings, reading.unit)
        if before and before.in_contact:
            limit -= self._settings.hysteresis_db
        link.signals[key] = _Signal(reading, now_s, reading.value >= limit)

    def _signal_changed(self, peer: str, now_s: float) -> None:
        reading = self.reading(peer)
        rssi_dbm = reading.value if reading and reading.unit is Unit.DBM else None
        self._events.append(RssiChanged(peer, now_s, rssi_dbm, reading))

    def _judge(self, peer: str, link: _Link, now_s: float, why: str) -> bool:
        """Begin or end the contact by the signals; True if it begins."""
        in_contact = any(signal.in_contact for signal in link.signals.values())
        if in_contact and link.contact_began_s is None:
            link.contact_began_s, link.last_sync_s = now_s, -inf
            self._events.append(ContactBegan(peer, now_s, self.reading(peer)))
            return True
        if not in_contact and link.contact_began_s is not None:
            lasted_s = max(0.0, now_s - link.contact_began_s)
            link.contact_began_s = None
            self._events.append(ContactEnded(peer, now_s, lasted_s, why))
        return False
