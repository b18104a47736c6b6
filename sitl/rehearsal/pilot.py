"""The pilot and the ground stations of a rehearsed flight: they take the vehicle, and change it."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from sitl.px4sim import FlightMode, MissionType
from sitl.rehearsal.fakes import StreamFault, Way
from sitl.rehearsal.judge import SceneEventKind
from sitl.rehearsal.operator import FAST_M_S, Operator
from sitl.rehearsal.scenario import Scenario

STICKS_S: Final = 3.0
_MOVE_S: Final = 0.3
"""So long a hand takes to move the sticks: from PX4 1.18 on their speed counts."""

_RESUME_S: Final = 2.0
MOVING_M_S: Final = 1.0
CLOSE_M, FAR_M = (5.2, 8.0), 30.0
"""So near to a zone it is sent towards it, to a place so far away."""


_TWIN: Final[Mapping[str, Callable[[dict[str, Any]], dict[str, Any]]]] = {
    "GLOBAL_POSITION_INT": lambda fields: {
        "time_boot_ms": fields["time_boot_ms"] + 600_000,
        "lat": fields["lat"] + 5_000,
        "relative_alt": 0,
        "vx": 0,
        "vy": 0,
        "vz": 0,
    },
    "HEARTBEAT": lambda fields: {
        "base_mode": fields["base_mode"] & ~128,
        "custom_mode": 0x03040000,
        "system_status": 3,
    },
}
"""How another vehicle on the ground differs: it stands 55 m north, switched on earlier."""


class Pilot:
    """Takes the vehicle of a flight, hands it back, and changes what is on board.

    Args:
        flight: Where.
        operator: Who resumes the flight, and leaves the vehicle to the pilot meanwhile.
        rng: Of the flight.
    """

    def __init__(self, flight: Scenario, operator: Operator, rng: random.Random) -> None:
        self._flight, self._operator, self._rng = flight, operator, rng
        self._sticks_from_s = self._moved_until_s = math.inf  # received from, moved until
        self._moved_from_s = math.inf
        self._overrides = False  # the sticks are moved, and to take the vehicle over

    def step(self, now_s: float) -> None:
        """The transmitter sends the sticks' positions."""
        if now_s < self._sticks_from_s:
            return
        moved = 0.0
        if self._moved_from_s <= now_s < self._moved_until_s:
            moved = min((now_s - self._moved_from_s) / _MOVE_S, 1.0)
        self._flight.stations.first.sticks(0.5 * moved, 0.3 * moved)
        if self._overrides and self._flight.autopilot.mode is FlightMode.POSCTL:
            self._overrides = False
            self._taken("sticks")

    def do_before_us(self, how: str) -> None:
        """The pilot arms, or chooses a mode, while the companion still gets ready."""
        pilot = self._flight.stations.first
        if self._operator.flies:
            return
        if how == "arm":
            pilot.arm()
        else:
            if FlightMode[how].needs_pilot:
                pilot.sticks()
            pilot.choose(FlightMode[how])
        if how == "AUTO_TAKEOFF":
            pilot.arm()
        if how != "arm" or self._flight.autopilot.armed:
            self._taken("armed" if how == "arm" else how)

    def do_airframe(self, kind: int) -> None:
        """The vehicle on the link reports another type from now on (MAV_TYPE)."""
        flight = self._flight
        flight.autopilot.parameters.change("MAV_TYPE", kind)
        if flight.companion is not None and self._operator.flies:
            self._taken("airframe")

    def do_autopilot(self, number: int) -> None:
        """Its HEARTBEATs name another autopilot from now on (MAV_AUTOPILOT)."""

        def name(fields: dict[str, Any], _rng: object) -> dict[str, Any]:
            return {**fields, "autopilot": number}

        self._flight.link.trouble(Way.DOWN, "HEARTBEAT", StreamFault.WRONG, math.inf, wrong=name)

    def do_twin(self, _: bool) -> None:
        """Every second position and HEARTBEAT is of a vehicle that stands elsewhere, disarmed."""
        flight = self._flight
        for name, others in _TWIN.items():
            turns = itertools.count()

            def take_turns(
                fields: dict[str, Any],
                _rng: object,
                turns: Iterator[int] = turns,
                others: Callable[[dict[str, Any]], dict[str, Any]] = others,
            ) -> dict[str, Any]:
                return {**fields, **(others(fields) if next(turns) % 2 else {})}

            flight.link.trouble(Way.DOWN, name, StreamFault.WRONG, math.inf, wrong=take_turns)
        if flight.companion is not None and self._operator.flies:
            self._taken("twin")

    def do_busy(self, on: bool) -> None:
        """A station begins to download the plan, and leaves it at that until it is over."""
        self._flight.stations.beside.send("MISSION_REQUEST_LIST" if on else "MISSION_ACK")

    def _taken(self, how: str) -> None:
        self._operator.pilot = True
        self._flight.happened(SceneEventKind.PILOT, how)

    def do_pilot(self, name: str) -> None:
        """The pilot chooses a mode, or Return where that is flown already."""
        mode = FlightMode[name]
        if mode.needs_pilot:
            self._sticks_from_s = min(self._sticks_from_s, self._flight.now_s)
            self._flight.stations.first.sticks()
        if self._flight.autopilot.mode is mode:
            mode = FlightMode.AUTO_RTL
        if self._operator.flies and self._flight.stations.chosen(mode, self._flight.stations.first):
            self._taken(mode.name)

    def do_choose_back(self, _: None) -> None:
        """As soon as the vehicle takes a mode of ours the pilot chooses the one before again.

        No message has shown ours: to the companion the vehicle was in one mode all the time.
        """
        flight, autopilot = self._flight, self._flight.autopilot

        def choose_back() -> None:
            shown = autopilot.mode
            if autopilot.intended is shown or not self._operator.flies or autopilot.failsafe.acting:
                return
            flight.after_order = lambda: None
            if flight.stations.chosen(shown, flight.stations.first):
                self._taken("mode of before")

        flight.after_order = choose_back

    def do_second_station(self, name: str) -> None:
        """Another station chooses a mode."""
        stations = self._flight.stations
        if self._operator.flies and stations.chosen(FlightMode[name], stations.second):
            self._taken(name)

    def do_sticks(self, override: bool) -> None:
        """The pilot moves the sticks for some seconds, where they override the mode or do not."""
        flight = self._flight
        parameters = flight.autopilot.parameters
        if parameters.behaviour.overrides_by_speed:
            parameters.change("MAN_OVERRIDE_SPD", 1.0 if override else -1.0)
        else:
            parameters.change("COM_RC_OVERRIDE", int(override))
        flight.stations.first.sticks()  # at rest first: what moves is taken for the pilot's
        self._sticks_from_s = self._moved_from_s = flight.now_s
        self._moved_until_s = flight.now_s + STICKS_S
        self._overrides = override

    def do_transmitter(self, acts: int) -> None:
        """The pilot's transmitter is on, with that to be done once it is lost; 0: it is lost.

        NAV_RCL_ACT: 2 returns, 3 lands, both after some seconds in Hold.
        """
        if acts:
            self._flight.autopilot.parameters.change("NAV_RCL_ACT", acts)
            self._sticks_from_s = self._flight.now_s
        else:
            self._sticks_from_s = math.inf

    def do_hand_back(self, _: None) -> None:
        """The pilot lets it hold, and the operator requests it."""
        if self._operator.pilot and self._operator.flies:
            self._flight.stations.first.choose(FlightMode.AUTO_LOITER)
            self._operator.resume(after_s=_RESUME_S)

    def do_climb(self, up_m: float) -> None:
        """The pilot has it go so far above its altitude, and hover there."""
        if self._operator.pilot and self._operator.flies:
            self._hover(self._flight.mission.altitude_above_home_m + up_m)

    def _hover(self, above_m: float, place: tuple[float, float] | None = None) -> None:
        """In Hold, so far above home, and there: metres north and east of the vehicle's origin."""
        autopilot = self._flight.autopilot
        self._flight.stations.first.choose(FlightMode.AUTO_LOITER)
        autopilot.reposition(place, autopilot.situation.home_altitude_m + above_m)

    def do_too_early(self, _: None) -> None:
        """The operator requests the vehicle while the pilot still flies it in another mode."""
        free = self._flight.autopilot.mode in {FlightMode.AUTO_LOITER, FlightMode.AUTO_MISSION}
        if self._operator.pilot and self._operator.flies and not free:
            self._operator.do_request(self._rng.choice(("resume", "home", "explore")))

    def do_take_back(self, _: None) -> None:
        """The operator has our plan put on board again, and the flight resumed."""
        if self._operator.flies:
            self._operator.resume(after_s=0.0, upload=True)

    def do_pause(self, divert: bool) -> None:
        """The pilot pauses or diverts the vehicle without choosing a mode that is not ours."""
        autopilot, companion, rng = self._flight.autopilot, self._flight.companion, self._rng
        if companion is None or self._operator.pilot or not self._operator.flies:
            return
        pending = companion.flight.controller.pending
        if autopilot.mission.climbing or pending is not None:
            return
        moving = math.hypot(*autopilot.situation.velocity_m_s[:2]) > MOVING_M_S
        if autopilot.mode is FlightMode.AUTO_MISSION and divert:
            if self._flight.stations.divert():
                self._taken("item")
        elif autopilot.mode is FlightMode.AUTO_LOITER and (divert or moving):
            away_m, angle_rad = rng.uniform(10.0, 38.0), rng.uniform(0.0, 2 * math.pi)
            north_m, east_m = away_m * math.cos(angle_rad), away_m * math.sin(angle_rad)
            here = autopilot.situation
            place = (here.north_m + north_m, here.east_m + east_m)
            if autopilot.reposition(place if divert else None, None):
                self._taken("reposition")

    def do_divert(self, _: None) -> None:
        """A station sends it towards a zone that it passes, without choosing another mode."""

        def divert() -> bool:
            flight, operator = self._flight, self._operator
            away_m, (east, north) = operator.space.nearest(operator.here)
            companion, autopilot = flight.companion, flight.autopilot
            fast = math.hypot(*operator.velocity_m_s) > FAST_M_S
            if companion is None or not (
                operator.ours and fast and CLOSE_M[0] < away_m < CLOSE_M[1]
            ):
                return False
            if companion.flight.controller.pending is not None:
                return False
            here = autopilot.situation
            if autopilot.mode is FlightMode.AUTO_MISSION:
                if flight.stations.divert((north, east)):
                    self._taken("item")
            elif autopilot.mode is FlightMode.AUTO_LOITER:
                place = here.north_m + FAR_M * north, here.east_m + FAR_M * east
                if autopilot.reposition(place, None):
                    self._taken("reposition")
            return operator.pilot

        self._operator.wait_for(divert)

    def do_divert_now(self, away_m: float) -> None:
        """A station sends it elsewhere in Hold, whatever of ours waits meanwhile."""
        autopilot, angle_rad = self._flight.autopilot, self._rng.uniform(0.0, 2 * math.pi)
        if self._operator.ours and autopilot.mode is FlightMode.AUTO_LOITER:
            here = autopilot.situation
            north_m, east_m = away_m * math.cos(angle_rad), away_m * math.sin(angle_rad)
            if autopilot.reposition((here.north_m + north_m, here.east_m + east_m), None):
                self._taken("reposition")

    def do_fly_off(self, above_m: float) -> None:
        """The pilot, who took off, flies away at a height above home, where nothing is beside."""
        here = self._operator.here
        place = self._operator.space.in_sight(here, self._rng)
        if place is not None and self._operator.flies:
            situation = self._flight.autopilot.situation
            east_m, north_m = (a - b for a, b in zip(place, here, strict=True))
            self._hover(above_m, (situation.north_m + north_m, situation.east_m + east_m))

    def do_hand_over(self, _: None) -> None:
        """The pilot, who took off, chooses Mission mode: the flight is the companion's."""
        if self._operator.pilot and self._operator.flies:
            stations = self._flight.stations
            if stations.chosen(FlightMode.AUTO_MISSION, stations.first):
                self._operator.pilot = False
                self._flight.happened(SceneEventKind.HANDED_OVER)

    def do_disarm(self, forced: bool) -> None:
        """A station disarms it."""
        was_armed = self._flight.autopilot.armed
        self._flight.stations.first.disarm(forced=forced)
        if was_armed and not self._flight.autopilot.armed:
            self._flight.happened(SceneEventKind.DISARMED, "station")

    def do_home(self, by: tuple[float, float]) -> None:
        """A station moves home: metres sideways and up."""
        situation = self._flight.autopilot.situation
        if situation.home is None:
            return
        side_m, up_m = by
        north_m, east_m = situation.home
        degrees = situation.projection.to_global(north_m, east_m + side_m)
        amsl_m = situation.home_altitude_m + up_m
        self._flight.stations.first.move_home(*degrees, amsl_m)
        self._flight.happened(SceneEventKind.HOME_MOVED, (*degrees, amsl_m))

    def do_speed(self, speed_m_s: float) -> None:
        """A station changes the speed."""
        self._flight.stations.first.change_speed(speed_m_s)

    def do_plan(self, which: str) -> None:
        """A station puts the same mission on board, another one, or none."""
        if not self._put(which):
            self._operator.wait_for(lambda: self._put(which))

    def _put(self, which: str) -> bool:
        """Put a plan on board, if PX4 takes it now; the station tries again."""
        stations, autopilot = self._flight.stations, self._flight.autopilot
        if not stations.may_upload:
            return False
        if not autopilot.armed or autopilot.failsafe.acting:
            return True
        lands = autopilot.mode is FlightMode.AUTO_LAND
        match which:
            case "same":
                stations.same_plan()
                return True  # what is flown is ours still
            case "other":
                stations.other_plan()
            case _:
                stations.delete(MissionType.MISSION)
        if not lands:  # a landing needs no plan: it is ours still
            self._taken("plan")
        return True

    def do_list_after(self, what: tuple[str, str]) -> None:
        """As soon as one of our lists is stored, a station stores one of its own."""
        ours, theirs = (MissionType[name.upper()] for name in what)
        stations, plan = self._flight.stations, self._flight.autopilot.plan
        before = plan.identifier(ours)

        def store() -> bool:
            if plan.identifier(ours) == before or not stations.may_upload:
                return False
            match theirs:
                case MissionType.MISSION:
                    stations.other_plan()
                case MissionType.FENCE:
                    stations.add_zone(self._rng.uniform(10.0, 40.0))
                case _:
                    stations.delete(theirs)
            self._flight.happened(SceneEventKind.LIST_STORED, theirs.name.lower())
            if self._flight.autopilot.armed:
                if theirs is MissionType.MISSION:
                    self._taken("plan")
                else:
                    self._flight.happened(SceneEventKind.FENCE_CHANGED, "added")
            return True

        self._operator.wait_for(store)

    def do_fence(self, ahead_m: float | None) -> None:
        """A station adds a zone so far ahead, or deletes the fence."""
        if not self._operator.flies:
            return
        if ahead_m is None:
            self._flight.stations.delete(MissionType.FENCE)
        else:
            self._flight.stations.add_zone(ahead_m)
        changed = "deleted" if ahead_m is None else "added"
        self._flight.happened(SceneEventKind.FENCE_CHANGED, changed)
