"""Missions: how a stored one is taken up, and flown item by item in PX4's AUTO.MISSION.

What matters to a controller that jumps between waypoints: an item without `autocontinue`
is flown to, reported reached and held at; a jump flies straight from wherever the vehicle is;
from item to item the vehicle follows the connecting line.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from sitl.px4sim.auto_modes import Flight, ReturnFlight, go_to
from sitl.px4sim.fence import Fence
from sitl.px4sim.motion import Setpoint, SetpointKind
from sitl.px4sim.plan_store import (
    FRAME_RELATIVE,
    Command,
    MissionItem,
    MissionType,
    PlanStore,
    positive,
)
from sitl.px4sim.state import FlightMode, Situation

_HOME_MOVED_M: Final = 0.05
_LEAST_CLIMB_M: Final = 1e-6


class MissionFlight(Flight):
    """Executes the stored mission.

    Attributes:
        index: The current item; kept within the list.
        valid: Whether the stored mission can be flown.
        finished: Whether it, or a take-off, or a landing, is at its end.
        reached: Index of the item reached last, -1 if none.
        under_way: Whether items are being flown: the mode is active and not at the mission's end.
    """

    def __init__(self) -> None:
        self._items: tuple[MissionItem, ...] = ()
        self.index = 0
        self.valid = self.finished = self.under_way = False
        self.reached = -1
        self._activated = False  # Mission mode was entered with this mission
        self._disarmed_since = False  # since then: at its end it begins anew
        self._item: MissionItem | None = None  # that is flown; None: at the end
        self._climb: Setpoint | None = None  # straight up before the first item; None: done
        self._moving_to_land = False  # NAV_LAND: on the way to where it lands
        self._target = Setpoint()
        self._reached_s: float | None = None  # within the acceptance since then

    @property
    def climbing(self) -> bool:
        """Whether the climb before the first item goes on."""
        return self.under_way and self._climb is not None

    def load(self, items: tuple[MissionItem, ...], index: int, *, valid: bool) -> None:
        """Take over a newly stored mission, to begin at `index`."""
        self._items, self.index = items, max(0, min(index, len(items) - 1))
        self._activated = self.under_way
        self.judge(valid=valid)
        self.finished = False

    def judge(self, *, valid: bool) -> None:
        """Renew the verdict on the stored mission."""
        self.valid, self.reached = valid, -1

    def jump(self, index: int, situation: Situation) -> None:
        """MISSION_SET_CURRENT: fly there at once if a mission is being flown."""
        self.index, self.reached = index, -1
        if self.under_way:
            self.finished = False
            self._set_item(situation, previous=None)

    def activate(self, situation: Situation) -> None:
        """See `Flight`."""
        at_last = self.index + 1 == len(self._items)
        if self._disarmed_since and self._activated and at_last:
            self.index = 0
        self._activated, self._disarmed_since = True, False
        for item in self._items[: self.index]:  # what earlier items set is in force again
            if item.command == Command.DO_CHANGE_SPEED:
                situation.speed_m_s = positive(item.params[1])
        self._prepare_climb(situation)
        self.begin(situation)

    def deactivate(self) -> None:
        """Leave Mission mode; PX4 publishes nothing then."""
        self.under_way = False
        self._climb = None

    def disarmed(self) -> None:
        """The motors stopped."""
        self._disarmed_since = True

    def update(self, situation: Situation) -> Setpoint:
        """See `Flight`."""
        if self.under_way and self._is_reached(situation):
            self._on_reached(situation)
        if self.under_way:
            self._follow_home(situation)
        return self._target

    def begin(self, situation: Situation) -> None:
        """Fly the current item, also anew after the plan was replaced in flight."""
        if not self._items or not self.valid:
            grounded = situation.landed
            situation.announce(
                "mission_not_valid_refuse" if grounded else "mission_not_valid_loiter"
            )
            self._end(situation)
            return
        if not self.under_way:
            situation.announce("mission_execute")
        self.under_way = True
        self.finished, self.reached = False, -1
        self._set_item(situation, previous=None)

    def _prepare_climb(self, situation: Situation) -> None:
        """Before the first item the vehicle climbs to its height where it is."""
        self._climb = None
        item = self._position_from(self.index)
        if item is None:
            return
        altitude_m = item.altitude_amsl_m(situation.home_altitude_m, situation.altitude_m)
        if altitude_m - situation.altitude_m > situation.altitude_acceptance_m:
            self._climb = Setpoint(SetpointKind.TAKEOFF, *situation.here, altitude_m)

    def _follow_home(self, situation: Situation) -> None:
        """Home's altitude moves in flight; heights above home move with it."""
        item = self._item
        if item is None or item.frame != FRAME_RELATIVE or item.command == Command.NAV_LAND:
            return
        altitude_m = item.altitude_amsl_m(situation.home_altitude_m, self._target.altitude_m)
        if abs(altitude_m - self._target.altitude_m) > _HOME_MOVED_M:
            self._target = replace(self._target, altitude_m=altitude_m)

    def _set_item(self, situation: Situation, previous: tuple[float, float] | None) -> None:
        """Make the current item the one that is flown."""
        item = self._items[self.index]
        self._item = item
        self._reached_s = None
        self._moving_to_land = False
        if item.command == Command.NAV_RETURN_TO_LAUNCH:
            situation.announce("commander_rtl")
            situation.request_mode(FlightMode.AUTO_RTL)
        elif item.command == Command.DO_CHANGE_SPEED:
            situation.speed_m_s = positive(item.params[1])
        if not item.has_position:
            if self._target.kind is SetpointKind.IDLE and not situation.landed:
                self._target = go_to(*situation.here, situation.altitude_m, situation)
            return
        if self._climb is not None:
            above_m = self._climb.altitude_m - situation.home_altitude_m
            situation.announce("mission_climb_before_start", above_m)
            self._target = self._climb
            return
        self._target = self._position_target(item, situation, previous)

    def _position_target(
        self, item: MissionItem, situation: Situation, previous: tuple[float, float] | None
    ) -> Setpoint:
        north, east = situation.projection.to_local(*item.degrees)
        radius_m = item.params[1] if item.command == Command.NAV_WAYPOINT else math.nan
        acceptance_m = radius_m if radius_m > 1e-6 else situation.acceptance_m
        altitude_m = item.altitude_amsl_m(situation.home_altitude_m, situation.altitude_m)
        kind = SetpointKind.POSITION
        if item.command == Command.NAV_LAND and not situation.landed:
            altitude_m = situation.altitude_m
            away_m = math.dist((north, east), situation.here)
            self._moving_to_land = away_m > situation.acceptance_m
            kind = SetpointKind.POSITION if self._moving_to_land else SetpointKind.LAND
        return Setpoint(
            kind,
            north,
            east,
            altitude_m,
            previous=None if self._moving_to_land else previous,
            following=self._following(item, situation),
            acceptance_m=acceptance_m,
        )

    def _following(self, item: MissionItem, situation: Situation) -> tuple[float, float] | None:
        following = self._position_from(self.index + 1)
        if following is None or not item.autocontinue or item.time_inside_s > 0:
            return None
        return situation.projection.to_local(*following.degrees)

    def _position_from(self, index: int) -> MissionItem | None:
        """The first item with a position at or after an index."""
        return next((item for item in self._items[index:] if item.has_position), None)

    def _is_reached(self, situation: Situation) -> bool:
        item = self._item
        if item is None:
            return False
        if not item.has_position:
            return True
        if item.command == Command.NAV_LOITER_UNLIM:
            return False
        if self._climb is not None:
            enough_m = self._climb.altitude_m - situation.altitude_acceptance_m
            return not situation.landed and situation.altitude_m > enough_m
        if item.command == Command.NAV_LAND and not self._moving_to_land:
            return situation.landed
        return self._is_there(item, situation)

    def _is_there(self, item: MissionItem, situation: Situation) -> bool:
        target = self._target
        if self._reached_s is None:
            distance_m = math.dist((target.north_m, target.east_m), situation.here)
            height_m = abs(target.altitude_m - situation.altitude_m)
            near = distance_m <= target.acceptance_m and height_m <= situation.altitude_acceptance_m
            if situation.landed or not near:
                return False
            self._reached_s = situation.time_s
        return situation.time_s - self._reached_s >= item.time_inside_s

    def _on_reached(self, situation: Situation) -> None:
        if self._climb is not None and self._item is not None and self._item.has_position:
            self._climb = None
            self._set_item(situation, previous=None)
            return
        if self._moving_to_land:
            self._set_item(situation, previous=None)
            return
        self.reached = self.index
        item, self._reached_s = self._item, None
        if item is not None and item.autocontinue:
            self._advance(situation)

    def _advance(self, situation: Situation) -> None:
        if self.index + 1 >= len(self._items):
            situation.announce(
                "mission_finished" if situation.landed else "mission_finished_loiter"
            )
            self._end(situation)
            return
        self.index += 1
        self._set_item(situation, previous=(self._target.north_m, self._target.east_m))

    def _end(self, situation: Situation) -> None:
        self.under_way = False
        self._item, self._climb = None, None
        self.finished = True
        if situation.landed:
            self._target = Setpoint()
        elif self._target.kind is not SetpointKind.POSITION:
            self._target = go_to(*situation.here, situation.altitude_m, situation)


