"""In which order the items of a mission are flown, DO_JUMP included."""

from __future__ import annotations

import math
from typing import Final

from sitl.px4sim.plan.mission_items import Command, MissionItem

_MOST_JUMPS: Final = 10


class ItemOrder:
    """A list of items and the current one.

    Attributes:
        items: The mission.
        index: The current item; kept within the list.
    """

    def __init__(self, items: tuple[MissionItem, ...], index: int) -> None:
        self.items = items
        self.index = max(0, min(index, len(items) - 1))
        self._jumps_left = {
            number: _whole(item.params[1])
            for number, item in enumerate(items)
            if item.command == Command.DO_JUMP
        }

    @property
    def at_last(self) -> bool:
        """Whether the last item is the current one."""
        return self.index + 1 == len(self.items)

    def position_from(self, index: int) -> MissionItem | None:
        """The first item with a position at or after an index."""
        return next((item for item in self.items[index:] if item.has_position), None)

    def advance(self) -> bool:
        """Go to the next item, jumps taken; False, and nothing changed, at the end."""
        index = self.index + 1
        for _ in range(_MOST_JUMPS):
            if index >= len(self.items):
                return False
            if self.items[index].command != Command.DO_JUMP:
                self.index = index
                return True
            goal = _whole(self.items[index].params[0])
            if self._jumps_left.get(index, 0) > 0 and 0 <= goal < len(self.items):
                self._jumps_left[index] -= 1
                index = goal
            else:
                index += 1
        return False


def _whole(value: float) -> int:
    return int(value) if math.isfinite(value) and abs(value) < 2**31 else -1
