"""A vehicle that flies as the controller commands, without an autopilot's inner life.

It knows Mission mode (jumps to plan items) and Hold mode (go to a point, or stop), flies straight
with a limited acceleration, and comes to rest at its target. It begins on the ground and takes off
at once, straight up; from then on its height stays until it lands. Positions are whole millimetres
and nothing but square roots is taken of them, so that every machine flies the same way.
"""

from __future__ import annotations

from math import sqrt
from typing import Final

from air_router.controller.model import FlyToNode, FlyToPoint, HoldHere, LandHere, Motion
from air_router.mission import FlightPlan, Mission
from air_router.vehicle import FlightMode, Telemetry
from geo.frame import Point
from sitl.experiment import RunSettings
from sitl.px4sim.motion import (
    Multirotor,
    Setpoint,
    SetpointKind,
    SpeedLimits,
    Wind,
    WindSettings,
    braking_distance,
    wanted_velocity,
)

STEP_S: Final = 0.1
_AIRFRAME_STEPS: Final = 5  # of the simulated autopilot in one of `STEP_S`
_PACE: Final = SpeedLimits()
_AT_REST_M: Final = 0.05
_AT_REST_M_S: Final = 0.2


class Flyer:
    """A vehicle in the air.

    Args:
        plan: What is on board: nodes and their items.
        mission: Where it takes off, to which altitude it climbs, and its cruise speed.
        settings: What it climbs and speeds up with, and how long a full battery lasts.

    Attributes:
        position: Metres east/north.
        altitude_m: Above home.
        velocity_m_s: East, north.
        direction: East, north; where it flew to last.
        landed: It is on the ground again, disarmed.
    """

    def __init__(self, plan: FlightPlan, mission: Mission, settings: RunSettings) -> None:
        self.position = mission.home
        self.velocity_m_s = (0.0, 0.0)
        self.direction = (0.0, 1.0)
        self._plan = plan
        self.altitude_m = 0.0
        self.landed = False
        self._charge = 1.0  # drains evenly while it flies, as the simulated autopilot's
        full = settings.battery
        # until it is empty; None: it never is
        self._battery_s = None if full == "none" else 60.0 * full
        self._cruise_m = mission.altitude_above_home_m
        self._climb_m_s = settings.uav_climb_m_s
        self._speed_m_s = mission.speed_m_s
        self._acceleration_m_s2 = settings.uav_acceleration_m_s2
        self._mode = FlightMode.MISSION  # PX4's, as the controller sees it
        self._item: int | None = None  # of the plan; None: it flies to none
        self._target: Point | None = None  # None: it brakes, or rests
        self._now_s = 0.0  # up to which it has flown

    @property
    def at_rest(self) -> bool:
        """Whether it hovers and will go on to."""
        return self._target is None and self.velocity_m_s == (0.0, 0.0)

    def command(self, motion: Motion) -> None:
        """Carry out the controller's command from now on."""
        match motion:
            case FlyToNode(node=node, position=position):
                self._mode, self._item = FlightMode.MISSION, self._plan.item_of(node)
                self._target = position
            case FlyToPoint(position=position):
                self._mode, self._item = FlightMode.HOLD, None
                self._target = position
            case HoldHere():
                self._mode, self._item, self._target = FlightMode.HOLD, None, None
            case LandHere():
                self._mode, self._item, self._target = FlightMode.LAND, None, None

    def fly(self, now_s: float) -> None:
        """Move on to a time, which is 0 on the ground."""
        self._climb(now_s)
        while self._now_s < now_s - 1e-9:
            if self.at_rest:
                self._now_s = now_s
                return
            step_s = min(STEP_S, now_s - self._now_s)
            self._step(step_s)
            self._now_s += step_s
        self._now_s = now_s

    def _climb(self, now_s: float) -> None:
        """Take off, stay there, or land as the simulated autopilot does."""
        step_s = now_s - self._now_s
        if self._mode is not FlightMode.LAND:
            self.altitude_m = min(self._cruise_m, round(self._climb_m_s * now_s, 3))
        elif not self.landed:
            low = Setpoint(SetpointKind.LAND)
            sinks_m_s = wanted_velocity(low, (0.0, 0.0, self.altitude_m), 0.0, 0.0, _PACE).up_m_s
            self.altitude_m = round(max(0.0, self.altitude_m + sinks_m_s * step_s), 3)
            self.landed = self.altitude_m == 0.0
        if self._battery_s is not None:
            drained = self._charge - step_s / max(self._battery_s, 1.0)
            self._charge = 1.0 if self.landed else max(drained, 0.0)

    def telemetry(self) -> Telemetry:
        """The vehicle's telemetry."""
        return Telemetry(
            time_s=self._now_s,
            position=self.position,
            altitude_m=self.altitude_m,
            velocity_m_s=self.velocity_m_s,
            armed=not self.landed,
            in_air=self.altitude_m > 0,
            mode=self._mode,
            battery=None if self._battery_s is None else self._charge,
            item=self._item,
        )

    def _step(self, step_s: float) -> None:
        east_m, north_m = self.position
        speed_m_s = self._speed_m_s
        target = self.position if self._target is None else self._target
        ahead_m = (target[0] - east_m, target[1] - north_m)
        away_m = sqrt(ahead_m[0] * ahead_m[0] + ahead_m[1] * ahead_m[1])
        old_east, old_north = self.velocity_m_s
        moving_m_s = sqrt(old_east * old_east + old_north * old_north)
        if away_m <= _AT_REST_M and moving_m_s <= _AT_REST_M_S:
            if self._target is not None:
                self.position = self._target
            self._target, self.velocity_m_s = None, (0.0, 0.0)
            return
        # Slow enough to stop at the target, seen from where this step ends.
        speed_m_s = min(speed_m_s, _braking_m_s(away_m, self._acceleration_m_s2, step_s))
        share = speed_m_s / away_m if away_m > 0 else 0.0
        change = (ahead_m[0] * share - old_east, ahead_m[1] * share - old_north)
        size = sqrt(change[0] * change[0] + change[1] * change[1])
        most = self._acceleration_m_s2 * step_s
        factor = 1.0 if size <= most else most / size
        new_east = round(old_east + change[0] * factor, 6)
        new_north = round(old_north + change[1] * factor, 6)
        self.position = Point(
            round(east_m + new_east * step_s, 3), round(north_m + new_north * step_s, 3)
        )
        self.velocity_m_s = (new_east, new_north)
        if new_east * new_east + new_north * new_north > 1.0:
            self.direction = self.velocity_m_s


