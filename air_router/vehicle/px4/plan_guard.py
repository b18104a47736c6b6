"""Detects whether this program or another ground station changed the plan on board.

PX4 reports an id of each of the three lists on board once a second, and the id of a list that we
have sent in its MISSION_ACK. An id that is neither the previous one nor that of our own transfer
comes from another sender. PX4 before 1.15 has no ids and reports 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

from air_router.vehicle.px4.mavlink_values import FENCE, MISSION, RALLY


class PlanIds(NamedTuple):
    """PX4's ids of the lists on board; 0: not reported, or none."""

    mission_id: int
    fence_id: int
    rally_points_id: int

    @property
    def reported(self) -> bool:
        """Whether PX4 reports ids, and has a plan."""
        return any(self)


LISTS: Final = (MISSION, FENCE, RALLY)
"""The lists, in the order of their ids."""


@dataclass(slots=True)
class PlanGuard:
    """Tracks the ids of one PX4.

    Attributes:
        newest: The last reported ids; None before the first.
        changed: The lists that another sender has changed since `begin`.
    """

    newest: PlanIds | None = None
    changed: frozenset[int] = frozenset()
    _known: dict[int, int] = field(default_factory=dict)  # id by list; missing: the next one
    _under_way: int | None = None  # the list being transferred
    _acknowledged: bool = False  # PX4 has reported it as stored
    _perhaps: dict[int, int] = field(default_factory=dict)  # by list: our id in a refusal

    def begin(self, known: PlanIds | None) -> None:
        """Report changes relative to these ids from now on; None: to the next reported ids."""
        self._known = {} if known is None else dict(zip(LISTS, known, strict=True))
        self.changed = frozenset()

    def transfer_begins(self, kind: int) -> None:
        """This program starts to send or clear a list."""
        self._under_way, self._acknowledged = kind, False

    def stored(self, kind: int, identifier: int | None) -> None:
        """PX4 has stored our list under this id; None: not reported.

        This acknowledgement may be received after the end of the transfer, because MAVSDK reports
        its own result first.
        """
        self._acknowledged |= kind == self._under_way
        self._perhaps.pop(kind, None)
        if identifier is None:
            self._known.pop(kind, None)
        else:
            self._known[kind] = identifier

    def refused(self, kind: int, identifier: int | None) -> None:
        """PX4 has refused our list; if it reports an id, it may have stored it."""
        if identifier:
            self._perhaps[kind] = identifier

    def clear_refused(self, kind: int) -> None:
        """PX4 has refused to clear our list; it may be empty all the same."""
        self._perhaps[kind] = 0

    def transfer_ends(self, *, perhaps_stored: bool = False) -> None:
        """The transfer has ended; `perhaps_stored`: our list may be stored without a known id."""
        if perhaps_stored and self._under_way is not None and not self._acknowledged:
            self._known.pop(self._under_way, None)
        self._under_way = None

    def reported(self, ids: PlanIds) -> frozenset[int]:
        """Handle reported ids; return the lists that another sender has changed since the last."""
        self.newest = ids
        found = set()
        for kind, identifier in zip(LISTS, ids, strict=True):
            if kind == self._under_way:
                continue  # the answer may be lost; PX4 accepts no other list meanwhile
            if self._known.setdefault(kind, identifier) != identifier:
                self._known[kind] = identifier
                if identifier == self._perhaps.get(kind):
                    continue
                found.add(kind)
        self.changed |= found
        return frozenset(found)
