"""Contacts and syncs of a flight, collected for its page, its result and its report."""

from collections import Counter
from dataclasses import dataclass, field

from mocha_link.links import (
    ContactBegan,
    ContactEnded,
    Direction,
    LinkEvent,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)


@dataclass(frozen=True, slots=True)
class ContactSpan:
    """A time span with a usable link to a robot."""

    robot: str
    from_s: float  # on the vehicle's clock
    to_s: float


@dataclass(frozen=True, slots=True)
class Sync:
    """One pull, ours ("in") or the robot's ("out"); `outcome`: complete, partial or broken off."""

    robot: str
    direction: str  # "in" or "out"
    from_s: float  # on the vehicle's clock
    to_s: float
    bytes: int  # of replies
    messages: int
    outcome: str


@dataclass(slots=True)
class Interactions:
    """Collects contacts, and syncs by outcome."""

    contacts: list[ContactSpan] = field(default_factory=list)  # by end time
    syncs: list[Sync] = field(default_factory=list)  # by end time
    begun: Counter[str] = field(default_factory=Counter)  # syncs by robot; some never ended
    synced_s: dict[str, float] = field(default_factory=dict)  # last complete sync, by robot
    moved: Counter[str] = field(default_factory=Counter)  # bytes in syncs, by robot
    _near: dict[str, float] = field(default_factory=dict)  # begin of current contacts
    _parted: dict[str, float] = field(default_factory=dict)  # end of the last contact
    _open: dict[tuple[str, Direction], float] = field(default_factory=dict)  # current syncs

    def take(self, t: float, event: LinkEvent) -> None:
        """Handle an event; `t` is the vehicle's clock."""
        match event:
            case ContactBegan(peer=peer):
                self._near.setdefault(peer, t)
            case ContactEnded(peer=peer):
                self._part(peer, t)
            case SyncStarted(peer=peer, direction=direction):
                self.begun[peer] += 1
                self._open[peer, direction] = t
            case SyncEnded(peer=peer, direction=direction):
                began_s = self._open.pop((peer, direction), t)
                size, outcome = event.bytes, "complete" if event.complete else "partial"
                ended = Sync(peer, direction.value, began_s, t, size, event.messages, outcome)
                self.syncs.append(ended)
                self.synced_s[peer] = t
                self.moved[peer] += event.bytes
            case SyncTimedOut(peer=peer, direction=direction):
                began_s = self._open.pop((peer, direction), t)
                parted_s = self._parted.get(peer, t)
                # Perhaps detected long after the robot left radio range.
                t = parted_s if began_s <= parted_s < t else t
                self.syncs.append(Sync(peer, direction.value, began_s, t, 0, 0, "broken off"))

    @property
    def busy(self) -> set[str]:
        """The robots with a sync in progress."""
        return {peer for peer, _ in self._open}

    def end(self, t: float) -> None:
        """End of the flight: current contacts end here."""
        for peer in list(self._near):
            self._part(peer, t)

    def counts(self) -> dict[str, int]:
        """The number of syncs started, and by outcome."""
        outcomes = Counter(sync.outcome for sync in self.syncs)
        words = {"completed": "complete", "partial": "partial", "timed_out": "broken off"}
        return {
            "started": self.begun.total(),
            **{key: outcomes[outcome] for key, outcome in words.items()},
        }

    def totals(self, robot: str | None = None) -> dict[str, int]:
        """Complete and partial syncs with their bytes, of one robot or of all."""
        totals = dict.fromkeys(("syncs_in", "syncs_out", "bytes_in", "bytes_out"), 0)
        for sync in self.syncs:
            if robot in (None, sync.robot) and sync.outcome != "broken off":
                totals[f"syncs_{sync.direction}"] += 1
                totals[f"bytes_{sync.direction}"] += sync.bytes
        return totals

    def _part(self, peer: str, t: float) -> None:
        began_s = self._near.pop(peer, None)
        self._parted[peer] = t
        if began_s is not None:
            self.contacts.append(ContactSpan(peer, began_s, t))
