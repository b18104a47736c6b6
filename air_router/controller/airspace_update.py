"""Changes zones and fences in flight: the vehicle holds, leaves new zones, uploads, and flies on.

The new zones apply at once. Then, in this order: the vehicle holds if its leg is no longer clear;
it leaves a new zone that it is in; PX4 gets the new fence, which would act at once on a vehicle
outside it; the mission continues, with new routes, once the fence is read back. A return that the
battery demands does not wait for the upload.

An altitude in doubt also changes zones: then all zones apply at every altitude.
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
"""Subject of the alarm until there is a way out."""


@dataclass(slots=True, eq=False)
class AirspaceUpdate:
    """Applies changed zones and fences; everything else waits until they are on board.

    Args:
        context: State of the flight; its mission and router are replaced.
        gate: Commands holds.
        navigator: Flies the vehicle out of a new zone.
        exploration: Skips waypoints that are in a zone or behind one.
        returns: Knows whether the battery demands the return.

    Attributes:
        prepared: A router for the next zones that was made elsewhere.
        replans: Such a router is being made, for an altitude that is in doubt or trusted again.
    """

    _context: MissionContext
    _gate: CommandGate
    _navigator: Navigator
    _exploration: Exploration
    _returns: ReturnMonitor
    prepared: Router | None = None
    replans: bool = False
    _new: frozenset[str] = frozenset()  # areas missing in the fence on board
    _way_out: Goal | None = None  # where the vehicle leaves a zone drawn over it
    _what: str = ""  # what is being uploaded, in announcements
    _stuck_until_s: float = -math.inf  # next search for a way out
    _doubted: bool = False  # the altitude is in doubt
    _trusts: bool = False  # PX4's altitude is used although it is in doubt
    _checked_mission: Mission | None = None  # the mission whose zones apply as they should
    _lifts: bool = False  # zones on board apply no longer, and PX4 would hold in them

    def prepare(self, router: Router) -> None:
        """Use this router, made elsewhere, for the next zones, if it was made for them."""
        self.prepared = router

    # Changed zones.

    def airspace_changed(self, event: AirspaceChanged) -> None:
        """Apply changed zones and fences at once."""
        context = self._context
        router, self.prepared = self.prepared, None
        replans, self.replans = self.replans, False
        if (why := self.refusal) is not None:
            if context.task.state is State.DONE:
                context.inform(f"zones not changed: {why}")
            elif not replans:  # that one is requested again
                context.warn("zones not changed: an upload is in progress", RELOAD_AGAIN)
            return
        before, mission = (
            context.airspace.mission,
            context.airspace.mission.with_areas(event.fences, event.zones),
        )
        mission = counted(mission, all_zones=self.all_zones)
        if replans and mission.zones == before.zones:
            return  # the vehicle lands by now
        if router is None or not plans_for(router, mission):
            router = Router(WaypointGraph(mission))
        mission = router.graph.mission  # with the airspace computed elsewhere
        context.airspace.replace(mission, router)
        self._lifts = not mission.all_zones and (self._lifts or before.all_zones)
        self._way_out = None
        self._what = "the changed fence"
        when = "; they are uploaded when the mission is resumed" if self._deferred else ""
        context.inform(f"zones changed: {difference(before, mission)}{when}")
        self._skip_waypoints(mission, router)
        self._begin(before, mission)

    @property
    def refusal(self) -> str | None:
        """Why changed zones are not applied now; None: they are."""
        if self._context.task.state is State.DONE:
            return "the flight is over"
        uploading = self._context.airspace.change is ZoneChange.UPLOADING
        return "an upload is in progress" if uploading else None

    @property
    def _deferred(self) -> bool:
        """Whether the upload waits: the vehicle is not ours, or is being released."""
        context = self._context
        by_hand = context.in_air and not context.in_charge  # also before the hand-over
        return (
            by_hand
            or context.task.state is State.PASSIVE
            or context.authority.releasing is not None
        )

    def objection(self) -> str | None:
        """Why nothing may be uploaded anymore; None if it may."""
        if self._deferred:
            return "this program no longer commands the vehicle"
        if self._context.authority.on_board is PlanOwner.REPLACED:
            return "another ground station has changed what is on board"
        waited_for = self._context.airspace.change is ZoneChange.UPLOADING
        return None if waited_for else "the mission goes on without it"

    def _skip_waypoints(self, mission: Mission, router: Router) -> None:
        """Skip waypoints in a zone or behind one, and announce them."""
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
            inform(f"{off} rally points in new zones are removed")

    def _begin(self, before: Mission, now: Mission) -> None:
        """Respond at once: upload on the ground; in the air hold if the leg is no longer clear."""
        telemetry, state = self._context.telemetry, self._context.task.state
        self._new |= names_of_new(before, now)
        if state is State.READY and (telemetry is None or not telemetry.armed):
            self._upload()
        climbs = self._context.in_air or state is not State.READY
        if telemetry is None or not (self._context.in_charge and climbs):
            return
        if self._context.authority.releasing is not None:
            return  # it holds and is released then
        if state is not State.LAND:  # a landing cannot leave: it is a breach
            self._context.airspace.exempt(self._reached(before, now, telemetry))
        if state is State.READY:
            return  # after the climb
        inside = now.airspace_at(telemetry.altitude_m).zones_at(telemetry.position)
        if before.skipped != now.skipped and state is not State.LAND:
            self._stop("the waypoints of the plan change")
        elif not inside and not self._clear_onward(telemetry):
            self._stop("the current leg is no longer clear")

    def _clear_onward(self, telemetry: Telemetry) -> bool:
        """Whether the vehicle may fly on to every commanded place, also unconfirmed ones."""
        navigator, way = self._navigator, self._context.task.way
        places = {setpoint.place for setpoint in self._gate.setpoints.pending(telemetry)}
        if way.leg is not None and way.progress is Progress.FLYING:
            places.add(way.leg.to)
        return all(navigator.clear(telemetry, place) for place in places)

    def _stop(self, why: str) -> None:
        self._gate.stop()
        self._context.airspace.stop_first()
        # A zone that it enters because the hold is late is no breach: it leaves it.
        self._context.airspace.exempt(self._new)
        self._gate.hold(why)
        self._context.inform(f"holding: {why}")

    def _reached(self, before: Mission, now: Mission, telemetry: Telemetry) -> frozenset[str]:
        """The new zones that the vehicle is in, or may enter before it stops."""
        speed_m_s = max(now.speed_m_s, math.hypot(*telemetry.velocity_m_s))
        reaction_s = self._gate.reaction_s
        reach_m = BRAKING_OVERSHOOT * speed_m_s * (reaction_s + speed_m_s / (2 * BRAKING_M_S2))
        known = set(before.zones)
        new = [z for z in now.airspace_at(telemetry.altitude_m).zones if z not in known]
        here = telemetry.position
        near = {z.name for z in new if Airspace(None, [z], 0.0).distance_m(here) <= reach_m}
        return frozenset(near | ({FENCE} if before.fences != now.fences else set()))

    # Until the change is complete.

    def continue_change(self, telemetry: Telemetry) -> None:
        """Continue the change; everything else waits."""
        gate, urgent = self._gate, not self._lifts and self._urgent(telemetry)
        if urgent and self._context.airspace.change is ZoneChange.UPLOADING:
            self._go_without()
            return
        change, must_stop = self._context.airspace.change, self._context.airspace.must_stop
        leaves = change is ZoneChange.LEAVING and not must_stop
        if gate.pending is not None and not (leaves and isinstance(gate.pending, HoldHere)):
            return  # on the way out a pending hold is not waited for
        moves = math.hypot(*telemetry.velocity_m_s) >= STANDING_M_S
        stopping = isinstance(gate.last, HoldHere)
        taken_back = gate.last is None and self._way_out is None
        if not stopping and (must_stop or (taken_back and moves)):
            gate.hold("it did not stop")  # it flies on toward new zones
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
        """Whether the vehicle comes home or lands without charge to wait; stays set."""
        ending = self._context.task.ending
        if ending is None or ending.urgent:
            return ending is not None
        urgent = self._returns.due(telemetry, by_time=False) is not None
        self._context.task.end(replace(ending, urgent=urgent))
        return urgent

    def _go_without(self) -> None:
        """Come home around the new zones by DO_REPOSITION, whatever is on board."""
        self.plan_renewed(PlanRenewed("it comes home at once, for its battery"))

    def upload_again(self) -> None:
        """Upload this mission's plan once the vehicle is ours: another is on board."""
        if self._context.airspace.change is not ZoneChange.UPLOADING:
            self._begin_clearing()
            self._what = "this mission's plan"
            self._context.airspace.stop_first()

    def _upload(self) -> None:
        self._context.airspace.upload()
        self._context.actions.append(RenewPlan())

    def _leave(self, telemetry: Telemetry, inside: tuple[str, ...]) -> None:
        """Fly the shortest way out of a zone that was drawn over the vehicle."""
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
            motion = navigator.again()  # the vehicle did not follow
        else:
            motion = navigator.update(telemetry)
        local = context.airspace.way_out_router
        if isinstance(motion, FlyToNode | FlyToPoint) and local is not None:
            # Stay below a zone above and climb only after leaving it. PX4 would climb to a plan
            # item at once.
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
        """Hover, raise the alarm until there is a way, and retry soon."""
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
        """Resume after the upload, or come home if PX4 does not have the fence."""
        context = self._context
        if context.airspace.change is not ZoneChange.UPLOADING:
            return
        # Without the upload the plan on board is unknown.
        self._gate.fly_points(instead=event.why_not is not None)
        if event.why_not is not None:
            context.warn(f"{self._what} is not on board: {event.why_not}", RELOAD_AGAIN)
            if self._deferred or context.authority.plan_check is not None:
                # Uploaded again when the mission is resumed. Until then the change is not over:
                # the stop that it needs, and the zones that are no breach, stay.
                context.airspace.clear()
                return
            context.airspace.finish_change()
            if context.knows(Signal.COME_HOME):
                context.come_home(f"{self._what} is not on board", BE_READY_AT_HOME)
                return
        else:
            self._lifts, self._new = False, frozenset()
            context.airspace.finish_change()
            context.authority.plan_is(PlanOwner.OURS)
            context.inform(f"{self._what} is on board")
        if context.in_air:
            self._navigator.follow(context.task.handler.replan())

    # Altitude in doubt.

    @property
    def all_zones(self) -> bool:
        """Whether all zones apply at every altitude; a landing continues as it began."""
        return self._doubted and not self._trusts and self._context.task.state is not State.LAND

    def altitude_doubted(self, telemetry: Telemetry) -> None:
        """Apply all zones at every altitude, while the charge lasts.

        PX4's own return would keep clear of nothing.
        """
        context, mission = self._context, self._context.airspace.mission
        self._doubted = True
        if mission.at_reserve(telemetry.battery):
            self.trust_altitude("the battery is at its reserve")
        waits = self.replans or context.airspace.change is ZoneChange.UPLOADING
        altitude_jump = context.interlocks.is_raised(
            Anomaly.ALTITUDE_JUMP
        )  # it holds for that first
        if waits or altitude_jump or mission is self._checked_mission:
            return
        if counted(mission, all_zones=self.all_zones).zones == mission.zones:
            self._checked_mission = mission
            return
        self.replans = True
        context.actions.append(ReplanAirspace())

    def trust_altitude(self, why: str) -> bool:
        """If zones leave no way, apply them at their altitudes again; whether that is new."""
        context = self._context
        no_way = (
            context.task.way.progress is Progress.NO_ROUTE or NO_WAY_OUT in context.alarms.shown
        )
        if self._trusts or not (context.airspace.mission.all_zones and no_way):
            return False
        self._trusts, self._checked_mission = True, None
        context.warn(f"coming home, clear of zones by PX4's altitude alone: {why}", WATCH_HEIGHT)
        return True
