"""MISSION_CURRENT and MISSION_ITEM_REACHED, as PX4's mission manager sends them on each link."""

from __future__ import annotations

import math
from typing import Final

from sitl.px4sim.autopilot import Autopilot
from sitl.px4sim.plan.mission_items import MissionType
from sitl.px4sim.state.outgoing import Outgoing
from sitl.px4sim.state.px4_modes import FlightMode

_NO_MISSION: Final = 1  # MISSION_STATE
_NOT_STARTED: Final = 2
_ACTIVE: Final = 3
_PAUSED: Final = 4
_COMPLETE: Final = 5
_MODE_ACTIVE: Final = 1
_MODE_SUSPENDED: Final = 2
_ACTIVE_MODES: Final = frozenset(
    {FlightMode.AUTO_MISSION, FlightMode.AUTO_TAKEOFF, FlightMode.AUTO_LAND}
)
_UNKNOWN_TOTAL: Final = 65535
_REPEATS: Final = 10
_PERIOD_S: Final = 1.0


class MissionReporter:
    """Once a second, and at once when the current item changes or an item is reached.

    MISSION_ITEM_REACHED is repeated ten times after it was sent first.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._state = _NO_MISSION
        self._current = 0
        self._reached = -1
        self._repeats = 0
        self._next_s = -math.inf

    def step(self, now_s: float) -> list[Outgoing]:
        """What is to be sent now."""
        result = self._autopilot.mission.result
        messages: list[Outgoing] = []
        if result.current != self._current:
            self._current = result.current
            messages.append(self._mission_current())
        if result.reached != self._reached:
            self._reached, self._repeats = result.reached, 0
            if result.reached >= 0:
                messages.append(_item_reached(result.reached))
        if not messages and now_s >= self._next_s:
            self._next_s = now_s + _PERIOD_S
            messages.append(self._mission_current())
            if self._reached >= 0 and self._repeats < _REPEATS:
                self._repeats += 1
                messages.append(_item_reached(self._reached))
        return messages

    def _mission_current(self) -> Outgoing:
        plan = self._autopilot.plan
        active = self._autopilot.mode in _ACTIVE_MODES
        count = len(plan.items(MissionType.MISSION))
        self._renew_state(count, active=active)
        return Outgoing(
            "MISSION_CURRENT",
            {
                "seq": self._current,
                "total": count or _UNKNOWN_TOTAL,
                "mission_state": self._state,
                "mission_mode": _MODE_ACTIVE if active else _MODE_SUSPENDED,
                "mission_id": plan.identifier(MissionType.MISSION),
                "fence_id": plan.identifier(MissionType.FENCE),
                "rally_points_id": plan.identifier(MissionType.RALLY),
            },
        )

    def _renew_state(self, count: int, *, active: bool) -> None:
        result = self._autopilot.mission.result
        if count == 0 or not result.valid:
            self._state = _NO_MISSION
        elif result.finished:
            self._state = _COMPLETE
        elif active:
            self._state = _ACTIVE
        elif result.reached >= 0:
            self._state = _PAUSED
        elif result.current < 1:
            self._state = _NOT_STARTED


def _item_reached(sequence: int) -> Outgoing:
    return Outgoing("MISSION_ITEM_REACHED", {"seq": sequence})
