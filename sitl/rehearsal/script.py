"""Makes the faults of a scene happen, when their phase of the flight has come."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from air_router.controller.model.requests import ComeHome, ExploreNow, GoOn
from air_router.messages import POSE_TOPIC, SEEK_TOPIC, SeekMessage
from sitl.px4sim.plan_store import MissionType
from sitl.px4sim.state import FlightMode
from sitl.rehearsal.adversarial_operator import AdversarialOperator
from sitl.rehearsal.companion import EPOCH_S
from sitl.rehearsal.courses import ScheduledFault
from sitl.rehearsal.faults import PHASES, Scene
from sitl.rehearsal.judge.evidence import SceneEventKind
from sitl.rehearsal.operator import Operator
from sitl.rehearsal.scenario import Scenario
from sitl.rehearsal.stand_ins.link import StreamFault, Way, wrong_of
from sitl.rehearsal.stand_ins.team import pose, prank_of

STICKS_S: Final = 3.0
_RESUME_S: Final = 2.0
MOVING_M_S: Final = 1.0
_ACK_ERROR, _NO_SPACE = 1, 4  # MAV_MISSION_RESULT


class Script:
    """What happens in one flight.

    Args:
        scenario: Where.
        schedule: What.

    Attributes:
        done: Whether everything that can happen has happened.
    """

    def __init__(self, scenario: Scenario, schedule: list[ScheduledFault]) -> None:
        self._scenario = scenario
        self._dice = scenario.scene.chance("script")
        self._waiting = schedule
        self._due: list[tuple[float, ScheduledFault]] = []  # simulated time, in its order
        self._phases: set[str] = set()  # that the flight has come to
        self._jump = (0.0, 0.0)  # north and east, m: sum of the jumps
        self._sticks_from_s = self._moved_until_s = math.inf  # heard from, moved until
        self._other_until_s = -math.inf  # so long another UAV is heard
        operator = self._operator = Operator(scenario, self._dice)
        haste = self._haste = AdversarialOperator(scenario, operator)
        self._handlers: dict[str, Callable[[Any], object]] = {  # by `ScheduledFault.what`
            "jump": self._jump_by,
            "jump back": lambda _: self._shift(-self._jump[0], -self._jump[1]),
            "off": lambda off: self._errors.jump(off[0], 0.0, off[1]),
            "drift": self._drift,
            "busy": self._busy,
            "silent": lambda on: setattr(scenario.link, "silent", on),
            "stream": self._stream,
            "satellites": lambda number: scenario.stations.parameter("SIM_GPS_USED", number),
            "reject": self._reject,
            "pilot": self._pilot,
            "second station": lambda mode: self._choose(FlightMode[mode], first=False),
            "sticks": self._sticks,
            "too early": lambda _: self._ask_too_early(),
            "hand back": lambda _: self._hand_back(),
            "take back": lambda _: self._take_back(),
            "pause": self._pause,
            "disarm": self._disarm,
            "home": self._home,
            "speed": lambda m_s: scenario.stations.first.change_speed(m_s),  # noqa: PLW0108 - later
            "plan": self._plan,
            "fence": self._fence,
            "reboot": self._reboot,
            "clock": lambda _: self._clock_anew(),
            "stall": scenario.stall,
            "kill": lambda _: scenario.kill(),
            "restart": lambda _: scenario.restart(),
            "battery": self._battery,
            "fuller": self._fuller,
            "vanish": lambda _: scenario.robots.places.clear(),
            "other uav": self._other_uav,
            "mad": self._mad,
            "reload": operator.reload,
            "wall": operator.wall,
            "enclose": lambda _: operator.enclose(),
            "open": lambda _: operator.open(),
            "request": operator.request,
            "deaf": haste.deaf,
            "hold": haste.hold,
            "send": haste.send,
            "send again": haste.send_again,
            "zone over": haste.over,
            "zone across": haste.across,
            "corner": haste.corner,
        }

    @property
    def done(self) -> bool:
        """Whether nothing more is to come soon."""
        return not self._due and not self._operator.asks_on

    def enter(self, phase: str, now_s: float) -> None:
        """A phase of the flight begins, perhaps again; on the way home what never came comes."""
        if phase in self._phases:
            return
        self._phases.add(phase)
        if phase == "HOME":
            for missed in PHASES[: PHASES.index(phase)]:
                self.enter(missed, now_s)
        for scheduled in self._waiting:
            if scheduled.phase == phase and math.isfinite(scheduled.at_s):
                self._due.append((now_s + scheduled.at_s, scheduled))
        self._due.sort(key=lambda entry: entry[0])

    def step(self, now_s: float) -> None:
        """Let happen what is due."""
        while self._due and self._due[0][0] <= now_s:
            _, scheduled = self._due.pop(0)
            self._scenario.happened(SceneEventKind.FAULT, scheduled.what)
            self._handlers[scheduled.what](scheduled.value)
        self._haste.step(now_s)
        self._operator.step(now_s)
        if now_s >= self._sticks_from_s:
            moved = now_s < self._moved_until_s
            self._scenario.stations.first.sticks(0.5 if moved else 0.0, 0.3 if moved else 0.0)
        if now_s < self._other_until_s:
            self._tell_of_the_other()

    # The vehicle's own

    @property
    def _errors(self) -> Any:
        return self._scenario.autopilot.errors

    def _jump_by(self, angle_rad: float) -> None:
        size_m = self._dice.uniform(1.0, 4.0)
        north_m, east_m = self._jump
        self._shift(size_m * math.cos(angle_rad) - north_m, size_m * math.sin(angle_rad) - east_m)

    def _shift(self, north_m: float, east_m: float) -> None:
        self._errors.jump(north_m, east_m)
        self._jump = (self._jump[0] + north_m, self._jump[1] + east_m)

    def _drift(self, off: tuple[float, float, float]) -> None:
        size_m, angle_rad, up_m = off
        self._errors.jump(size_m * math.cos(angle_rad), size_m * math.sin(angle_rad), up_m)

    def _battery(self, drain_s: float) -> None:
        self._scenario.stations.parameter("SIM_BAT_DRAIN", drain_s)
        self._scenario.happened(SceneEventKind.BATTERY, drain_s)

    def _fuller(self, share: float) -> None:
        def lie(fields: dict[str, Any], _dice: object) -> dict[str, Any]:
            said = min(100, fields["battery_remaining"] + round(share * 100))
            return {**fields, "battery_remaining": said}

        self._scenario.link.trouble(Way.DOWN, "SYS_STATUS", StreamFault.WRONG, math.inf, wrong=lie)

    def _reboot(self, seconds: float) -> None:
        self._scenario.link.silent = True
        back = ScheduledFault(0.0, "clock")
        self._due.append((self._scenario.now_s + seconds, back))
        self._due.sort(key=lambda entry: entry[0])

    def _clock_anew(self) -> None:
        self._scenario.link.silent = False
        self._scenario.link.reboot(self._scenario.now_s - 2.0)

    # The link

    def _stream(self, what: tuple[tuple[str, ...], StreamFault, float]) -> None:
        names, kind, seconds = what
        until_s = self._scenario.now_s + seconds
        late_s = self._dice.choice((1.0, 3.0, 8.0))
        for name in names:
            wrong = wrong_of(name, self._dice)
            self._scenario.link.trouble(Way.DOWN, name, kind, until_s, late_s=late_s, wrong=wrong)

    def _reject(self, for_good: int) -> None:
        result, seconds = (_NO_SPACE, math.inf) if for_good else (_ACK_ERROR, 6.0)
        until_s = self._scenario.now_s + seconds
        self._scenario.link.trouble(
            *(Way.DOWN, "MISSION_ACK", StreamFault.WRONG, until_s),
            wrong=lambda fields, _: {**fields, "type": result},
        )

    def _busy(self, on: bool) -> None:
        stations = self._scenario.stations
        stations.download() if on else stations.downloaded()

    # Pilot and stations

    @property
    def _flies(self) -> bool:
        return self._operator.flies

    def _taken(self, how: str) -> None:
        self._operator.pilot = True
        self._scenario.happened(SceneEventKind.PILOT, how)

    def _pilot(self, name: str) -> None:
        mode = FlightMode[name]
        if mode.needs_pilot:
            self._sticks_from_s = min(self._sticks_from_s, self._scenario.now_s)
            self._scenario.stations.first.sticks()
        if self._scenario.autopilot.mode is mode:
            mode = FlightMode.AUTO_RTL
        self._choose(mode)

    def _choose(self, mode: FlightMode, *, first: bool = True) -> None:
        stations = self._scenario.stations
        station = stations.first if first else stations.second
        if self._flies and stations.chosen(mode, station):
            self._taken(mode.name)

    def _sticks(self, override: bool) -> None:
        self._scenario.stations.parameter("COM_RC_OVERRIDE", int(override))
        now_s = self._scenario.now_s
        self._scenario.stations.first.sticks()  # at rest first: what moves is taken for the pilot's
        self._sticks_from_s, self._moved_until_s = now_s + 0.1, now_s + STICKS_S
        if override:
            self._taken("sticks")

    def _hand_back(self) -> None:
        if self._operator.pilot and self._flies:
            self._scenario.stations.first.choose(FlightMode.AUTO_LOITER)
            self._operator.resume(after_s=_RESUME_S)

    def _ask_too_early(self) -> None:
        """The operator asks for the vehicle while the pilot still flies it in another mode."""
        mode = self._scenario.autopilot.mode
        free = mode in {FlightMode.AUTO_LOITER, FlightMode.AUTO_MISSION}
        if self._operator.pilot and self._flies and not free:
            self._operator.ask(self._dice.choice((GoOn(), ComeHome(), ExploreNow())))

    def _take_back(self) -> None:
        """The operator has our plan put on board again, and the flight resumed."""
        if self._flies:
            self._operator.resume(after_s=0.0, upload=True)

    def _pause(self, divert: bool) -> None:
        """The pilot pauses or diverts the vehicle without choosing a mode that is not ours."""
        autopilot, companion = self._scenario.autopilot, self._scenario.companion
        if companion is None or self._operator.pilot or not self._flies:
            return
        pending = companion.flight.controller.gate.pending
        if autopilot.mission.climbing or pending is not None:
            return
        moving = math.hypot(*autopilot.situation.velocity_m_s[:2]) > MOVING_M_S
        if autopilot.mode is FlightMode.AUTO_MISSION and divert:
            if self._scenario.stations.divert():
                self._taken("item")
        elif autopilot.mode is FlightMode.AUTO_LOITER and (divert or moving):
            place = (autopilot.situation.north_m + 12.0, autopilot.situation.east_m)
            autopilot.reposition(place if divert else None, None)
            self._taken("reposition")

    def _disarm(self, forced: bool) -> None:
        was_armed = self._scenario.autopilot.armed
        self._scenario.stations.first.disarm(forced=forced)
        if was_armed and not self._scenario.autopilot.armed:
            self._scenario.happened(SceneEventKind.DISARMED, "station")

    def _home(self, by: tuple[float, float]) -> None:
        situation = self._scenario.autopilot.situation
        if situation.home is None:
            return
        side_m, up_m = by
        north_m, east_m = situation.home
        degrees = situation.projection.to_global(north_m, east_m + side_m)
        amsl_m = situation.home_altitude_m + up_m
        self._scenario.stations.first.move_home(*degrees, amsl_m)
        self._scenario.happened(SceneEventKind.HOME_MOVED, (*degrees, amsl_m))

    def _plan(self, which: str) -> None:
        stations = self._scenario.stations
        if not self._flies:
            return
        lands = self._scenario.autopilot.mode is FlightMode.AUTO_LAND
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

    def _fence(self, ahead_m: float | None) -> None:
        if not self._flies:
            return
        if ahead_m is None:
            self._scenario.stations.delete(MissionType.FENCE)
            self._scenario.happened(SceneEventKind.FENCE_CHANGED, "deleted")
        else:
            self._scenario.stations.add_zone(ahead_m)
            self._scenario.happened(SceneEventKind.FENCE_CHANGED, "added")

    # Robots

    def _mad(self, how: str) -> None:
        self._scenario.robots.prank = prank_of(
            how, self._scenario.mission, self._dice, self._unix_s
        )

    def _unix_s(self) -> float:
        return EPOCH_S + self._scenario.now_s

    def _other_uav(self, seconds: float) -> None:
        self._other_until_s = self._scenario.now_s + seconds

    def _tell_of_the_other(self) -> None:
        sought = self._scenario.seek[int(self._scenario.now_s / 20.0) % len(self._scenario.seek)]
        seek = SeekMessage(stamp_s=self._unix_s(), robot=sought)
        mission = self._scenario.mission
        place = pose(mission.frame, mission.home, self._unix_s())
        self._scenario.robots.others = [
            ("rhea", SEEK_TOPIC, seek.encode()),
            ("rhea", POSE_TOPIC, place),
        ]


def scenario_of(scene: Scene, path: Path) -> Scenario:
    """The scenario for one scene of a mission."""
    return Scenario(scene, path, lambda scenario: Script(scenario, scene.schedule()))
