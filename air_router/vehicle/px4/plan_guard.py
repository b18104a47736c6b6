"""Whose change of the plan on board is whose: ours, or that of another ground station.

A PX4 tells the three lists on board apart by an id each, once a second, and says the id of a list
that we have sent in its MISSION_ACK. An id that is neither the one before nor the one of our own
transfer is that of another sender. Older PX4 (before 1.15) have no ids, and tell 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

from air_router.vehicle.px4.mavlink_values import FENCE, MISSION, RALLY


class PlanIds(NamedTuple):
    """By which a PX4 distinguishes plans on board; 0: not reported, or none."""

    mission_id: int
    fence_id: int
    rally_points_id: int

    @property
    def reported(self) -> bool:
        """Whether the autopilot has ids, and a plan."""
        return any(self)


LISTS: Final = (MISSION, FENCE, RALLY)
"""The lists, in the order of their ids."""


@dataclass(slots=True)
class PlanGuard:
    """Follows the ids of one PX4.

    Attributes:
        newest: The ids as they were reported last; None before.
        changed: The lists that another sender has changed since `begin`.
    """

    newest: PlanIds | None = None
    changed: frozenset[int] = frozenset()
    _known: dict[int, int] = field(default_factory=dict)  # by list: its id; none: the next told is
    _under_way: int | None = None  # the list that we transfer
    _acknowledged: bool = False  # the autopilot has reported that it is stored
    _perhaps: dict[int, int] = field(default_factory=dict)  # by list: what a refusal named of ours

    def begin(self, known: PlanIds | None) -> None:
        """From now on what is another than this is a change; None: than what is announced next."""
        self._known = {} if known is None else dict(zip(LISTS, known, strict=True))
        self.changed = frozenset()

    def transfer_begins(self, kind: int) -> None:
        """We send a list, or clear it."""
        self._under_way, self._acknowledged = kind, False

    def stored(self, kind: int, identifier: int | None) -> None:
        """The autopilot has stored our list, under this id; None: it does not say which.

        That is addressed to us, and may be received after the transfer is known to be over:
        MAVSDK passes its own result on first.
        """
        self._acknowledged |= kind == self._under_way
        self._perhaps.pop(kind, None)
        if identifier is None:
            self._known.pop(kind, None)
        else:
            self._known[kind] = identifier

    def refused(self, kind: int, identifier: int | None) -> None:
        """The autopilot reports that it has not; where it names the list, it may have."""
        if identifier:
            self._perhaps[kind] = identifier

    def clear_refused(self, kind: int) -> None:
        """The autopilot reports that it has not cleared our list; it may be empty all the same."""
        self._perhaps[kind] = 0

    def transfer_ends(self, *, perhaps_stored: bool = False) -> None:
        """It is over; `perhaps_stored`: our list may be there, whatever was received of its id."""
        if perhaps_stored and self._under_way is not None and not self._acknowledged:
            self._known.pop(self._under_way, None)
        self._under_way = None

    def reported(self, ids: PlanIds) -> frozenset[int]:
        """The autopilot reports its ids; which lists another sender has changed since the last."""
        self.newest = ids
        found = set()
        for kind, identifier in zip(LISTS, ids, strict=True):
            if kind == self._under_way:
                continue  # the answer may be lost; PX4 takes no other list meanwhile
            if self._known.setdefault(kind, identifier) != identifier:
                self._known[kind] = identifier
                if identifier == self._perhaps.get(kind):
                    continue
                found.add(kind)
        self.changed |= found
        return frozenset(found)
