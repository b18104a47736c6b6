"""Whether PX4 would fly a stored mission: its checks after the upload, and what it says then."""

from __future__ import annotations

import struct
from typing import Final

from sitl.px4sim.plan.fence import Fence
from sitl.px4sim.plan.mission_items import FRAME_RELATIVE, Command, MissionItem
from sitl.px4sim.state.notice import Severity
from sitl.px4sim.state.situation import Situation

_BEFORE_TAKEOFF: Final = frozenset(
    {93, 177, 178, 179, 189, 195, 196, 197, 200, 201, 203, 204, 205, 206, 214, 260}
    | {530, 532, 1000, 1001, 2000, 2001, 2003, 2500, 2501, 3000}
)
_FLOWN: Final = _BEFORE_TAKEOFF | frozenset(
    {16, 17, 19, 20, 21, 22, 31, 84, 85, 187, 211, 400, 4501, 42600}
)
_VTOL: Final = frozenset({84, 85, 3000})
_LEAST_CLIMB_M: Final = 1e-6


def mission_feasible(items: tuple[MissionItem, ...], fence: Fence, situation: Situation) -> bool:
    """Check a mission and say what is wrong with it; a leg across a fence is not looked at."""
    if not items:
        return False
    return _items_feasible(items, situation) and _fence_kept(items, fence, situation)


def _items_feasible(items: tuple[MissionItem, ...], situation: Situation) -> bool:
    feasible = True
    seen_position = False
    for index, item in enumerate(items):
        if item.command not in _FLOWN:
            arguments = struct.pack("<HH", index + 1, item.command)
            _reject(situation, "navigator_mis_unsup_cmd", arguments)
            return False
        if index == 0 and item.command == Command.NAV_LAND and situation.landed:
            _reject(situation, "navigator_mis_starts_w_landing")
            return False
        if item.command == Command.NAV_TAKEOFF:
            feasible &= _takeoff_feasible(item, situation, seen_position=seen_position)
        if item.command in _VTOL:
            _reject(situation, "navigator_mis_vtol_items")
            feasible = False
        seen_position = seen_position or item.command not in _BEFORE_TAKEOFF
    return feasible


def _takeoff_feasible(item: MissionItem, situation: Situation, *, seen_position: bool) -> bool:
    offset_m = 0.0 if item.frame == FRAME_RELATIVE else situation.home_altitude_m
    if item.z - offset_m < _LEAST_CLIMB_M:
        _reject(situation, "navigator_mis_takeoff_too_low", struct.pack("<f", offset_m))
        return False
    if seen_position:
        _reject(situation, "navigator_mis_takeoff_not_first")
        return False
    return True


def _fence_kept(items: tuple[MissionItem, ...], fence: Fence, situation: Situation) -> bool:
    for index, item in enumerate(items):
        if not item.has_position:
            continue
        point = situation.projection.to_local(item.latitude_deg, item.longitude_deg)
        if not fence.allows(*point):
            situation.say(
                f"Geofence violation for waypoint {index + 1}",
                "navigator_mis_geofence_violation",
                Severity.CRITICAL,
                Severity.ERROR,
                struct.pack("<h", min(index + 1, 32767)),
            )
            return False
    return True


def _reject(situation: Situation, event: str, arguments: bytes = b"") -> None:
    """PX4 1.17's checker has no channel for texts: these reasons exist only as events."""
    situation.say("", event, Severity.ERROR, None, arguments)
