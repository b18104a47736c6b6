"""A rehearsed flight in simulated time, to which the faults of its scene happen."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

from air_router.messages import POSE_TOPIC, SEEK_TOPIC, SeekMessage
from sitl.rehearsal.companion import EPOCH_S
from sitl.rehearsal.courses import ScheduledFault, carry_out
from sitl.rehearsal.fakes import StreamFault, Way, foreign_messages, pose, prank_of, wrong_of
from sitl.rehearsal.faults import Scene
from sitl.rehearsal.file_changes import FileChanges
from sitl.rehearsal.inspector import Inspector
from sitl.rehearsal.judge import SceneEventKind
from sitl.rehearsal.operator import Operator
from sitl.rehearsal.pilot import Pilot
from sitl.rehearsal.scenario import Scenario
from sitl.rehearsal.strangers import Strangers
from sitl.rehearsal.zone_drawing import ZoneDrawing

GUST_S: Final = 2.0
PUSHED_M: Final = (5.5, 10.0)
"""So near to a zone a vehicle is pushed: from nearer it would be in it at once."""

_RIGHT_M: Final = 0.1
NEARED_M: Final = (6.5, 9.0)
NEARED_S: Final = 12.0
"""So near to a zone the estimate jumps towards it, and for so long."""

_ALTERED: Final = 3000  # degE7: 33 m north
_ACK_ERROR, _NO_SPACE = 1, 4  # MAV_MISSION_RESULT


class SimulatedFlight(Scenario):
    """What happens in one flight, by the names of `courses`; others do the rest.

    Args:
        scene: What goes wrong.
        path: The mission.
        more: As `Scenario` takes it.
    """

    def __init__(self, scene: Scene, path: Path, **more: Any) -> None:
        super().__init__(scene, path, **more)
        self._fault_rng = scene.chance("script")
        self._operator = Operator(self, self._fault_rng)
        self._zones = ZoneDrawing(self, self._operator, self._fault_rng)
        self._pilot = Pilot(self, self._operator, self._fault_rng)
        self._more = (
            Strangers(self),
            FileChanges(self, self._zones, self._operator),
            Inspector(self, self._operator),
        )
        self._jump = (0.0, 0.0)  # north and east, m: sum of the jumps
        self._other_until_s = -math.inf  # so long another UAV is received
        self._foreign_until_s = -math.inf  # until then others send on the link

    def let_happen(self) -> bool:
        """See `Scenario`."""
        now_s = self.now_s
        for scheduled in self.agenda.take(now_s):
            self.happened(SceneEventKind.FAULT, scheduled.what)
            doers = (self, self._pilot, self._operator, self._zones, self.robots)
            carry_out(scheduled, *doers, *self._more)
        self._operator.step(now_s)
        self._zones.step(now_s)
        self._pilot.step(now_s)
        if now_s < self._other_until_s:
            self._announce_the_other()
        if now_s < self._foreign_until_s:
            for sender, name, fields in foreign_messages(now_s):
                self.receive_foreign(sender, name, fields)
        return bool(self.agenda.due) or self._operator.keeps_requesting

    # The vehicle's own

    def do_jump(self, angle_rad: float) -> None:
        """The position estimate is off by some metres into a direction."""
        size_m = self._fault_rng.uniform(1.0, 4.0)
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

    def do_mislead(self, size_m: float) -> None:
        """The position estimate jumps by so much into a zone or fence that is near."""
        operator = self._operator

        def mislead() -> bool:
            away_m, (east, north) = operator.space.nearest(operator.here)
            near = away_m < size_m and operator.ours
            if near:
                self.autopilot.errors.jump(size_m * north, size_m * east)
            return near

        operator.wait_for(mislead)

    def do_stray(self, deep_m: float) -> None:
        """Dead reckoning: the estimate drifts so deep into what is nearest, a zone or the outside.

        The vehicle stays where it is.
        """
        operator = self._operator
        away_m, (east, north) = operator.space.nearest(operator.here)
        size_m = away_m + deep_m
        self._shift(size_m * north, size_m * east)
        self.happened(SceneEventKind.ESTIMATE_OFF, size_m)

    def do_home_itself(self, up_m: float) -> None:
        """PX4 sets home anew, so much higher: no station has requested it."""
        situation = self.autopilot.situation
        if situation.home is not None:
            self.autopilot.set_home(situation.home, situation.home_altitude_m + up_m)

    def do_near(self, left_m: float) -> None:
        """The position estimate jumps until only so much is left to a zone or fence that is near.

        It is right again when the vehicle has had the time to move away.
        """
        operator = self._operator

        def near() -> bool:
            away_m, (east, north) = operator.space.nearest(operator.here)
            right = math.hypot(*self._jump) < _RIGHT_M
            if not (NEARED_M[0] < away_m < NEARED_M[1] and right and operator.ours):
                return False
            off_m = away_m - left_m
            self._shift(off_m * north, off_m * east)
            self.agenda.add(self.now_s + NEARED_S, ScheduledFault(0.0, "jump back"))
            return True

        operator.wait_for(near)

    def do_calm(self, _: None) -> None:
        """The gust is over."""
        self.autopilot.wind.blow(0.0, 0.0)

    def do_satellites(self, number: int) -> None:
        """So many are in use."""
        self.autopilot.parameters.change("SIM_GPS_USED", number)

    def do_fix(self, what: tuple[int, float]) -> None:
        """The receiver reports a fix of this kind, for so long."""
        kind, seconds = what
        self.link.trouble(
            *(Way.DOWN, "GPS_RAW_INT", StreamFault.WRONG, self.now_s + seconds),
            wrong=lambda fields, _: {**fields, "fix_type": kind},
        )

    def do_accuracy(self, what: tuple[float, float]) -> None:
        """The receiver reports a position good to so many metres, for so long."""
        accuracy_m, seconds = what
        self.link.trouble(
            *(Way.DOWN, "GPS_RAW_INT", StreamFault.WRONG, self.now_s + seconds),
            wrong=lambda fields, _: {**fields, "h_acc": round(accuracy_m * 1e3)},
        )

    def do_battery(self, drain_s: float) -> None:
        """It takes so many seconds from full to empty."""
        self.autopilot.parameters.change("SIM_BAT_DRAIN", drain_s)
        self.happened(SceneEventKind.BATTERY, drain_s)

    def do_fuller(self, share: float) -> None:
        """The battery reports so much more charge."""

        def lie(fields: dict[str, Any], _rng: object) -> dict[str, Any]:
            reported = min(100, fields["battery_remaining"] + round(share * 100))
            return {**fields, "battery_remaining": reported}

        self.link.trouble(Way.DOWN, "SYS_STATUS", StreamFault.WRONG, math.inf, wrong=lie)

    def do_glitch(self, what: tuple[int, float]) -> None:
        """The battery reports so many percent for a moment; its voltage is as before."""
        percent, seconds = what
        self.link.trouble(
            *(Way.DOWN, "SYS_STATUS", StreamFault.WRONG, self.now_s + seconds),
            wrong=lambda fields, _: {**fields, "battery_remaining": percent},
        )

    def do_reboot(self, seconds: float) -> None:
        """The link is silent for so long, then the vehicle's clock starts anew."""
        self.link.silent = True
        self.agenda.add(self.now_s + seconds, ScheduledFault(0.0, "clock"))

    def do_clock(self, _: None) -> None:
        """The vehicle sends again, two seconds after its start."""
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
        late_s = self._fault_rng.choice((1.0, 3.0, 8.0))
        for name in names:
            wrong = wrong_of(name, self._fault_rng)
            self.link.trouble(Way.DOWN, name, kind, until_s, late_s=late_s, wrong=wrong)

    def do_foreign(self, seconds: float) -> None:
        """Others send on the companion's link for so long."""
        self._foreign_until_s = self.now_s + seconds

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

        def alter(fields: dict[str, Any], _rng: object) -> dict[str, Any]:
            it = fields["mission_type"] == kind and fields["seq"] == number
            return {**fields, "x": fields["x"] + (_ALTERED if it else 0)}

        self.link.trouble(
            *(Way.UP, "MISSION_ITEM_INT", StreamFault.WRONG, self.now_s + seconds), wrong=alter
        )

    # Robots

    def do_vanish(self, _: None) -> None:
        """No robot is received any more."""
        self.robots.places.clear()

    def do_carry(self, _: None) -> None:
        """Robots carry each other's poses."""
        self.robots.carry = True

    def do_mad(self, how: str) -> None:
        """Robots send nonsense."""
        self.robots.hostile = how == "sway"
        self.robots.prank = prank_of(how, self.mission, self._fault_rng, self._unix_s)

    def do_other_uav(self, seconds: float) -> None:
        """Another UAV is announced for so long."""
        self._other_until_s = self.now_s + seconds

    def _unix_s(self) -> float:
        return EPOCH_S + self.now_s

    def _announce_the_other(self) -> None:
        sought = self.seek[int(self.now_s / 20.0) % len(self.seek)]
        seek = SeekMessage(stamp_s=self._unix_s(), robot=sought)
        place = pose(self.mission.frame, self.mission.home, self._unix_s())
        self.robots.others = [("rhea", SEEK_TOPIC, seek.encode()), ("rhea", POSE_TOPIC, place)]
