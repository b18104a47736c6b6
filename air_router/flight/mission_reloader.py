"""Reads the mission file again in flight, and uploads its changes.

Only fences and no-fly zones may change. A file with any other change or an error has no effect.
Waypoints covered by new zones are no error here: they are skipped.
"""

from __future__ import annotations

import asyncio
import dataclasses
import logging
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

from air_router.controller import Controller, counted
from air_router.controller.model import (
    AirspaceChanged,
    Event,
    PlanOwner,
    PlanRenewed,
    ReadAgain,
    RenewPlan,
    ReplanAirspace,
)
from air_router.errors import (
    AirRouterError,
    ExitCode,
    NotConfirmedError,
    PlanKeptError,
    PlanRefusedError,
)
from air_router.flight.limits import PLAN_ON_BOARD_S
from air_router.mission import (
    DRAWN_OVER,
    FENCE_POINTS,
    FlightPlan,
    Mission,
    checked,
    chosen,
    read_placed,
)
from air_router.routing import Router, WaypointGraph
from air_router.vehicle import Vehicle
from geo.airspace import Zone
from mocha_link.team import DocumentError

_log = logging.getLogger(__name__)


_AREAS: Final = frozenset(
    {"fences", "zones", "idle_zones", "airspace", "planning_airspace", "climb_airspace"}
    | {"above_airspace", "drawn_zones", "window", "notes", "path", "name"}
)
"""Fields of a mission derived from its fences and zones, or not used in flight."""

_FROM_OPTIONS: Final = frozenset({"duration_s", "seek_policy", "uav", "explore", "layers"})
"""Fields that the command line may override: a different value in the file is no change."""


_KEEPS: Final = "the flight keeps to the changed fences and zones"


class NotReloadedError(AirRouterError):
    """The mission file was read again without effect; the message gives the reason."""

    exit_code = ExitCode.INVALID_FILE


def changed_areas(mission: Mission, on_board: FlightPlan | None = None) -> AirspaceChanged:
    """Read the current fences and zones of a mission's file.

    Args:
        mission: The mission as it is flown.
        on_board: The plan on board; None: this mission's.

    Raises:
        DocumentError: The file has errors; contains all of them.
        NotReloadedError: Other fields have changed, nothing has, or it does not fit on board.
    """
    placed, findings = read_placed(mission.path)
    if mission.layers and mission.uav is not None:
        placed = chosen(placed, mission.uav)
    latest, today = mission.window.latest_start, datetime.now(UTC)
    late = latest is not None and today > latest  # its window may end before the flight does
    # The zones of this flight, not of one that starts now.
    placed = placed.with_settings(duration_s=mission.duration_s)
    start = today if late else mission.window.start
    now = checked(placed, findings, start=start, besides=DRAWN_OVER)
    if late:
        now = now.with_areas(now.fences, _whatever_the_hour(now))
    follows = ("cruise", "climb_corridors")
    fields = sorted(dataclasses.fields(mission), key=lambda field: field.name in follows)
    others = [
        field.name
        for field in fields  # derived fields are named last
        if field.name not in _AREAS | _FROM_OPTIONS
        and getattr(mission, field.name) != getattr(now, field.name)
    ]
    if others:
        names = " and ".join(name.removesuffix("_s").replace("_", " ") for name in others)
        raise NotReloadedError(
            f"{mission.path}: {names} changed as well; in flight only fences and no-fly zones can"
        )
    same = (now.fences, now.zones) == (mission.fences, mission.drawn)
    if same and on_board in {None, FlightPlan.of(mission)}:
        raise NotReloadedError(f"{mission.path}: its fences and no-fly zones are as they were")
    points = len(FlightPlan.of(now).fence)
    if points > FENCE_POINTS:
        raise NotReloadedError(
            f"{mission.path}: the fence on board would have {points} points, PX4 1.17 stores "
            f"{FENCE_POINTS}; draw circles, and polygons with fewer corners"
        )
    return AirspaceChanged(now.fences, now.zones)


def _whatever_the_hour(mission: Mission) -> tuple[Zone, ...]:
    """The zones of a mission; those that apply in its window without their hours."""
    start, end = mission.window.start, mission.window.end
    return tuple(
        dataclasses.replace(zone, validity=None)
        if zone.validity is not None and zone.validity.active_between(start, end)
        else zone
        for zone in mission.zones
    )


@dataclass(frozen=True, slots=True)
class ReloadReport:
    """The outcome of the latest reading of the mission file.

    Attributes:
        under_way: The file is being read and checked.
        good: Its fences and zones are in force; they are uploaded after that.
        why: The outcome as a sentence.
    """

    under_way: bool = True
    good: bool = False
    why: str = "the mission file is being read"


