"""One rehearsed flight in simulated time: vehicle, robots, companion, pilot, and a misfortune."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from typing import TYPE_CHECKING, Final

from air_router.events import RobotPose
from air_router.flight_plan import FlightPlan
from air_router.graph import WaypointGraph
from air_router.px4_mode import flight_mode
from air_router.requests import GoOn
from air_router.router import Router
from air_router.settings import Timers
from air_router.vehicle import PlanCompared, PlanReplaced, Telemetry
from geo.frame import Point
from geo.zone import Outline
from mocha_link.metrics import Direction, SyncEnded, SyncStarted
from sitl.autopilot import Autopilot
from sitl.mission_items import MissionItem, MissionType
from sitl.parameters import Parameters
from sitl.px4_modes import FlightMode
from sitl.rehearsal.asking import request_of
from sitl.rehearsal.companion import Companion, Link
from sitl.rehearsal.drawing import STOP_M, Drawing
from sitl.rehearsal.faults import Fault, Scene
from sitl.rehearsal.judge import End, Judge, Verdict
from sitl.situation import Place
from sitl.wind import WindSettings

if TYPE_CHECKING:
    from collections.abc import Callable

    from air_router.flight_plan import PlanItem
    from air_router.mission import Mission

REAL32: Final = 9  # MAV_PARAM_TYPE
STEP_S: Final = 0.02
TICK_S: Final = 0.1
MOST_S: Final = 900.0
BOOT_S: Final = 5.0
FENCE_S: Final = 1.0
"""What PX4 takes to load a fence and judge the mission by it."""

HEARD_M: Final = 60.0
SYNC_EVERY_S: Final = 2.0
HOME_M: Final = 3.0
MOVING_M_S: Final = 1.0
PILOT_S: Final = 25.0
"""For so long a pilot (or nobody) is watched after the vehicle was given away."""

ZONE_M: Final = 15.0
SEEK: Final = ("callisto", "europa", "io")
_PILOT_MODES: Final = (
    FlightMode.AUTO_LOITER,
    FlightMode.AUTO_RTL,
    FlightMode.ORBIT,
    FlightMode.AUTO_LAND,
)
_EASY: Final = Timers(init_s=40.0, explore_s=25.0, search_s=10.0, communicate_s=10.0)


def hurried(mission: Mission) -> Mission:
    """A mission in a hurry: the paper's times divided, a few minutes in all."""
    return dataclasses.replace(mission, timers=_EASY, speed_m_s=5.0, duration_s=170.0)


