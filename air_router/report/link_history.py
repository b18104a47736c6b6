"""The links of a flight: contacts, syncs, bytes, and ages of data."""

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import accumulate
from typing import Any, Final

from air_router.gossip import ContactSpan, Interactions, Sync
from air_router.messages import MAP_TOPIC
from mocha_link.links import LinkEvent, MessageStored, RssiChanged

STAMP_S: Final = 0.0005
"""Half of a stamp's resolution: stamps are whole milliseconds."""

BINS: Final = 240
"""Number of equal time spans for the bandwidth."""

Series = Sequence[tuple[float, float]]
"""(t, value)."""


@dataclass(frozen=True, slots=True)
class LinkHistory:
    """The history of the links of a flight.

    Attributes:
        names: All robots that were sought or known to the node, in order.
        contacts, syncs: By end time.
        counts: Number of syncs started, and by outcome.
        totals: Complete and partial syncs, and their bytes.
        ages: By robot, (t, age in seconds of its newest message that we held), before and after
            each received message.
        map_shares: By robot, (t, share of the painted cells in the map that it is known to hold),
            by its reports and its fetches. A lower bound: it may have received a newer map from
            another robot since.
        signal: By robot, (t, value, unit); no value: no signal.
    """

    names: tuple[str, ...]
    contacts: tuple[ContactSpan, ...]
    syncs: tuple[Sync, ...]
    counts: Mapping[str, int]
    totals: Mapping[str, int]
    ages: Mapping[str, Series]
    map_shares: Mapping[str, Series]
    signal: Mapping[str, Sequence[tuple[float, float | None, str]]]

    def interactions(self) -> dict[str, Any]:
        """The number of syncs, and the share completed (null: none)."""
        over = len(self.syncs)
        return {
            **self.counts,
            "share_completed": self.counts["completed"] / over if over else None,
            "bytes_in": self.totals["bytes_in"],
            "bytes_out": self.totals["bytes_out"],
        }

    def of(self, robot: str) -> dict[str, Any]:
        """The data of one robot, as plain values."""
        return {
            "contacts": [asdict(c) for c in self.contacts if c.robot == robot],
            "syncs": [asdict(s) for s in self.syncs if s.robot == robot],
            "age_s": [[round(t, 3), round(age, 2)] for t, age in self.ages[robot]],
            "map_share": [[round(t, 3), round(s, 4)] for t, s in self.map_shares[robot]],
            "signal": [[round(t, 3), value, unit] for t, value, unit in self.signal[robot]],
        }

    def bandwidth(self, from_s: float, to_s: float) -> tuple[float, list[float], list[float]]:
        """Bytes per second over the flight: length of a span, and in and out per span."""
        span_s = max(1.0, (to_s - from_s) / BINS)
        count = int((to_s - from_s) / span_s) + 1
        rates = {"in": [0.0] * count, "out": [0.0] * count}
        for sync in self.syncs:
            length_s = sync.to_s - sync.from_s
            first = max(0, int((sync.from_s - from_s) / span_s))
            last = min(count - 1, int((sync.to_s - from_s) / span_s))
            for i in range(first, last + 1):
                begin_s = from_s + i * span_s
                part_s = min(sync.to_s, begin_s + span_s) - max(sync.from_s, begin_s)
                share = part_s / length_s if length_s > 0 else 1.0
                rates[sync.direction][i] += share * sync.bytes / span_s
        return span_s, rates["in"], rates["out"]


