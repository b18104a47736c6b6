"""When to pull from whom: while the radio hears the peer well enough, or by the timer alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from mocha_link.team import Trigger

SILENT_INTERVALS = 3  # a radio that says nothing for longer does not hear the peer


@dataclass(slots=True)
class _Link:
    rssi_dbm: float | None = None
    reported_s: float = 0.0
    in_contact: bool = False
    last_sync_s: float | None = None


class SyncTrigger:
    """Says when a sync is due: at once when a contact begins, then every interval.

    A contact begins at the RSSI threshold and ends below threshold minus hysteresis. With
    `by_timer` every peer counts as in contact (a robot without a radio that reports). All times
    are Unix seconds of the node's clock.
    """

    def __init__(self, peers: Iterable[str], settings: Trigger, *, by_timer: bool) -> None:
        self._settings = settings
        self._by_timer = by_timer
        self._links = {peer: _Link() for peer in peers}

    def heard(self, peer: str, rssi_dbm: float | None, now_s: float) -> bool:
        """Take in a report of the radio (None: not heard); says whether contact begins with it."""
        link, settings = self._links[peer], self._settings
        link.rssi_dbm, link.reported_s = rssi_dbm, now_s
        limit = settings.rssi_threshold_dbm - (settings.hysteresis_db if link.in_contact else 0)
        before, link.in_contact = link.in_contact, rssi_dbm is not None and rssi_dbm >= limit
        begins = link.in_contact and not before
        if begins:
            link.last_sync_s = None
        return begins

    def rssi_dbm(self, peer: str) -> float | None:
        """The last report about a peer."""
        return self._links[peer].rssi_dbm

    def silenced(self, now_s: float) -> list[str]:
        """The peers about whom the radio has been silent for too long: not heard any more."""
        silent = []
        limit_s = SILENT_INTERVALS * self._settings.interval_s
        for peer, link in self._links.items():
            link.reported_s = min(link.reported_s, now_s)  # the clock may have been set back
            if link.rssi_dbm is not None and now_s - link.reported_s > limit_s:
                self.heard(peer, None, now_s)
                silent.append(peer)
        return silent

    def due(self, now_s: float) -> list[str]:
        """The peers to pull from now; each counts as pulled from by this answer."""
        due = []
        for peer, link in self._links.items():
            if not (link.in_contact or self._by_timer):
                continue
            last = link.last_sync_s
            # A clock that was set back must not stop the syncs until it comes round again.
            if last is None or not 0 <= now_s - last < self._settings.interval_s:
                link.last_sync_s = now_s
                due.append(peer)
        return due