class Stage:
    """Flies one scene.

    Args:
        scene: What goes wrong.
        mission: What is flown.
        router: Its router, which all flights of a mission can share.
    """

    def __init__(self, scene: Scene, mission: Mission, router: Router | None = None) -> None:
        self.scene = scene
        self.mission = mission
        self.judge = Judge(mission)
        self._router = router or Router(WaypointGraph(mission))
        self._plan = FlightPlan.of(mission)
        latitude_deg, longitude_deg = mission.frame.to_geodetic(mission.home)
        place = Place(latitude_deg, longitude_deg, mission.home_altitude_amsl_m or 0.0)
        self.autopilot = Autopilot(
            place,
            Parameters({"SIM_BAT_DRAIN": 1500.0, "SIM_BAT_MIN_PCT": 0.0}),
            seed=scene.seed,
            wind=self._wind(),
        )
        self.link = Link(scene.chance("link"), scene.loss, scene.late_s, scene.old_s)
        self._chance = scene.chance("stage")
        self._drawing = Drawing(self.judge, self._chance, scene.late_s)
        self._robots = {name: self._anywhere() for name in SEEK}
        self._synced_s = dict.fromkeys(SEEK, -math.inf)
        self.companion: Companion | None = self._companion()
        self._todo = deque(scene.misfortunes())
        self._alive = True
        self._pilot: FlightMode | None = None
        self._given_away_s: float | None = None
        self._failsafe_seen = False
        self._fix = True
        self._jump = (0.0, 0.0)
        self._resumes_s = math.inf
        self._plan_ids = 0

    @property
    def now_s(self) -> float:
        """Simulated time."""
        return self.autopilot.time_s

    # The flight.

    def fly(self) -> Verdict:
        """From power-on to the end."""
        if Fault.UPLOAD in self.scene.faults and self.scene.seed % 2:
            return self._verdict(End.STAYED)  # refused for good: nothing is armed
        while self.now_s < BOOT_S:
            self.autopilot.step(STEP_S)
        self._board()
        while self.now_s < BOOT_S + FENCE_S:
            self.autopilot.step(STEP_S)
        self._tick()
        self.autopilot.arm()
        self.autopilot.request_mode(FlightMode.AUTO_MISSION)
        began_s, flew, end = self.now_s, False, End.NOT
        while end is End.NOT and self.now_s < began_s + MOST_S:
            for _ in range(round(TICK_S / STEP_S)):
                self.autopilot.step(STEP_S)
            flew |= not self.autopilot.situation.landed
            self._tick()
            end = self._ended(flew=flew)
        return self._verdict(end)

    def _tick(self) -> None:
        while self._todo and self._todo[0].at_s <= self.now_s - BOOT_S:
            _, what, value = self._todo.popleft()
            self._happen(what, value)
        self.link.deliver(self.now_s)
        self.autopilot.take_notices()
        place = self._truth()
        companion = self.companion
        self._failsafe_seen |= self._failsafe
        if not self.autopilot.situation.landed:
            self.judge.see(place, TICK_S, ours=self._ours())
        if companion is None:
            return
        companion.listen(self.link.said(self._telemetry()), self.now_s)
        if self.now_s >= self._resumes_s:
            self._ask_to_resume(companion)
        self._gossip(companion, place)
        companion.step(self.now_s)

    def _ours(self) -> bool:
        """Whether we answer for where the vehicle is: by our command, or its consequence."""
        return self._pilot is None and not self._failsafe

    @property
    def _failsafe(self) -> bool:
        return self.autopilot.failsafe.acting

    def _ended(self, *, flew: bool) -> End:
        if flew and not self.autopilot.armed:
            return self._landed()
        companion = self.companion
        given_away = companion is not None and flew and not companion.controller.in_charge
        if self._todo or not (given_away or companion is None):
            self._given_away_s = None
            return End.NOT
        if self._given_away_s is None:
            self._given_away_s = self.now_s
        asked = companion is not None and self._resumes_s < math.inf
        if asked or self.now_s - self._given_away_s < PILOT_S:
            return End.NOT
        others = End.HOVERS if companion is None else End.PILOT
        return End.FAILSAFE if self._failsafe_seen else others

    def _landed(self) -> End:
        if self._failsafe_seen:
            return End.FAILSAFE
        if self._pilot is not None:
            return End.PILOT
        home_m = math.dist(self._truth(), self.mission.home)
        return End.LANDED if home_m <= HOME_M + self._jumped_m() else End.NOT

    def _jumped_m(self) -> float:
        return math.hypot(self.autopilot.errors.north_m, self.autopilot.errors.east_m)

    def _verdict(self, end: End) -> Verdict:
        faults = self.scene.faults
        allowed = {End.LANDED, End.PILOT, End.FAILSAFE}
        if Fault.KILL in faults:
            allowed.add(End.HOVERS)  # and returns by the autopilot's own rules when it has to
        if Fault.UPLOAD in faults:
            allowed.add(End.STAYED)
        pilots = {Fault.PILOT, Fault.HAND_BACK, Fault.PAUSE, Fault.ZONE, Fault.JUMPS, Fault.GUSTS}
        pilots |= {Fault.LATE, Fault.OLD}  # what is late may look like a pilot's
        if not faults & pilots:
            allowed.discard(End.PILOT)
        said = [] if self.companion is None else self.companion.actions
        texts = [getattr(action, "text", "") for action in said]
        return Verdict(
            scene=str(self.scene),
            fault=self.scene.fault.name,
            end=end,
            deepest_m=self.judge.deepest_m,
            flown_s=self.judge.ours_s,
            expected=end in allowed,
            why="; ".join(text for text in texts if text)[-200:],
        )

    # What the companion perceives.

    def _truth(self) -> Point:
        return self._place(self.autopilot.airframe.north_m, self.autopilot.airframe.east_m)

    def _place(self, north_m: float, east_m: float) -> Point:
        degrees = self.autopilot.situation.projection.to_global(north_m, east_m)
        return self.mission.frame.to_local(*degrees)

    def _north_east(self, point: Point) -> tuple[float, float]:
        projection = self.autopilot.situation.projection
        return projection.to_local(*self.mission.frame.to_geodetic(point))

    def _telemetry(self) -> Telemetry:
        autopilot, situation = self.autopilot, self.autopilot.situation
        setpoint = autopilot.setpoint
        mode = flight_mode(autopilot.mode.custom_mode)
        hovers = autopilot.mode in {FlightMode.AUTO_LOITER, FlightMode.AUTO_MISSION}
        return Telemetry(
            time_s=self.now_s,
            position=self._place(situation.north_m, situation.east_m),
            altitude_m=situation.altitude_m - situation.home_altitude_m,
            velocity_m_s=(situation.velocity_m_s[1], situation.velocity_m_s[0]),
            armed=autopilot.armed,
            in_air=not situation.landed,
            mode=mode,
            failsafe=self._failsafe,
            battery=autopilot.battery.remaining,
            item=autopilot.mission.index,
            fix=self._fix,
            target=self._place(setpoint.north_m, setpoint.east_m) if hovers else None,
        )

    def _gossip(self, companion: Companion, place: Point) -> None:
        for name, robot in self._robots.items():
            if (
                math.dist(robot, place) > HEARD_M
                or self.now_s - self._synced_s[name] < SYNC_EVERY_S
            ):
                continue
            self._synced_s[name] = self.now_s
            for direction in Direction:
                companion.hear(SyncStarted(name, self.now_s, direction))
            companion.hear(RobotPose(name, robot, self.now_s, name))
            for direction in Direction:
                companion.hear(SyncEnded(name, self.now_s, direction, 1, 100, 0.1))

    def _anywhere(self) -> Point:
        waypoint = self._chance.choice(self.mission.waypoints).position
        return Point(
            waypoint.east_m + self._chance.uniform(-30.0, 30.0),
            waypoint.north_m + self._chance.uniform(-30.0, 30.0),
        )

    def _companion(self) -> Companion:
        return Companion(
            self.mission,
            self._plan,
            self._router,
            self.autopilot,
            self.link,
            seek=SEEK,
            north_east=self._north_east,
            board=self._store,
        )

    def _board(self) -> None:
        """Mission and fence, as the upload has put them on board."""
        self._store(MissionType.FENCE, self._plan.fence)
        self._store(MissionType.MISSION, self._plan.items)

    def _store(self, kind: MissionType, items: tuple[PlanItem, ...]) -> None:
        self._plan_ids += 1
        self.autopilot.plan.store(kind, tuple(map(_stored, items)), self._plan_ids, 0)

    # What goes wrong.

    def _wind(self) -> WindSettings:
        if Fault.GUSTS not in self.scene.faults:
            return WindSettings()
        dice = self.scene.chance("wind")
        mean_m_s = dice.uniform(3.0, 7.0)
        return WindSettings(mean_m_s, dice.uniform(0.0, 360.0), (10.0 - mean_m_s) / 2.0)

    def _happen(self, what: str, value: float) -> None:
        happenings: dict[str, Callable[[float], object]] = {
            "jump": self._jump_by,
            "jump back": lambda _: self._shift(-self._jump[0], -self._jump[1]),
            "silent": lambda on: setattr(self.link, "silent", bool(on)),
            "fix": lambda on: setattr(self, "_fix", bool(on)),
            "busy": lambda on: setattr(self.link, "busy", bool(on)),
            "kill": lambda _: setattr(self, "companion", None),
            "restart": lambda _: self._restart(),
            "battery": self._drain,
            "vanish": lambda _: self._robots.clear(),
            "zone": self._add_zone,
            "reload": self._reload,
            "wall": self._wall,
            "open": lambda _: self._open(),
            "request": self._ask,
            "pilot": lambda choice: self._choose(_PILOT_MODES[int(choice)]),
            "hand back": lambda _: self._hand_back(),
            "pause": lambda divert: self._pause(divert=bool(divert)),
        }
        happenings[what](value)

    def _jump_by(self, angle_rad: float) -> None:
        size_m = self._chance.uniform(1.0, 4.0)
        north_m, east_m = self._jump
        self._shift(size_m * math.cos(angle_rad) - north_m, size_m * math.sin(angle_rad) - east_m)

    def _shift(self, north_m: float, east_m: float) -> None:
        self.autopilot.errors.jump(north_m, east_m)
        self._jump = (self._jump[0] + north_m, self._jump[1] + east_m)

    def _drain(self, drain_s: float) -> None:
        self.autopilot.parameters.set("SIM_BAT_DRAIN", drain_s, REAL32)

    def _choose(self, mode: FlightMode) -> None:
        """The pilot takes the vehicle, in a mode that is not the one it is in."""
        autopilot = self.autopilot
        if autopilot.situation.landed or self._failsafe:
            return
        if autopilot.mode is mode:
            mode = FlightMode.AUTO_RTL
        if autopilot.request_mode(mode, forced=mode is FlightMode.AUTO_LAND):
            self._pilot = mode

    def _hand_back(self) -> None:
        if self._pilot is not None and not self.autopilot.situation.landed:
            self.autopilot.request_mode(FlightMode.AUTO_LOITER)
            self._resumes_s = self.now_s + 2.0

    def _ask_to_resume(self, companion: Companion) -> None:
        """The operator asks until it is ours again: it may still be too low, or in a zone."""
        self._resumes_s = self.now_s + 2.0
        companion.hear(GoOn())
        if companion.controller.in_charge:
            self._pilot = None
            self._resumes_s = math.inf
        elif self.now_s > BOOT_S + MOST_S / 3:
            self._resumes_s = math.inf  # it cannot be: the pilot keeps it

    def _pause(self, *, divert: bool) -> None:
        """The pilot pauses or diverts the vehicle without choosing a mode that is not ours."""
        autopilot, companion = self.autopilot, self.companion
        flying = not autopilot.situation.landed and not autopilot.mission.climbing
        if self._pilot is not None or companion is None or not (flying and self._ours()):
            return
        if companion.controller.custody.pending is not None:
            return
        situation = autopilot.situation
        if autopilot.mode is FlightMode.AUTO_MISSION and divert:
            last = len(self._plan.items) - 1
            autopilot.plan.set_current(last if autopilot.mission.index != last else last - 1)
        elif autopilot.mode is FlightMode.AUTO_LOITER and divert:
            autopilot.reposition((situation.north_m + 12.0, situation.east_m), None)
        elif (
            autopilot.mode is FlightMode.AUTO_LOITER
            and math.hypot(*situation.velocity_m_s[:2]) > MOVING_M_S
        ):
            autopilot.reposition(None, None)
        else:
            return
        self._pilot = autopilot.mode

    def _restart(self) -> None:
        """A new companion finds the flight, and is asked to go on with it."""
        if not self.autopilot.armed:
            return
        self.companion = self._companion()
        self._resumes_s = self.now_s + 3.0

    def _ask(self, choice: float) -> None:
        """Somebody asks for something, at whatever moment; but never for the pilot's vehicle."""
        if self.companion is not None and self._pilot is None:
            here = self._truth()
            self.companion.hear(request_of(choice, self._chance, self.mission, here))

    def _add_zone(self, ahead_m: float) -> None:
        """A ground station puts a fence with one more zone on board, ahead of the vehicle."""
        airframe, place = self.autopilot.airframe, self._truth()
        speed_m_s = math.hypot(airframe.velocity_east_m_s, airframe.velocity_north_m_s)
        if self.companion is None or self.autopilot.situation.landed:
            return
        east = airframe.velocity_east_m_s / speed_m_s if speed_m_s > 1.0 else 1.0
        north = airframe.velocity_north_m_s / speed_m_s if speed_m_s > 1.0 else 0.0
        ahead_m += STOP_M + ZONE_M
        centre = Point(place.east_m + east * ahead_m, place.north_m + north * ahead_m)
        corners = ((-ZONE_M, -ZONE_M), (ZONE_M, -ZONE_M), (ZONE_M, ZONE_M), (-ZONE_M, ZONE_M))
        ring = tuple(Point(centre.east_m + e / 1.5, centre.north_m + n / 1.5) for e, n in corners)
        self.judge.added.append(Outline(ring))
        self.companion.hear(PlanReplaced(self.now_s, only_fence=True))
        self.companion.hear(PlanCompared(self.now_s, "the fence: one more zone is on board"))

    def _reload(self, ahead_m: float) -> None:
        """The operator draws a zone near the vehicle, or over it, and has the file read again."""
        if self.companion is not None and not self.autopilot.situation.landed:
            ahead = self.autopilot.airframe
            course_rad = math.atan2(ahead.velocity_east_m_s, ahead.velocity_north_m_s)
            self._drawing.circle(self.companion, self._truth(), course_rad, ahead_m)

    def _wall(self, side: float) -> None:
        """The operator walls the vehicle in, zone by zone."""
        if self.companion is not None and not self.autopilot.situation.landed:
            self._drawing.wall(self.companion, self._truth(), int(side))

    def _open(self) -> None:
        if self.companion is not None:
            self._drawing.open(self.companion)


def _stored(item: PlanItem) -> MissionItem:
    return MissionItem(
        frame=int(item.frame),
        command=int(item.command),
        autocontinue=item.autocontinue,
        params=item.params,
        x=item.x_deg_e7,
        y=item.y_deg_e7,
        z=item.z_m,
    )