@dataclass(slots=True)
class LinkFold:
    """Folds the events of the links; `end` returns their history.

    Attributes:
        own: The UAV's name: the age of its own messages does not matter.
        sought: Robots that the mission seeks, even if they never connect.
        links: Contacts and syncs.
        published: (t, known cells) of the published versions of the map.
    """

    own: str = ""
    sought: tuple[str, ...] = ()
    links: Interactions = field(default_factory=Interactions)
    published: list[tuple[float, int]] = field(default_factory=list)
    # t, value and unit, by peer; no value: no signal
    signal: dict[str, list[tuple[float, float | None, str]]] = field(default_factory=dict)
    _newest_s: dict[str, float] = field(default_factory=dict)  # stamp, by robot
    _maps: list[float] = field(default_factory=list)  # stamps of our own maps
    _held: dict[str, list[tuple[float, float]]] = field(default_factory=dict)  # time, stamp
    _ages: dict[str, list[tuple[float, float]]] = field(default_factory=dict)  # time, age in s
    _end: tuple[float, float] | None = None  # time, Unix time of the last event

    def take(self, t: float, event: LinkEvent) -> None:
        """Handle an event; `t` is the vehicle's clock, the event's own times are Unix."""
        if not math.isfinite(event.at_s):
            return
        self._end = (t, event.at_s)
        self.links.take(t, event)
        match event:
            case MessageStored():
                self._stored(t, event)
            case RssiChanged(peer=peer, rssi_dbm=rssi_dbm, signal=signal):
                value = (rssi_dbm, "dBm") if signal is None else (signal.value, signal.unit.value)
                self.signal.setdefault(peer, []).append((t, *value))

    def holds(self, t: float, peer: str, held: list[list[Any]]) -> None:
        """Note the messages that a peer is known to hold: robot, topic, stamp."""
        for robot, topic, stamp_s in held:
            if (robot, topic) == (self.own, MAP_TOPIC):
                self._held.setdefault(peer, []).append((t, float(stamp_s)))

    def end(self, t: float, painted: Series) -> LinkHistory:
        """Finish at the end of the record; `painted`: (t, known cells of our map)."""
        self.links.end(t)
        if self._end is not None:
            received_s, unix_s = self._end
            for robot, newest_s in self._newest_s.items():
                self._ages[robot].append((t, max(0.0, unix_s + t - received_s - newest_s)))
        met = {contact.robot for contact in self.links.contacts}
        met |= {sync.robot for sync in self.links.syncs}
        names = sorted(met | self._ages.keys() | self.signal.keys() | {*self.sought})
        return LinkHistory(
            names=tuple(names),
            contacts=tuple(self.links.contacts),
            syncs=tuple(self.links.syncs),
            counts=self.links.counts(),
            totals=self.links.totals(),
            ages={name: self._ages.get(name, []) for name in names},
            map_shares={name: self._map_shares(name, painted) for name in names},
            signal={name: self.signal.get(name, []) for name in names},
        )

    def _map_shares(self, robot: str, painted: Series) -> Series:
        fetches = [
            (sync.to_s, self._published_before(sync.from_s))
            for sync in self.links.syncs
            if sync.robot == robot and sync.direction == "out" and sync.outcome == "complete"
        ]
        fetches += [(t, self._version(stamp_s)) for t, stamp_s in self._held.get(robot, [])]
        fetches.sort()
        times = [t for t, _ in fetches]
        held = [0, *accumulate((cells for _, cells in fetches), max)]
        return [
            (t, min(1.0, held[bisect_right(times, t)] / cells) if cells else 0.0)
            for t, cells in painted
        ]

    def _stored(self, t: float, event: MessageStored) -> None:
        stamp_s = event.header.stamp_s(event.at_s)
        if event.robot == self.own:
            if event.topic == MAP_TOPIC:
                self._maps.append(stamp_s)
            return
        newest_s = self._newest_s.get(event.robot)
        if newest_s is not None and stamp_s <= newest_s:
            return
        ages = self._ages.setdefault(event.robot, [])
        if newest_s is not None:
            ages.append((t, max(0.0, event.at_s - newest_s)))
        ages.append((t, max(0.0, event.at_s - stamp_s)))
        self._newest_s[event.robot] = stamp_s

    def _version(self, stamp_s: float) -> int:
        """Known cells of the map with this stamp: versions are stored in order."""
        number = min(bisect_right(self._maps, stamp_s + STAMP_S), len(self.published))
        return self.published[number - 1][1] if number else 0

    def _published_before(self, t: float) -> int:
        index = bisect_right(self.published, (t, 1 << 62))
        return self.published[index - 1][1] if index else 0