class AirframeFlyer(Flyer):
    """A vehicle that flies as the simulated autopilot does: with its guidance, airframe and drag.

    It is slower than a `Flyer` of the same cruise speed: it has to learn the drag on each leg.
    """

    _airframe: Multirotor | None = None  # once it has somewhere to go
    _air: Wind  # still air, and its drag

    def command(self, motion: Motion) -> None:
        """Carry out the controller's command from now on; it holds a braking distance ahead."""
        super().command(motion)
        (east_m, north_m), (east_m_s, north_m_s) = self.position, self.velocity_m_s
        if self._target is None:
            speed_m_s = sqrt(east_m_s * east_m_s + north_m_s * north_m_s)
            ahead_s = braking_distance(speed_m_s, _PACE) / max(speed_m_s, _AT_REST_M_S)
            self._target = Point(
                round(east_m + ahead_s * east_m_s, 3), round(north_m + ahead_s * north_m_s, 3)
            )
        if self._airframe is None:
            self._airframe, self._air = Multirotor(), Wind(WindSettings(), 0)
            self._airframe.east_m, self._airframe.north_m, self._airframe.up_m = *self.position, 1.0

    def _step(self, step_s: float) -> None:
        airframe, target = self._airframe, self._target
        assert airframe is not None and target is not None  # noqa: PT018, S101 - or it rests
        goal = Setpoint(SetpointKind.POSITION, target.north_m, target.east_m)
        for _ in range(_AIRFRAME_STEPS):
            velocity_m_s = airframe.velocity_north_m_s, airframe.velocity_east_m_s
            push = self._air.step(step_s / _AIRFRAME_STEPS, velocity_m_s, flying=True)
            place = airframe.north_m, airframe.east_m, 0.0  # height is not the airframe's here
            wanted = wanted_velocity(goal, place, 0.0, self._speed_m_s, _PACE)
            airframe.step(step_s / _AIRFRAME_STEPS, wanted, push)
        self.position = Point(round(airframe.east_m, 3), round(airframe.north_m, 3))
        east_m_s, north_m_s = airframe.velocity_east_m_s, airframe.velocity_north_m_s
        self.velocity_m_s = round(east_m_s, 6), round(north_m_s, 6)
        if east_m_s * east_m_s + north_m_s * north_m_s > 1.0:
            self.direction = self.velocity_m_s


def _braking_m_s(away_m: float, acceleration_m_s2: float, step_s: float) -> float:
    """The speed from which a vehicle comes to rest after a distance, braking in steps."""
    lag_m_s = acceleration_m_s2 * step_s / 2
    return min(sqrt(2 * acceleration_m_s2 * away_m + lag_m_s * lag_m_s) - lag_m_s, away_m / step_s)
