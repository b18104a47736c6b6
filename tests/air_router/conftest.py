"""A pretended flight: the pure controller in a world of points, as fast as Python runs."""

from __future__ import annotations

import asyncio
import copy
import dataclasses
import math
import random
from pathlib import Path

import pytest

from air_router.controller.controller import Controller
from air_router.controller.model.actions import (
    Announce,
    CommandAck,
    Finish,
    FlyToNode,
    FlyToPoint,
    HoldHere,
    LandHere,
    MissionWaits,
    PublishMap,
    ReadAgain,
    RenewPlan,
    ReplanAirspace,
    Seeking,
    StateChanged,
)
from air_router.controller.model.events import (
    CommandConfirmed,
    CommandFailed,
    RobotPath,
    RobotPose,
)
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.requests import HoldNow
from air_router.controller.model.states import State
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.loading import load_mission
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Router
from air_router.vehicle.airframe import Airframe as VehicleType
from air_router.vehicle.vehicle import (
    FlightMode,
    GpsFix,
    Inspection,
    PlanCompared,
    PlanReplaced,
    Telemetry,
    Vehicle,
    VehicleInfo,
)
from geo.frame import Point
from mocha_link.links.metrics import Direction, SyncEnded, SyncStarted

MISSIONS = Path(__file__).parents[2] / "missions"
STEP_S = 0.2  # no rule counts shorter times
ACCELERATION_M_S2 = 3.0
CLIMB_M_S = 1.5
SYNC_EVERY_S = 2.0
SYNC_TAKES_S = 0.3
CORNERS = {"callisto": Point(-150.0, 60.0), "europa": Point(75.0, -150.0), "io": Point(64.0, 0.0)}


class Airframe:
    """A point with inertia that flies straight to its target and stops there."""

    def __init__(self, mission, step_s=STEP_S):
        self.mission = mission
        self.step_s = step_s
        self.now_s = 100.0
        self.position = mission.home
        self.velocity = (0.0, 0.0)
        self.altitude_m = 0.0
        self.mode = FlightMode.HOLD
        self.armed = self.in_air = False
        self.battery = 1.0
        self.failsafe = self.terminated = False
        self.fix = True
        self.voltage_v = None  # as the charge has it
        self.home_moved = None
        self.target = None
        self.target_altitude_m = None
        self.track = []
        self.noise_m = 0.0
        self.shown = {}  # reported in place of the true values
        self._chance = random.Random(1)

    def take_off(self):
        self.armed = self.in_air = True
        self.mode = FlightMode.MISSION
        self.altitude_m = self.mission.altitude_above_home_m

    def move(self):
        self.now_s += self.step_s
        wanted = self.wanted()
        change = (wanted[0] - self.velocity[0], wanted[1] - self.velocity[1])
        size, limit = math.hypot(*change), ACCELERATION_M_S2 * self.step_s
        if size > limit:
            change = (change[0] / size * limit, change[1] / size * limit)
        self.velocity = (self.velocity[0] + change[0], self.velocity[1] + change[1])
        self.position = Point(
            self.position[0] + self.velocity[0] * self.step_s,
            self.position[1] + self.velocity[1] * self.step_s,
        )
        if self.in_air:
            self.track.append(self.position)
        if self.mode is FlightMode.HOLD and self.target_altitude_m is not None:
            missing_m = self.target_altitude_m - self.altitude_m
            change_m = CLIMB_M_S * self.step_s
            self.altitude_m += max(-change_m, min(change_m, missing_m))
        if self.mode is FlightMode.LAND and self.in_air:
            self.altitude_m -= 0.7 * self.step_s
            if self.altitude_m <= 0:
                self.in_air = self.armed = False

    def _voltage_v(self):
        """Of four cells, as it falls with the charge; unless a test sets it."""
        if self.voltage_v is not None or self.battery is None:
            return self.voltage_v
        return 14.0 + 2.8 * self.battery

    def telemetry(self):
        telemetry = Telemetry(
            time_s=self.now_s,
            position=self._measured(),
            altitude_m=self.altitude_m,
            velocity_m_s=self.velocity,
            armed=self.armed,
            in_air=self.in_air,
            mode=self.mode,
            failsafe=self.failsafe,
            terminated=self.terminated,
            battery=self.battery,
            voltage_v=self._voltage_v(),
            fix=self.fix,
            home_moved=self.home_moved,
        )
        return dataclasses.replace(telemetry, **self.shown)

    def _measured(self):
        if not self.noise_m:
            return self.position
        return Point(*(self._chance.gauss(x, self.noise_m) for x in self.position))

    def wanted(self):
        if self.target is None:
            return (0.0, 0.0)
        east, north = self.target[0] - self.position[0], self.target[1] - self.position[1]
        away = math.hypot(east, north)
        if away < 1e-9:
            return (0.0, 0.0)
        brakes = math.sqrt(2 * ACCELERATION_M_S2 * away)
        pace = min(self.mission.speed_m_s, brakes, away / self.step_s)
        return (east / away * pace, north / away * pace)


LONGEST_S = 3600.0
"""No flight of a test takes longer: one that would wait for ever fails instead."""


