"""Zones and fences that change in flight: held for, left, put on board, and flown on among.

What counts changes at once. Then, in this order: a leg that is not clear any more is held for; a
vehicle that is in a new zone leaves it; the autopilot gets its new fence, which would act at once
on a vehicle inside; and only when that is read back the mission goes on, by ways planned anew. A
return that the battery demands does not wait for that.

With the altitude in doubt zones change as well: then every zone counts, whatever its height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from air_router.controller.airspace_change import counted, difference, names_of_new, plans_for
from air_router.controller.envelope import ReturnMonitor
from air_router.controller.limits import BRAKING_OVERSHOOT, WAY_OUT_RETRY_S
from air_router.controller.model import (
    AirspaceChanged,
    Anomaly,
    FlyToNode,
    FlyToPoint,
    Goal,
    HoldHere,
    MissionContext,
    PlanOwner,
    PlanRenewed,
    Progress,
    RenewPlan,
    ReplanAirspace,
    Signal,
    State,
    ZoneChange,
)
from air_router.controller.motion import CommandGate, Navigator, nearest_way_out
from air_router.controller.states import Exploration
from air_router.mission import Mission
from air_router.routing import BRAKING_M_S2, STANDING_M_S, Router, WaypointGraph, names_of
from air_router.vehicle import (
    BE_READY_AT_HOME,
    BRING_HOME_BY_HEIGHT,
    FLY_OUT,
    OUT_OF_ITS_WAY,
    RELOAD_AGAIN,
    WATCH_HEIGHT,
    Telemetry,
)
from geo.airspace import FENCE, Airspace

NO_WAY_OUT: Final = "no way out of a new zone"
"""What is alarmed of until there is one."""


@dataclass(slots=True, eq=False)
class AirspaceUpdate:
    """Takes other zones and fences in, and keeps everything else waiting until they count.

    Args:
        context: The vehicle, and the mission and router that are replaced.
        gate: Stops the vehicle.
        navigator: Leads it out of a new zone.
        exploration: Waypoints in a zone, or behind one, are left out of it.
        returns: Whether the battery demands that it comes home.

    Attributes:
        prepared: The router among other zones, if it was made elsewhere.
        replans: One is being made elsewhere, for an altitude that is in doubt or trusted again.
    """

    _context: MissionContext
    _gate: CommandGate
    _navigator: Navigator
    _exploration: Exploration
    _returns: ReturnMonitor
    prepared: Router | None = None
    replans: bool = False
    _new: frozenset[str] = frozenset()  # areas that the fence on board does not have yet
    _way_out: Goal | None = None  # where it leaves a zone drawn over it
    _what: str = ""  # what is being uploaded, in announcements
    _stuck_until_s: float = -math.inf  # no way out is searched for before
    _doubted: bool = False  # the altitude
    _trusts: bool = False  # the autopilot's altitude counts though it is in doubt
    _checked_mission: Mission | None = None  # its zones count as they should
    _lifts: bool = False  # zones are taken off the fence on board: it would hold what flies there

    def prepare(self, router: Router) -> None:
        """Use this router, made elsewhere, for the zones that come next, if it is among them."""
        self.prepared = router

    # Other zones.

    def airspace_changed(self, event: AirspaceChanged) -> None:
        """Heed other zones and fences at once."""
        context = self._context
        router, self.prepared = self.prepared, None
        replans, self.replans = self.replans, False
        if context.task.state is State.DONE:
            context.inform("zones not changed: the flight is over")
            return
        if self._context.airspace.change is ZoneChange.UPLOADING:
            if not replans:  # it is asked for again
                what = "zones not changed: an earlier change is still being uploaded"
                context.warn(what, RELOAD_AGAIN)
            return
        before, mission = (
            context.airspace.mission,
            context.airspace.mission.with_areas(event.fences, event.zones),
        )
        mission = counted(mission, all_zones=self.all_zones)
        if replans and mission.zones == before.zones:
            return  # it lands by now
        if router is None or not plans_for(router, mission):
            router = Router(WaypointGraph(mission))
        mission = router.graph.mission  # with what was worked out of its airspace elsewhere
        context.airspace.replace(mission, router)
        self._lifts |= before.all_zones and not mission.all_zones
        self._way_out = None
        self._what = "the changed fence"
        when = "; they go on board when the mission is resumed" if self._put_off else ""
        context.inform(f"zones changed: {difference(before, mission)}{when}")
        self._skip_waypoints(mission, router)
        self._begin(before, mission)

    @property
    def _put_off(self) -> bool:
        """Whether the vehicle is not ours, or not for long."""
        context = self._context
        by_hand = context.in_air and not context.in_charge  # also before it is handed over
        return (
            by_hand
            or context.task.state is State.PASSIVE
            or context.authority.releasing is not None
        )

    def objection(self) -> str | None:
        """Why nothing may be put on board any more; None if it may."""
        if self._put_off:
            return "the vehicle is not flown by us any more"
        if self._context.authority.on_board is PlanOwner.REPLACED:
            return "another ground station has changed what is on board"
        waited_for = self._context.airspace.change is ZoneChange.UPLOADING
        return None if waited_for else "the mission goes on without it"

    def _skip_waypoints(self, mission: Mission, router: Router) -> None:
        """Leave out what lies in a zone, or behind one, and announce it."""
        paths, home, inform = router.graph.paths, mission.home, self._context.inform
        unreachable = {
            waypoint.number
            for waypoint in mission.waypoints
            if not paths.connected(home, waypoint.position)
        }
        out, back = self._exploration.skip(unreachable | mission.skipped)
        for numbers, what in ((out, "left out: no clear way leads there"), (back, "flown again")):
            if numbers:
                noun = "waypoint" if len(numbers) == 1 else "waypoints"
                inform(f"{noun} {', '.join(map(str, numbers))} {what}")
        off = len(mission.rally_points) - len(mission.landings)
        if off:
            inform(f"{off} rally points that zones were drawn over are taken off")

    def _begin(self, before: Mission, now: Mission) -> None:
        """What is done at once, wherever the vehicle is."""
        telemetry, state = self._context.telemetry, self._context.task.state
        if state is State.READY and (telemetry is None or not telemetry.armed):
            self._upload()
        climbs = self._context.in_air or state is not State.READY
        if telemetry is None or not (self._context.in_charge and climbs):
            return
        if self._context.authority.releasing is not None:
            return  # it is commanded to hold, and given away then
        self._new |= names_of_new(before, now)
        if state is not State.LAND:  # that goes on nowhere else: it is a breach
            self._context.airspace.exempt(self._reached(before, now, telemetry))
        if state is State.READY:
            return  # once it has climbed
        inside = now.airspace_at(telemetry.altitude_m).zones_at(telemetry.position)
        if before.skipped != now.skipped and state is not State.LAND:
            self._stop("waypoints go off the plan on board, or back on it")
        elif not inside and not self._clear_onward(telemetry):
            self._stop("the leg under way is not clear any more")

    def _clear_onward(self, telemetry: Telemetry) -> bool:
        """Whether it may fly on to wherever it was sent, also by what it did not confirm."""
        navigator, way = self._navigator, self._context.task.way
        places = {setpoint.place for setpoint in self._gate.setpoints.pending(telemetry)}
        if way.leg is not None and way.progress is Progress.FLYING:
            places.add(way.leg.to)
        return all(navigator.clear(telemetry, place) for place in places)

    def _stop(self, why: str) -> None:
        self._gate.stop()
        self._context.airspace.stop_first()
        # What it comes into because the hold is late, it leaves.
        self._context.airspace.exempt(self._new)
        self._gate.hold(why)
        self._context.inform(f"holding: {why}")

    def _reached(self, before: Mission, now: Mission, telemetry: Telemetry) -> frozenset[str]:
        """The new zones that the vehicle is in, or may come into before it stands."""
        speed_m_s = max(now.speed_m_s, math.hypot(*telemetry.velocity_m_s))
        reaction_s = self._gate.reaction_s
        reach_m = BRAKING_OVERSHOOT * speed_m_s * (reaction_s + speed_m_s / (2 * BRAKING_M_S2))
        known = set(before.zones)
        new = [z for z in now.airspace_at(telemetry.altitude_m).zones if z not in known]
        here = telemetry.position
        near = {z.name for z in new if Airspace(None, [z], 0.0).distance_m(here) <= reach_m}
        return frozenset(near | ({FENCE} if before.fences != now.fences else set()))

    # Until they count.

    def go_on(self, telemetry: Telemetry) -> None:
        """Go on with the change that is under way; everything else waits."""
        gate, urgent = self._gate, not self._lifts and self._urgent(telemetry)
        if urgent and self._context.airspace.change is ZoneChange.UPLOADING:
            self._go_without()
            return
        change, must_stop = self._context.airspace.change, self._context.airspace.must_stop
        leaves = change is ZoneChange.LEAVING and not must_stop
        if gate.pending is not None and not (leaves and isinstance(gate.pending, HoldHere)):
            return  # on the way out no hold is waited for: what was asked meanwhile may need one
        moves = math.hypot(*telemetry.velocity_m_s) >= STANDING_M_S
        stopping = isinstance(gate.last, HoldHere)
        taken_back = gate.last is None and self._way_out is None
        if not stopping and (must_stop or (taken_back and moves)):
            gate.hold("it did not stop")  # it flies on to where zones are now
            return
        if change is ZoneChange.UPLOADING:
            if self._navigator.off_its_leg(telemetry):
                self._stop("off the leg, and the rest of it is not clear")
            return
        airspace = self._context.airspace.mission.airspace_at(telemetry.altitude_m)
        inside = airspace.zones_at(telemetry.position)
        if inside or change is ZoneChange.LEAVING:
            self._leave(telemetry, inside)
            return
        if not (stopping and moves):
            self._context.over(NO_WAY_OUT)
            self._upload()
            if urgent:
                self._go_without()

    def _urgent(self, telemetry: Telemetry) -> bool:
        """Whether it comes home, or lands, and has no charge to wait here; that stays so."""
        ending = self._context.task.ending
        if ending is None or ending.urgent:
            return ending is not None
        urgent = self._returns.due(telemetry, by_time=False) is not None
        self._context.task.end(replace(ending, urgent=urgent))
        return urgent

    def _go_without(self) -> None:
        """Come home among the zones of now, by points, whatever is on board."""
        self.plan_renewed(PlanRenewed("it comes home at once, for its battery"))

    def upload_again(self) -> None:
        """Put the plan on board as it is, once the vehicle is ours: another is there."""
        if self._context.airspace.change is not ZoneChange.UPLOADING:
            self._begin_clearing()
            self._what = "this mission's plan"
            self._context.airspace.stop_first()

    def _upload(self) -> None:
        self._context.airspace.upload()
        self._context.actions.append(RenewPlan())

    def _leave(self, telemetry: Telemetry, inside: tuple[str, ...]) -> None:
        """The shortest way out of the zone that was drawn over the vehicle."""
        context, gate, navigator = self._context, self._gate, self._navigator
        if self._way_out is None or context.task.way.goal is not self._way_out:
            if telemetry.time_s < self._stuck_until_s:
                return
            found = nearest_way_out(context.airspace.router, context.airspace.mission, telemetry)
            if self._way_out is None and inside:
                context.warn(f"leaving {names_of(inside)}", OUT_OF_ITS_WAY)
            place = telemetry.position if found is None else found.place
            context.airspace.leave(None if found is None else found.router)
            self._way_out = Goal(place)
            motion = navigator.plan_to(self._way_out)
        elif gate.last is None and context.take_retry():
            motion = navigator.again()  # it did not follow
        else:
            motion = navigator.update(telemetry)
        local = context.airspace.way_out_router
        if isinstance(motion, FlyToNode | FlyToPoint) and local is not None:
            # What was drawn above it is left below that, not through it; then it climbs. To an item
            # of the plan PX4 would climb at once.
            context.interlocks.climb_first()
            motion = FlyToPoint(motion.position, telemetry.altitude_m)
        if motion is not None:
            gate.send(motion)
        progress = context.task.way.progress
        if inside and progress in {Progress.NO_ROUTE, Progress.ARRIVED}:
            refused = progress is Progress.NO_ROUTE
            self._no_way_out(inside, navigator.refusal if refused else "it is not left there")
        elif progress is Progress.ARRIVED or (progress is Progress.NO_ROUTE and not inside):
            self._begin_clearing()
            gate.stop()

    def _no_way_out(self, inside: tuple[str, ...], why: str) -> None:
        """Hover, alarm until it is over, and check again in a moment."""
        context, now_s = self._context, self._context.last_telemetry.time_s
        instruction = BRING_HOME_BY_HEIGHT if context.airspace.mission.all_zones else FLY_OUT
        context.alarm_until_over(
            NO_WAY_OUT,
            f"no way out of {names_of(inside)}: {why}",
            instruction,
            lasting=f"no way out of {names_of(inside)}",
            since_s=context.now_s,
        )
        self._gate.stop()
        self._gate.hold("no way out")
        self._stuck_until_s = now_s + WAY_OUT_RETRY_S
        self._begin_clearing()

    def _begin_clearing(self) -> None:
        self._way_out = None
        self._context.airspace.clear()

    def plan_renewed(self, event: PlanRenewed) -> None:
        """Go on, or home where the autopilot has no such fence."""
        if self._context.airspace.change is not ZoneChange.UPLOADING:
            return
        self._lifts = False
        self._new = frozenset()
        self._context.airspace.finish_change()
        # Who knows what plan is on board if it was not renewed.
        self._gate.fly_points(instead=event.why_not is not None)
        if event.why_not is None:
            self._context.authority.plan_is(PlanOwner.OURS)
            self._context.inform(f"{self._what} is on board")
        else:
            self._context.warn(f"{self._what} is not on board: {event.why_not}", RELOAD_AGAIN)
            if self._put_off or self._context.authority.plan_check is not None:
                self._context.airspace.clear()  # once more when the mission is resumed
                return
            if self._context.knows(Signal.COME_HOME):
                self._context.come_home(f"{self._what} is not on board", BE_READY_AT_HOME)
                return
        if self._context.in_air:
            self._navigator.follow(self._context.task.handler.replan())

    # The altitude in doubt.

    @property
    def all_zones(self) -> bool:
        """Whether every zone is to count whatever its height; a landing goes on as it was begun."""
        return self._doubted and not self._trusts and self._context.task.state is not State.LAND

    def altitude_doubted(self, telemetry: Telemetry) -> None:
        """Have every zone count whatever its height, as long as the battery lets it wait for ways.

        The autopilot's own return would be clear of nothing.
        """
        context, mission = self._context, self._context.airspace.mission
        self._doubted = True
        charge = telemetry.battery
        if charge is not None and charge <= mission.battery_reserve:
            self.trust_altitude("the battery is at its reserve")
        waits = self.replans or context.airspace.change is ZoneChange.UPLOADING
        altitude_jump = context.interlocks.is_raised(
            Anomaly.ALTITUDE_JUMP
        )  # which is held for first
        if waits or altitude_jump or mission is self._checked_mission:
            return
        if counted(mission, all_zones=self.all_zones).zones == mission.zones:
            self._checked_mission = mission
            return
        self.replans = True
        context.actions.append(ReplanAirspace())

    def trust_altitude(self, why: str) -> bool:
        """Where zones leave no way, have them count at their heights again; whether that is new."""
        context = self._context
        no_way = (
            context.task.way.progress is Progress.NO_ROUTE or NO_WAY_OUT in context.alarms.shown
        )
        if self._trusts or not (context.airspace.mission.all_zones and no_way):
            return False
        self._trusts, self._checked_mission = True, None
        context.warn(f"coming home clear at the autopilot's altitude alone: {why}", WATCH_HEIGHT)
        return True