class MissionReloader:
    """Carries out the controller's actions when zones change.

    Changes wait until the plan itself is on board.

    Attributes:
        latest: The outcome of the latest reading; None before the first.

    Args:
        controller: The controller with the mission.
        vehicle: Receives the changed plan.
        deliver: Called with the resulting events.
        print_line: Informs the operator.
    """

    def __init__(
        self,
        controller: Controller,
        vehicle: Vehicle,
        deliver: Callable[[Event], None],
        print_line: Callable[[str], None],
    ) -> None:
        self._controller = controller
        self._vehicle = vehicle
        self._deliver = deliver
        self._print = print_line
        self.latest: ReloadReport | None = None
        self._reading = self._once_more = False  # the file is being read; requested again meanwhile
        self._on_board = FlightPlan.of(controller.mission)  # the last uploaded plan
        self._intact = True  # no later upload has failed halfway
        # the plan is on board; nothing is in progress
        self._uploaded, self._idle = asyncio.Event(), asyncio.Event()
        self._idle.set()
        self._at_work = 0  # readings and uploads in progress
        self._uploads = 0  # started; the newest counts

    @property
    def report(self) -> ReloadReport | None:
        """The outcome of the latest reading and its upload; None before the first."""
        if self.latest is None or not self.latest.good:
            return self.latest
        owner = self._controller.plan_on_board
        if owner is PlanOwner.OURS:
            return self.latest
        but = (
            "a ground station has uploaded a plan, which is being compared with this mission's"
            if owner is PlanOwner.REPLACED
            else "another plan is on board: 'resume upload' uploads this mission's"
        )
        return ReloadReport(under_way=False, why=f"{_KEEPS}, but {but}")

    def plan_on_board(self) -> None:
        """The plan itself is on board: later changes may be uploaded."""
        self._uploaded.set()

    async def finished(self) -> None:
        """Wait until nothing is being read or uploaded."""
        await self._idle.wait()

    def work(self, action: ReadAgain | RenewPlan | ReplanAirspace) -> Coroutine[Any, Any, None]:
        """The coroutine that carries an action out."""
        self._at_work += 1
        self._idle.clear()
        if isinstance(action, ReadAgain):
            self.latest = ReloadReport()
            return self._done_when(self.read())
        if isinstance(action, ReplanAirspace):
            return self._done_when(self.replan())
        return self._done_when(self.upload())

    async def _done_when(self, work: Coroutine[Any, Any, None]) -> None:
        try:
            await work
        finally:
            self._at_work -= 1
            if self._at_work == 0:
                self._idle.set()

    async def read(self) -> None:
        """Read the file and make the router for the new zones, in the background."""
        if self._reading:
            self._once_more = True  # a file saved meanwhile may not have been read
            return
        self._reading = True
        try:
            latest = await self._read()
            while self._once_more:
                self._once_more = False
                latest = await self._read()
            self.latest = latest
        finally:
            self._reading = False

    async def _read(self) -> ReloadReport:
        try:
            event, router = await asyncio.to_thread(
                _read, self._controller.mission, self._on_board, self._controller.all_zones
            )
        except (AirRouterError, DocumentError) as error:
            return self._failed(f"not reloaded: {error}")
        except Exception as error:  # noqa: BLE001 - no edited file may end a flight
            _log.exception("%s was not reloaded", self._controller.mission.path)
            return self._failed(f"not reloaded, by a fault of this program: {error!r}")
        self._controller.prepare(router)
        why_not = self._controller.why_zones_stay() or "the flight is over"
        self._deliver(event)
        now = self._controller.mission
        good = (now.fences, now.drawn) == (event.fences, event.zones)
        why = _KEEPS if good else f"not reloaded: {why_not}"
        return ReloadReport(under_way=False, good=good, why=why)

    def _failed(self, why: str) -> ReloadReport:
        self._print(why)
        return ReloadReport(under_way=False, why=why)

    async def upload(self) -> None:
        """Upload the changed plan; if that fails once it has begun, restore the previous one.

        A superseded upload ends after its current list. Its outcome is announced unless another
        upload was started meanwhile.
        """
        self._uploads += 1
        number = self._uploads
        await self._uploaded.wait()

        def objection() -> str | None:
            newer = number != self._uploads
            return "a newer one follows" if newer else self._controller.why_no_upload()

        plan = FlightPlan.of(self._controller.mission)
        why_not = await self._renew(plan, objection)
        if why_not is None:
            self._on_board = plan
        elif not self._intact:
            restored = await self._renew(self._on_board, objection) is None
            why_not += "; the one before is" if restored else "; and the one before is not back"
        if number == self._uploads:
            self._deliver(PlanRenewed(why_not))

    async def replan(self) -> None:
        """Make the router for the zones that apply now, in the background."""
        controller = self._controller
        router = await asyncio.to_thread(_router, controller.mission, controller.all_zones)
        if controller.replans:  # no other change came first
            controller.prepare(router)
            now = controller.mission
            self._deliver(AirspaceChanged(now.fences, now.drawn))

    async def _renew(self, plan: FlightPlan, objection: Callable[[], str | None]) -> str | None:
        """Upload a plan; return why that failed, if it did."""
        try:
            async with asyncio.timeout(PLAN_ON_BOARD_S):
                await self._vehicle.renew(plan, objection)
        except PlanKeptError as error:
            return str(error)
        except (PlanRefusedError, NotConfirmedError, TimeoutError) as error:
            self._intact = False
            return str(error) or f"not within {PLAN_ON_BOARD_S:.0f} s"
        self._intact = True
        return None


def _read(
    mission: Mission, on_board: FlightPlan, all_zones: bool
) -> tuple[AirspaceChanged, Router]:
    event = changed_areas(mission, on_board)
    return event, _router(mission.with_areas(event.fences, event.zones), all_zones)


def _router(mission: Mission, all_zones: bool) -> Router:
    return Router(WaypointGraph(counted(mission, all_zones=all_zones)))