class PretendFlight(Airframe):
    """Flies a controller among robots that the vehicle receives within a radius."""

    def __init__(self, mission, *, radius_m=60.0, seek=("callisto", "europa", "io"), **how):
        super().__init__(mission, how.pop("step_s", STEP_S))
        self.plan = FlightPlan.of(mission)
        self.router = Router(WaypointGraph(mission))
        self.name = how.get("name", "")
        self.controller = Controller(FlightSetup(mission, seek, **how), self.router, self.plan)
        self.radius_m = radius_m
        self.robots = {}
        self.destinations = {}
        self.deaf = False  # commands are lost
        self.slow = False  # commands are under way
        self.actions = []
        self.events = []
        self.finished = None
        self._syncs = {}

    # Verbs.

    def take_off(self):
        super().take_off()
        self.step()

    def take_off_halfway(self, mode=FlightMode.MISSION):
        super().take_off()
        self.altitude_m /= 2
        self.pilot_chooses(mode)

    def step(self):
        self.move()
        self._gossip()
        self.give(self.telemetry())

    def fly_until(self, condition, limit_s=2000.0):
        end_s = self.now_s + limit_s
        while not condition():
            assert self.now_s < end_s, f"not within {limit_s} s; now {self.controller.state}"
            self.step()

    def fly_for(self, seconds):
        for _ in range(round(seconds / self.step_s)):
            self.step()

    def ends(self, limit_s=2000.0):
        self.fly_until(lambda: self.finished is not None, limit_s)

    def lands(self, limit_s=2000.0):
        self.ends(limit_s)
        assert self.finished.landed_by_us

    def fly_to_state(self, state, limit_s=2000.0):
        self.fly_until(lambda: self.controller.state is state, limit_s)

    def fly_away(self):
        self.fly_until(lambda: math.dist(self.position, self.mission.home) > 60.0)

    def hold_away(self):
        """Take off, and hover on request somewhere on the way."""
        self.take_off()
        self.fly_away()
        self.operator_requests(HoldNow())
        self.fly_for(6.0)
        assert self.controller.state is State.HOLD

    def plan_compared(self, difference=None, *, only_fence=False):
        """The plan on board is replaced, and the difference is reported at once."""
        self.give(PlanReplaced(self.now_s, only_fence))
        self.give(PlanCompared(self.now_s, difference))

    def closest_m(self):
        return self.mission.airspace.track_distance_m(self.track)[0]

    def pilot_chooses(self, mode):
        self.mode = mode
        self.target = self.target_altitude_m = None
        self.step()

    def operator_requests(self, request):
        self.give(request)
        return next((a for a in reversed(self.actions) if isinstance(a, CommandAck)), None)

    def deliver(self, request):
        """What is decided on a request."""
        before = len(self.actions)
        self.give(request)
        return self.actions[before:]

    # What happened.

    @property
    def states(self):
        return [a.target for a in self.actions if isinstance(a, StateChanged)]

    @property
    def announcements(self):
        return [a for a in self.actions if isinstance(a, Announce)]

    @property
    def announced(self):
        """The texts of the announcements, without the instructions to the pilot or operator."""
        return [a.text for a in self.announcements]

    @property
    def motions(self):
        return [
            a for a in self.actions if isinstance(a, FlyToNode | FlyToPoint | HoldHere | LandHere)
        ]

    def give(self, event):
        self.events.append((event, self.now_s))
        for action in self.controller.handle(event, self.now_s):
            self.actions.append(action)
            self.act(action)

    def act(self, action):
        match action:
            case StateChanged() | Announce() | PublishMap() | Seeking() | ReadAgain() | RenewPlan():
                return
            case ReplanAirspace() | CommandAck() | MissionWaits():
                return
            case Finish():
                self.finished = action
                return
        if self.slow:
            return  # the test decides what becomes of it
        if self.deaf:
            self.give(CommandFailed(action, "deaf"))
            return
        match action:
            case FlyToNode(node=node, position=position):
                assert self.plan.item_of(node) >= self.plan.item_of(0)
                self.mode, self.target = FlightMode.MISSION, position
            case FlyToPoint(position=position, altitude_m=altitude_m):
                self.mode, self.target = FlightMode.HOLD, position
                self.target_altitude_m = altitude_m
            case HoldHere():
                self.mode, self.target = FlightMode.HOLD, None
                self.target_altitude_m = None
            case LandHere():
                self.mode, self.target = FlightMode.LAND, None
        self.give(CommandConfirmed(action))

    def _gossip(self):
        for name, place in self.robots.items():
            near = math.dist(place, self.position) <= self.radius_m
            began_s = self._syncs.get(name)
            if began_s is None:
                if near and self.now_s - self._syncs.get((name, "last"), -1e9) >= SYNC_EVERY_S:
                    self._syncs[name] = self._syncs[name, "last"] = self.now_s
                    for direction in Direction:
                        self.give(SyncStarted(name, self.now_s, direction))
                continue
            if self.now_s - began_s < SYNC_TAKES_S:
                continue
            del self._syncs[name]
            if near:
                self.give(RobotPose(name, place, self.now_s, name))
                if name in self.destinations:
                    self.give(RobotPath(name, (self.destinations[name],), self.now_s))
                for direction in Direction:
                    self.give(SyncEnded(name, self.now_s, direction, 1, 100, 0.1))


