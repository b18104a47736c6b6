"""The plan on board: mission, fence and rally points, shared by all MAVLink links."""

from __future__ import annotations

from typing import Final

from sitl.px4sim.plan.mission_items import MissionItem, MissionType

CAPACITY: Final = {
    MissionType.MISSION: 10000,
    MissionType.FENCE: 64,
    MissionType.RALLY: 32,
}
"""PX4's space (SITL build of 1.17); a real flight controller has room for 500 mission items."""


class PlanStore:
    """What is stored, and what changed.

    Attributes:
        current: The mission item that was last set from outside; None after an upload in which
            no item was marked as current: PX4 then keeps the index that it has.
        active: The item that is flown, as the autopilot tells.
        revision: Counts the changes of mission, current item, fence and rally points.
        transferring: Whether an upload is under way on any link.
    """

    def __init__(self) -> None:
        self._items: dict[MissionType, tuple[MissionItem, ...]] = dict.fromkeys(CAPACITY, ())
        self._ids: dict[MissionType, int] = dict.fromkeys(CAPACITY, 0)  # checksums
        self.current: int | None = 0
        self.active = 0
        self.revision = 0
        self.transferring = False

    def items(self, kind: MissionType) -> tuple[MissionItem, ...]:
        """The stored items of one kind."""
        return self._items[kind]

    def identifier(self, kind: MissionType) -> int:
        """The checksum that MISSION_CURRENT and MISSION_ACK name the plan by; 0 when empty."""
        return self._ids[kind]

    def store(
        self,
        kind: MissionType,
        items: tuple[MissionItem, ...],
        identifier: int,
        current: int | None,
    ) -> None:
        """Replace one kind; the very same plan again changes nothing, as in PX4."""
        if items and identifier == self._ids[kind]:
            return
        self._items[kind] = items
        self._ids[kind] = identifier if items else 0
        if kind is MissionType.MISSION:
            self.current = current
        self.revision += 1

    def set_current(self, sequence: int) -> None:
        """Ask for another mission item."""
        self.current = sequence
        self.revision += 1
