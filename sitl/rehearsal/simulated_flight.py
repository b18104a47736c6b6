"""A rehearsed flight in simulated time, to which the faults of its scene happen."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

from air_router.messages import POSE_TOPIC, SEEK_TOPIC, SeekMessage
from sitl.px4sim.plan_store import MissionType
from sitl.px4sim.state import FlightMode
from sitl.rehearsal.companion import EPOCH_S
from sitl.rehearsal.courses import ScheduledFault, carry_out
from sitl.rehearsal.faults import Scene
from sitl.rehearsal.judge.evidence import SceneEventKind
from sitl.rehearsal.operator import Operator
from sitl.rehearsal.scenario import Scenario
from sitl.rehearsal.stand_ins.link import StreamFault, Way, wrong_of
from sitl.rehearsal.stand_ins.team import pose, prank_of

STICKS_S: Final = 3.0
GUST_S: Final = 2.0
PUSHED_M: Final = (5.5, 10.0)
"""So near to a zone a vehicle is pushed: from nearer it would be in it at once."""

_RESUME_S: Final = 2.0
MOVING_M_S: Final = 1.0
_ALTERED: Final = 3000  # degE7: 33 m north
_ACK_ERROR, _NO_SPACE = 1, 4  # MAV_MISSION_RESULT


class SimulatedFlight(Scenario):
    """What happens in one flight, by the names of `courses`; the operator does the rest.

    Args:
        scene: What goes wrong.
        path: The mission.
    """

    def __init__(self, scene: Scene, path: Path) -> None:
        super().__init__(scene, path)
        self._fault_dice = scene.chance("script")
        self._operator = Operator(self, self._fault_dice)
        self._jump = (0.0, 0.0)  # north and east, m: sum of the jumps
        self._sticks_from_s = self._moved_until_s = math.inf  # heard from, moved until
        self._other_until_s = -math.inf  # so long another UAV is heard

    def let_happen(self) -> bool:
        """See `Scenario`."""
        now_s = self.now_s
        for scheduled in self.agenda.take(now_s):
            self.happened(SceneEventKind.FAULT, scheduled.what)
            carry_out(scheduled, self, self._operator, self.robots)
        self._operator.step(now_s)
        if now_s >= self._sticks_from_s:
            moved = now_s < self._moved_until_s
            self.stations.first.sticks(0.5 if moved else 0.0, 0.3 if moved else 0.0)
        if now_s < self._other_until_s:
            self._tell_of_the_other()
        return bool(self.agenda.due) or self._operator.asks_on

    # The vehicle's own

    def do_jump(self, angle_rad: float) -> None:
        """The position estimate is off by some metres into a direction."""
        size_m = self._fault_dice.uniform(1.0, 4.0)
        north_m, east_m = self._jump
        self._shift(size_m * math.cos(angle_rad) - north_m, size_m * math.sin(angle_rad) - east_m)

    def do_jump_back(self, _: None) -> None:
        """It is right again."""
        self._shift(-self._jump[0], -self._jump[1])

    def _shift(self, north_m: float, east_m: float) -> None:
        self.autopilot.errors.jump(north_m, east_m)
        self._jump = (self._jump[0] + north_m, self._jump[1] + east_m)

    def do_drift(self, off: tuple[float, float, float]) -> None:
        """The estimate moves: metres sideways, into which direction, metres up."""
        size_m, angle_rad, up_m = off
        north_m, east_m = size_m * math.cos(angle_rad), size_m * math.sin(angle_rad)
        self.autopilot.errors.jump(north_m, east_m, up_m)

    def do_off(self, up_m: float) -> None:
        """The altitude estimate jumps."""
        self.autopilot.errors.jump(0.0, 0.0, up_m)

    def do_push(self, gust_m_s: float) -> None:
        """Wind comes up for a moment where a zone or fence is near, and blows towards it."""
        wind, operator = self.autopilot.wind, self._operator

        def push() -> bool:
            away_m, (east, north) = operator.space.nearest(operator.here)
            in_charge = self.companion is not None and self.companion.in_charge
            if not PUSHED_M[0] < away_m < PUSHED_M[1] or not in_charge:
                return False
            wind.blow(gust_m_s * north, gust_m_s * east)
            self.agenda.add(self.now_s + GUST_S, ScheduledFault(0.0, "calm"))
            return True

        operator.wait_for(push)

    def do_calm(self, _: None) -> None:
        """The gust is over."""
        self.autopilot.wind.blow(0.0, 0.0)

    def do_satellites(self, number: int) -> None:
        """So many are in use."""
        self.autopilot.parameters.change("SIM_GPS_USED", number)

    def do_fix(self, what: tuple[int, float]) -> None:
        """The receiver says that its fix is of this kind, for so long."""
        kind, seconds = what
        self.link.trouble(
            *(Way.DOWN, "GPS_RAW_INT", StreamFault.WRONG, self.now_s + seconds),
            wrong=lambda fields, _: {**fields, "fix_type": kind},
        )

    def do_battery(self, drain_s: float) -> None:
        """It takes so many seconds from full to empty."""
        self.autopilot.parameters.change("SIM_BAT_DRAIN", drain_s)
        self.happened(SceneEventKind.BATTERY, drain_s)

    def do_fuller(self, share: float) -> None:
        """The battery says that so much more is left."""

        def lie(fields: dict[str, Any], _dice: object) -> dict[str, Any]:
            said = min(100, fields["battery_remaining"] + round(share * 100))
            return {**fields, "battery_remaining": said}

        self.link.trouble(Way.DOWN, "SYS_STATUS", StreamFault.WRONG, math.inf, wrong=lie)

    def do_reboot(self, seconds: float) -> None:
        """The link is silent for so long, then the vehicle's clock starts anew."""
        self.link.silent = True
        self.agenda.add(self.now_s + seconds, ScheduledFault(0.0, "clock"))

    def do_clock(self, _: None) -> None:
        """It talks again, two seconds after its start."""
        self.link.silent = False
        self.link.booted_s = self.now_s - 2.0

    # The link

    def do_silent(self, on: bool) -> None:
        """Nothing passes."""
        self.link.silent = on

    def do_stream(self, what: tuple[tuple[str, ...], StreamFault, float]) -> None:
        """Something is the matter with these messages for so long."""
        names, kind, seconds = what
        until_s = self.now_s + seconds
        late_s = self._fault_dice.choice((1.0, 3.0, 8.0))
        for name in names:
            wrong = wrong_of(name, self._fault_dice)
            self.link.trouble(Way.DOWN, name, kind, until_s, late_s=late_s, wrong=wrong)

    def do_reject(self, for_good: int) -> None:
        """Uploads are refused, at first or always."""
        result, seconds = (_NO_SPACE, math.inf) if for_good else (_ACK_ERROR, 6.0)
        self.link.trouble(
            *(Way.DOWN, "MISSION_ACK", StreamFault.WRONG, self.now_s + seconds),
            wrong=lambda fields, _: {**fields, "type": result},
        )

    def do_alter(self, what: tuple[int, float, int]) -> None:
        """One item of every mission, or fence, that is put on board arrives with another place."""
        number, seconds, kind = what

        def alter(fields: dict[str, Any], _dice: object) -> dict[str, Any]:
            it = fields["mission_type"] == kind and fields["seq"] == number
            return {**fields, "x": fields["x"] + (_ALTERED if it else 0)}

        self.link.trouble(
            *(Way.UP, "MISSION_ITEM_INT", StreamFault.WRONG, self.now_s + seconds), wrong=alter
        )

    def do_before_us(self, how: str) -> None:
        """The pilot arms, or chooses a mode, while the companion still gets ready."""
        pilot = self.stations.first
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
        if how != "arm" or self.autopilot.armed:
            self._taken("armed" if how == "arm" else how)

    def do_busy(self, on: bool) -> None:
        """A station begins to download the plan, and leaves it at that until it is over."""
        self.stations.beside.say("MISSION_REQUEST_LIST" if on else "MISSION_ACK")

    # Pilot and stations

    def _taken(self, how: str) -> None:
        self._operator.pilot = True
        self.happened(SceneEventKind.PILOT, how)

    def do_pilot(self, name: str) -> None:
        """The pilot chooses a mode, or Return where that is flown already."""
        mode = FlightMode[name]
        if mode.needs_pilot:
            self._sticks_from_s = min(self._sticks_from_s, self.now_s)
            self.stations.first.sticks()
        if self.autopilot.mode is mode:
            mode = FlightMode.AUTO_RTL
        if self._operator.flies and self.stations.chosen(mode, self.stations.first):
            self._taken(mode.name)

    def do_second_station(self, name: str) -> None:
        """Another station chooses a mode."""
        if self._operator.flies and self.stations.chosen(FlightMode[name], self.stations.second):
            self._taken(name)

    def do_sticks(self, override: bool) -> None:
        """The pilot moves the sticks for some seconds, where they override the mode or do not."""
        self.autopilot.parameters.change("COM_RC_OVERRIDE", int(override))
        self.stations.first.sticks()  # at rest first: what moves is taken for the pilot's
        self._sticks_from_s, self._moved_until_s = self.now_s + 0.1, self.now_s + STICKS_S
        if override:
            self._taken("sticks")

    def do_hand_back(self, _: None) -> None:
        """The pilot lets it hold, and the operator asks for it."""
        if self._operator.pilot and self._operator.flies:
            self.stations.first.choose(FlightMode.AUTO_LOITER)
            self._operator.resume(after_s=_RESUME_S)

    def do_climb(self, up_m: float) -> None:
        """The pilot has it go so far above its altitude, and hover there."""
        if self._operator.pilot and self._operator.flies:
            self.stations.first.choose(FlightMode.AUTO_LOITER)
            amsl_m = self.autopilot.situation.home_altitude_m + self.mission.altitude_above_home_m
            self.autopilot.reposition(None, amsl_m + up_m)

    def do_too_early(self, _: None) -> None:
        """The operator asks for the vehicle while the pilot still flies it in another mode."""
        free = self.autopilot.mode in {FlightMode.AUTO_LOITER, FlightMode.AUTO_MISSION}
        if self._operator.pilot and self._operator.flies and not free:
            self._operator.do_ask(self._fault_dice.choice(("resume", "home", "explore")))

    def do_take_back(self, _: None) -> None:
        """The operator has our plan put on board again, and the flight resumed."""
        if self._operator.flies:
            self._operator.resume(after_s=0.0, upload=True)

    def do_pause(self, divert: bool) -> None:
        """The pilot pauses or diverts the vehicle without choosing a mode that is not ours."""
        autopilot, companion, dice = self.autopilot, self.companion, self._fault_dice
        if companion is None or self._operator.pilot or not self._operator.flies:
            return
        pending = companion.flight.controller.gate.pending
        if autopilot.mission.climbing or pending is not None:
            return
        moving = math.hypot(*autopilot.situation.velocity_m_s[:2]) > MOVING_M_S
        if autopilot.mode is FlightMode.AUTO_MISSION and divert:
            if self.stations.divert():
                self._taken("item")
        elif autopilot.mode is FlightMode.AUTO_LOITER and (divert or moving):
            away_m, angle_rad = dice.uniform(10.0, 38.0), dice.uniform(0.0, 2 * math.pi)
            north_m, east_m = away_m * math.cos(angle_rad), away_m * math.sin(angle_rad)
            here = autopilot.situation
            place = (here.north_m + north_m, here.east_m + east_m)
            if autopilot.reposition(place if divert else None, None):
                self._taken("reposition")

    def do_disarm(self, forced: bool) -> None:
        """A station disarms it."""
        was_armed = self.autopilot.armed
        self.stations.first.disarm(forced=forced)
        if was_armed and not self.autopilot.armed:
            self.happened(SceneEventKind.DISARMED, "station")

    def do_home(self, by: tuple[float, float]) -> None:
        """A station moves home: metres sideways and up."""
        situation = self.autopilot.situation
        if situation.home is None:
            return
        side_m, up_m = by
        north_m, east_m = situation.home
        degrees = situation.projection.to_global(north_m, east_m + side_m)
        amsl_m = situation.home_altitude_m + up_m
        self.stations.first.move_home(*degrees, amsl_m)
        self.happened(SceneEventKind.HOME_MOVED, (*degrees, amsl_m))

    def do_speed(self, speed_m_s: float) -> None:
        """A station changes the speed."""
        self.stations.first.change_speed(speed_m_s)

    def do_plan(self, which: str) -> None:
        """A station puts the same mission on board, another one, or none."""
        stations, autopilot = self.stations, self.autopilot
        if not autopilot.armed or autopilot.failsafe.acting:
            return
        lands = autopilot.mode is FlightMode.AUTO_LAND
        match which:
            case "same":
                stations.same_plan()
                return  # what is flown is ours still
            case "other":
                stations.other_plan()
            case _:
                stations.delete(MissionType.MISSION)
        if not lands:  # a landing needs no plan: it is ours still
            self._taken("plan")

    def do_fence(self, ahead_m: float | None) -> None:
        """A station adds a zone so far ahead, or deletes the fence."""
        if not self._operator.flies:
            return
        if ahead_m is None:
            self.stations.delete(MissionType.FENCE)
        else:
            self.stations.add_zone(ahead_m)
        changed = "deleted" if ahead_m is None else "added"
        self.happened(SceneEventKind.FENCE_CHANGED, changed)

    # Robots

    def do_vanish(self, _: None) -> None:
        """No robot is heard any more."""
        self.robots.places.clear()

    def do_carry(self, _: None) -> None:
        """Robots carry each other's poses."""
        self.robots.carry = True

    def do_mad(self, how: str) -> None:
        """Robots tell nonsense."""
        self.robots.prank = prank_of(how, self.mission, self._fault_dice, self._unix_s)

    def do_other_uav(self, seconds: float) -> None:
        """Another UAV is heard of for so long."""
        self._other_until_s = self.now_s + seconds

    def _unix_s(self) -> float:
        return EPOCH_S + self.now_s

    def _tell_of_the_other(self) -> None:
        sought = self.seek[int(self.now_s / 20.0) % len(self.seek)]
        seek = SeekMessage(stamp_s=self._unix_s(), robot=sought)
        place = pose(self.mission.frame, self.mission.home, self._unix_s())
        self.robots.others = [("rhea", SEEK_TOPIC, seek.encode()), ("rhea", POSE_TOPIC, place)]