@pytest.fixture(scope="session")
def pennovation():
    return load_mission(MISSIONS / "pennovation" / "mission.yaml")


@pytest.fixture
def pretend(pennovation):
    def make(
        mission=None,
        *,
        radius_m=60.0,
        seek=("callisto", "europa", "io"),
        **changes,
    ):
        named = ("pilot_arms", "explore", "name", "step_s")
        how = {key: changes.pop(key) for key in named if key in changes}
        changed = dataclasses.replace(mission or pennovation, **changes)
        return PretendFlight(changed, radius_m=radius_m, seek=seek, **how)

    return make


@pytest.fixture
def airborne(pretend):
    """A flight that has taken off."""

    def make(mission=None, **changes):
        flight = pretend(mission, **changes)
        flight.take_off()
        return flight

    return make


@pytest.fixture
def away(airborne):
    """A flight on its way, 60 m from home."""

    def make(mission=None, **changes):
        flight = airborne(mission, **changes)
        flight.fly_away()
        return flight

    return make


@pytest.fixture
def hovering(pretend):
    """A flight that hovers on request, somewhere on its way."""

    def make(mission=None):
        flight = pretend(mission, duration_s=4000.0)
        flight.hold_away()
        return flight

    return make


@pytest.fixture(scope="session")
def flown():
    """Flights that were flown somewhere once; a test that requests one flies on with a copy."""
    kept = {}

    def copy_of(key, fly):
        if key not in kept:
            kept[key] = fly()
        flight = kept[key]
        memo = {id(part): part for part in (flight.mission, flight.plan, flight.router)}
        memo |= {id(past): [*past] for past in (flight.track, flight.events, flight.actions)}
        return copy.deepcopy(flight, memo)

    return copy_of


class PretendVehicle(Vehicle):
    """An airframe behind the port that the flight shell commands; its time runs by itself."""

    def __init__(self, mission, clock):
        self.airframe = Airframe(mission)
        self.clock = clock
        self.callback = None
        self.verbs = []
        self.announced = []
        self.plan = None
        self.kind = VehicleType()
        self.inspection = Inspection(gps=GpsFix(3, 14, 0.8), battery=1.0)
        self.failures = {}  # verb -> errors to raise, one after the other
        self.on_step = lambda: None
        self.lasts_too_long = lambda: None  # called after an hour in the air
        self.running = None

    async def connect(self):
        self._fail("connect")
        home = self.airframe.mission.home
        return VehicleInfo(1, "PX4", "1.17.0", home, 6.7, airframe=self.kind)

    def subscribe(self, callback):
        self.callback = callback
        self.running = asyncio.get_running_loop().create_task(self.stream())

    async def inspect(self, parameters):
        self._fail("inspect")
        return self.inspection

    async def upload(self, plan):
        self._fail("upload")
        self.plan = plan

    async def renew(self, plan, objection):
        self._fail("renew")
        self.plan = plan

    async def recognise(self, plan):
        self._fail("recognise")
        self.plan = plan

    def count_heights_from(self, home_amsl_m):
        self.home_amsl_m = home_amsl_m

    async def arm(self):
        self._fail("arm")
        self.airframe.armed = True

    async def start(self):
        self._fail("start")
        self.airframe.take_off()

    async def jump(self, item, objection=None, *, out_of=None):
        self._fail("jump")
        node = self.plan.node_of(item)
        mission = self.airframe.mission
        self.airframe.target = mission.waypoints[node - 1].position if node else mission.home
        self.airframe.mode = FlightMode.MISSION

    async def reposition(self, point, altitude_m, objection=None, *, out_of=None):
        self._fail("reposition")
        assert altitude_m == self.airframe.mission.altitude_above_home_m
        self.airframe.target, self.airframe.mode = point, FlightMode.HOLD

    async def hold(self, *, out_of=None):
        self._fail("hold")
        self.airframe.target, self.airframe.mode = None, FlightMode.HOLD

    async def land(self, *, out_of=None):
        self._fail("land")
        self.airframe.target, self.airframe.mode = None, FlightMode.LAND

    async def announce(self, text, severity):
        self.announced.append((text, severity))

    async def close(self):
        self.verbs.append("close")
        if self.running is not None:
            self.running.cancel()

    def _fail(self, verb):
        self.verbs.append(verb)
        if self.failures.get(verb):
            raise self.failures[verb].pop(0)

    async def stream(self):
        while True:
            self.airframe.move()
            if self.airframe.now_s > LONGEST_S:
                self.lasts_too_long()
            self.on_step()
            self.clock.received(self.airframe.now_s)
            self.callback(self.airframe.telemetry())
            for _ in range(4):  # let the commands through between two positions
                await asyncio.sleep(0)


@pytest.fixture
def pretend_vehicle():
    return PretendVehicle