@dataclass(eq=False)
class PlanIntake:
    """Hands the stored plan to those who fly by it, when it has changed.

    A mission is checked when it is taken up, not when it is uploaded; PX4 announces mistakes then.
    """

    plan: PlanStore
    fence: Fence
    mission: MissionFlight
    returning: ReturnFlight
    _revision: int = 0  # of the plan store, at the last check
    _mission_id: int = 0  # checksum of the mission that is loaded; 0: none

    def step(self, situation: Situation) -> None:
        """Check for changes."""
        plan, mission = self.plan, self.mission
        fence_loaded = self.fence.load_if_due(situation)
        if plan.revision != self._revision:
            self._revision = plan.revision
            self.returning.rally_points = tuple(
                situation.projection.to_local(*item.degrees)
                for item in plan.items(MissionType.RALLY)
            )
            identifier = plan.identifier(MissionType.MISSION)
            if identifier != self._mission_id:
                self._mission_id = identifier
                self._load(situation)
            elif plan.current is not None and plan.current != mission.index:
                mission.jump(plan.current, situation)
            plan.current = None
        if fence_loaded:
            mission.judge(valid=self._feasible(situation))
            if mission.under_way:
                mission.begin(situation)
        plan.active = mission.index

    def _load(self, situation: Situation) -> None:
        """A mission that replaces one in flight is flown on with, from the index it has.

        While a fence is being loaded the verdict on the mission has to wait.
        """
        mission = self.mission
        index = mission.index if self.plan.current is None else self.plan.current
        was_under_way = mission.under_way
        items = self.plan.items(MissionType.MISSION)
        valid = mission.valid if self.fence.loading else self._feasible(situation)
        mission.load(items, index, valid=valid and bool(items))
        if was_under_way:
            mission.begin(situation)

    def _feasible(self, situation: Situation) -> bool:
        """Check the mission and announce mistakes; PX4 does not check legs against the fence."""
        items = self.plan.items(MissionType.MISSION)
        faults = [*_faults(items, situation)] if items else []
        for fault in faults:
            situation.announce(*fault)
        return bool(items) and not faults and self._fence_kept(items, situation)

    def _fence_kept(self, items: tuple[MissionItem, ...], situation: Situation) -> bool:
        to_local = situation.projection.to_local
        for number, item in enumerate(items, 1):
            if item.has_position and not self.fence.encloses(*to_local(*item.degrees)):
                situation.announce("navigator_mis_geofence_violation", number)
                return False
        return True


def _faults(
    items: tuple[MissionItem, ...], situation: Situation
) -> Iterator[tuple[str, *tuple[float, ...]]]:
    """Why items cannot be flown: PX4's events, with arguments; PX4 1.17 has no texts for these."""
    if items[0].command == Command.NAV_LAND and situation.landed:
        yield ("navigator_mis_starts_w_landing",)
        return
    for index, item in enumerate(items):
        if item.command != Command.NAV_TAKEOFF:
            continue
        offset_m = 0.0 if item.frame == FRAME_RELATIVE else situation.home_altitude_m
        if item.z - offset_m < _LEAST_CLIMB_M:
            yield "navigator_mis_takeoff_too_low", offset_m
        elif any(before.command != Command.DO_CHANGE_SPEED for before in items[:index]):
            yield ("navigator_mis_takeoff_not_first",)
