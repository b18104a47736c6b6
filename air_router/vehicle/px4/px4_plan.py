"""The plan on board of a PX4: uploads, verifies and monitors it.

An accepted upload means *stored*. PX4 reports later whether the mission is feasible, and only in
MISSION_CURRENT.mission_state, or before PX4 1.17 in its arming checks. So the plan is read back and
compared, and the report is awaited. If a ground station uploads another plan later, that is read
back and compared, too. During an upload PX4 reports the plan on board before each list is sent:
another station's plan is overwritten only if the operator requested it.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Final, NamedTuple

from mavsdk.plugins.geofence.geofence import GeofenceResult
from mavsdk.plugins.mission_raw.mission_raw import MissionRawResult

from air_router.errors import NotConfirmedError, PlanKeptError, PlanRefusedError
from air_router.mission import FENCE_POINTS, FlightPlan, Frame, PlanItem
from air_router.vehicle import FlightMode, loop_s
from air_router.vehicle.px4.limits import (
    PLAN_BUSY_ATTEMPTS,
    PLAN_BUSY_S,
    PLAN_CHECKS_AGAIN_S,
    PLAN_CHECKS_S,
    PLAN_FEASIBLE_S,
    PLAN_RELOAD_S,
    PLAN_REPORTED_S,
    PLAN_TRANSFER_S,
)
from air_router.vehicle.px4.mavlink_values import (
    FENCE,
    MISSION,
    MISSION_INVALID,
    MISSION_UNKNOWN,
    RALLY,
)
from air_router.vehicle.px4.mavsdk_bridge import call, from_raw, to_raw
from air_router.vehicle.px4.plan_guard import LISTS, PlanIds
from air_router.vehicle.px4.px4_connection import Plugins
from air_router.vehicle.px4.px4_requests import arming_report
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry

_log = logging.getLogger(__name__)


REPLACED: Final = "another ground station has changed what is on board"

_BUSY: Final = frozenset({MissionRawResult.BUSY, MissionRawResult.ERROR, MissionRawResult.DENIED})
"""PX4's answers while it transfers a list with another sender."""

_PASSING: Final = frozenset(
    {
        MissionRawResult.BUSY,
        MissionRawResult.ERROR,
        MissionRawResult.TIMEOUT,
        # Over a slow link an item of the previous list is repeated, and PX4 answers that.
        MissionRawResult.PROTOCOL_ERROR,
    }
)


def _none() -> str | None:
    return None


class _ItemList(NamedTuple):
    """One of the lists on board, and its transfer functions."""

    what: str  # as text
    kind: int  # MAV_MISSION_TYPE
    upload: Callable[..., None]
    download: Callable[..., None]


class OnboardPlan:
    """The lists on board of one PX4, with one transfer at a time.

    Args:
        plugins: MAVSDK's plugins; other requests are sent as messages.
        telemetry: The vehicle's messages in both directions.
        received: Requests the current flight mode; returns whether it was received.
        report: Called with the difference after another sender's plan was compared with ours; None:
            it is equivalent.

    Attributes:
        lock: Held during each transfer, and while PX4 is commanded to start the plan.
        mission, fence, rally: The three lists of items on board.
    """

    def __init__(
        self,
        plugins: Plugins,
        telemetry: Px4Telemetry,
        received: Callable[[], Awaitable[bool]],
        report: Callable[[str | None], None] = lambda _difference: None,
    ) -> None:
        raw = plugins.raw
        self._plugins, self._telemetry, self._report = plugins, telemetry, report
        self._received = received
        self.lock = asyncio.Lock()
        self._plan: FlightPlan | None = None  # last uploaded or verified plan
        self._objection: Callable[[], str | None] = _none  # why nothing may be uploaded anymore
        self._uploaded: dict[int, Sequence[PlanItem]] = {}  # last uploaded items by list
        self._changes = False  # a transfer has begun that changes what is on board
        self._once_more = False  # changed during the comparison
        self._comparing: asyncio.Task[None] | None = None  # reads and compares
        self.mission = _ItemList(
            "the mission", MISSION, raw.upload_mission_async, raw.download_mission_async
        )
        self.fence = _ItemList(
            "the fence", FENCE, raw.upload_geofence_async, raw.download_geofence_async
        )
        self.rally = _ItemList(
            "the list of rally points",
            RALLY,
            raw.upload_rally_points_async,
            raw.download_rallypoints_async,
        )

    async def upload(self, plan: FlightPlan) -> None:
        """Upload a plan, and report changes by others from now on. See `Vehicle.upload`."""
        async with self.lock:
            self._uploaded.clear()  # the plan on board is replaced in any case
            self._telemetry.plan.guard.begin(self._telemetry.plan.ids)
            try:
                await self.put(plan)
            finally:
                self._broken_off()
            self._object()
            self._keep(plan)
            self._telemetry.plan.watch()

    async def recognise(self, plan: FlightPlan) -> None:
        """Verify that a plan is on board, and report changes by others from now on."""
        async with self.lock:
            self._guard(plan, await self.compare(plan))

    async def renew(self, plan: FlightPlan, objection: Callable[[], str | None]) -> None:
        """Upload a changed fence, and the items that change with it. See `Vehicle.renew`."""
        async with self.lock:
            if (why := objection()) is not None:
                raise PlanKeptError(why)
            if self._telemetry.plan.guard.changed:
                # Changes were announced by now: the operator wants them replaced.
                self._uploaded.clear()
                self._telemetry.guard_plan(self._telemetry.plan.ids)
            self._objection, self._changes = objection, False
            try:
                await self._renew(plan)
                self._keep(plan)
            except PlanRefusedError as error:
                if self._changes:
                    raise
                raise PlanKeptError(str(error)) from None
            finally:
                self._objection = _none
                self._broken_off()

    def replaced(self) -> None:
        """Compare a changed plan; once more after a running comparison.

        Reports the difference.
        """
        self._once_more = True
        if self._comparing is None or self._comparing.done():
            self._comparing = asyncio.get_running_loop().create_task(self._compare_until_same())

    def close(self) -> None:
        """Stop comparing."""
        if self._comparing is not None:
            self._comparing.cancel()

    def _guard(self, plan: FlightPlan, found: PlanIds | None) -> None:
        self._keep(plan)
        self._telemetry.guard_plan(found)

    def _keep(self, plan: FlightPlan) -> None:
        self._plan = plan
        self._uploaded = dict(zip(LISTS, (plan.items, plan.fence, plan.rally), strict=True))

    async def _compare_until_same(self) -> None:
        difference: str | None = "no plan is ours"
        while self._once_more and self._plan is not None:
            self._once_more = False
            try:
                async with self.lock:
                    await self.verify(self._plan)
            except (PlanRefusedError, NotConfirmedError) as error:
                difference = str(error)
            else:
                difference = None
        self._report(difference)

    async def put(self, plan: FlightPlan) -> PlanIds | None:
        """Upload the plan, wait until PX4 finds the mission feasible, and read all of it back.

        The fence is sent first, so that PX4 checks the mission against it. Returns as `compare`
        does.

        Raises:
            PlanRefusedError: PX4 refused it, it differs when read back, or it is infeasible.
        """
        if not plan.fence:
            await self._clear_fence()
        if not plan.rally:
            await self._clear_rally_points()
        if self._telemetry.plan.count > 0 and not self._reports_state:
            # The next arming checks concern this mission, not the previous one.
            await self._clear_mission()
        self._telemetry.forget_texts()
        for places, items in ((self.fence, plan.fence), (self.rally, plan.rally)):
            if items:
                await self._upload(places, items)
        await self._upload(self.mission, plan.items)
        try:
            await self._feasible(len(plan.items), cleared=True)
        except PlanRefusedError:
            if self._telemetry.refusals or not self._reports_state:
                raise
            await self.compare(plan)  # PX4 has everything that was sent
            # The same mission was on board before, and PX4 keeps its verdict from boot: it checks a
            # mission again only if it has changed.
            await self._clear_mission()
            await self._upload(self.mission, plan.items)
            await self._feasible(len(plan.items))
        return await self.compare(plan)  # last: by now reports show which plan is read

    async def _renew(self, plan: FlightPlan) -> PlanIds | None:
        """PX4 checks the mission after each transfer.

        New items might violate the old fence, and old items the new one. So the fence is cleared in
        between.
        """
        telemetry = self._telemetry
        flies_it = bool(telemetry.in_air) and telemetry.mode is FlightMode.MISSION
        if not plan.rally:
            await self._clear_rally_points()
        self._telemetry.forget_texts()
        items = await self.download(self.mission)
        if len(items) != len(plan.items) or not all(map(PlanItem.same_as, plan.items, items)):
            if flies_it:
                raise PlanRefusedError("other items while it flies the mission: hold first")
            await self._clear_fence()
            await self._upload(self.mission, plan.items)
        rally = await self.download(self.rally)
        if plan.rally and [_place(v) for v in plan.rally] != [_place(v) for v in rally]:
            await self._upload(self.rally, plan.rally)
        if plan.fence:
            await self._upload(self.fence, plan.fence)
        else:
            await self._clear_fence()
        await self._feasible(len(plan.items))
        return await self.compare(plan)

    async def verify(self, plan: FlightPlan) -> None:
        """Verify that the plan on board is equivalent to a plan, without changing it.

        Raises:
            PlanRefusedError: It is another plan, cannot be read, or PX4 finds it infeasible.
        """
        await self.compare(plan)
        await self._feasible(len(plan.items))

    async def compare(self, plan: FlightPlan) -> PlanIds | None:
        """Read fence, rally points and items back.

        Returns the ids reported before the transfer, so an upload meanwhile is detected. Raises
        PlanRefusedError if it is another plan.
        """
        ids = self._telemetry.plan.ids
        for places, sent in ((self.fence, plan.fence), (self.rally, plan.rally)):
            found = await self.download(places)
            _compare(places.what, [_place(v) for v in sent], [_place(v) for v in found])
        items = await self.download(self.mission)
        _compare(self.mission.what, list(plan.items), items)
        return ids

    async def _clear_mission(self) -> None:
        """Clear the mission on board, so that PX4 checks the next one again."""
        await self._may_change(MISSION)
        result, *_ = await _transfer("no mission", self._plugins.raw.clear_mission_async)
        cleared = result == MissionRawResult.SUCCESS
        if not cleared:  # the next upload replaces it
            self._telemetry.plan.guard.clear_refused(MISSION)
        self._put(MISSION, () if cleared else None)

    async def _clear_fence(self) -> None:
        """Clear the fence of an earlier mission. Raises PlanRefusedError if it stays."""
        await self._may_change(FENCE)
        clear = self._plugins.geofence.clear_geofence_async
        (result,) = await _transfer("no fence", clear)
        if result != GeofenceResult.SUCCESS:
            self._telemetry.plan.guard.clear_refused(FENCE)
        self._put(FENCE, () if result == GeofenceResult.SUCCESS else None)
        if result != GeofenceResult.SUCCESS:
            texts = self._telemetry.texts()
            raise PlanRefusedError(f"the fence on board stays: {result.name}{texts}")

    async def _clear_rally_points(self) -> None:
        """Clear rally points of an earlier mission: PX4's Return would fly there.

        MAVSDK has no call for it. Raises PlanRefusedError if they stay.
        """
        left, attempts = await self.download(self.rally), 0
        while left:
            if attempts == PLAN_BUSY_ATTEMPTS:
                texts = self._telemetry.texts()
                raise PlanRefusedError(f"rally points of another mission stay on board{texts}")
            attempts += 1
            await self._may_change(RALLY)
            fault = self._telemetry.send("MISSION_CLEAR_ALL", {"mission_type": RALLY})
            if fault is not None:
                self._put(RALLY, None)
                raise PlanRefusedError(f"rally points stay on board: {fault}")
            left = await self.download(self.rally)
        self._put(RALLY, ())

    async def _may_change(self, kind: int) -> None:
        """Start to change a list, if PX4 reports the known plan on board.

        Raises:
            PlanRefusedError: It is another, PX4 does not report it, or no transfer is allowed.
        """
        self._object()
        telemetry = self._telemetry
        fresh = telemetry.plan.count + 1
        if not await telemetry.shows(lambda: telemetry.plan.count >= fresh, PLAN_REPORTED_S):
            raise PlanRefusedError("PX4 does not report which plan is on board")
        ids = telemetry.plan.ids
        if ids is None or not ids.reported:  # an older PX4, or nothing on board
            await self._check_still_stored()
        if not await self._received():  # nothing is changed while a pilot flies
            raise PlanRefusedError("nothing is uploaded: no current flight mode was received")
        self._object()
        self._changes = True
        telemetry.plan.guard.transfer_begins(kind)

    def _object(self) -> None:
        if (why := self._objection()) is not None:
            raise PlanRefusedError(why)
        if self._telemetry.plan.guard.changed:
            raise PlanRefusedError(REPLACED)

    async def _check_still_stored(self) -> None:
        """Read back our lists. Raises PlanRefusedError if one has changed."""
        for of in (self.mission, self.fence, self.rally):
            if of.kind not in self._uploaded:
                continue
            uploaded, found = list(self._uploaded[of.kind]), await self.download(of)
            if of.kind != MISSION:
                uploaded, found = [*map(_place, uploaded)], [*map(_place, found)]
            _compare(of.what, uploaded, found)

    def _put(self, kind: int, items: Sequence[PlanItem] | None, *, lost: bool = False) -> None:
        """End a transfer; None: PX4 has not stored it; `lost`: it may have."""
        if items is not None:
            self._uploaded[kind] = items
        self._telemetry.plan.guard.transfer_ends(perhaps_stored=lost or items is not None)

    def _broken_off(self) -> None:
        """End a transfer whose outcome is unknown, if one is still under way."""
        self._telemetry.plan.guard.transfer_ends(perhaps_stored=True)

    async def _upload(self, to: _ItemList, items: Sequence[PlanItem]) -> None:
        """Send a list; retry while PX4 is busy with another sender's."""
        raw_items = [to_raw(seq, item, to.kind) for seq, item in enumerate(items)]
        for attempt in range(PLAN_BUSY_ATTEMPTS):
            if attempt:
                await asyncio.sleep(PLAN_BUSY_S)
            await self._may_change(to.kind)
            result, *_ = await _transfer(to.what, to.upload, raw_items)
            stored = result == MissionRawResult.SUCCESS
            lost = result == MissionRawResult.TIMEOUT
            self._put(to.kind, items if stored else None, lost=lost)
            if stored:
                return
            if result not in _PASSING:
                break
            if result in _BUSY and not self._telemetry.refusals:
                self._telemetry.plan_refused()
        hint = ""
        if result == MissionRawResult.TOO_MANY_MISSION_ITEMS and to.kind == FENCE:
            count = f"it has {len(items)} points, PX4 1.17 stores {FENCE_POINTS} of a fence"
            hint = f"; {count}: draw it simpler"
        texts = self._telemetry.texts()
        raise PlanRefusedError(f"PX4 did not accept {to.what}: {result.name}{texts}{hint}")

    async def download(self, of: _ItemList) -> list[PlanItem]:
        """Read one list. Raises PlanRefusedError if it cannot be read."""
        result, items = await _patiently(of.what, of.download)
        if result == MissionRawResult.NO_MISSION_AVAILABLE:
            return []
        if result != MissionRawResult.SUCCESS:
            texts = self._telemetry.texts()
            raise PlanRefusedError(f"{of.what} cannot be read back: {result.name}{texts}")
        return [from_raw(of.what, item) for item in items]

    @property
    def _reports_state(self) -> bool:
        """Whether MISSION_CURRENT reports the mission's feasibility: from PX4 1.17 on."""
        return self._telemetry.plan.mission_state != MISSION_UNKNOWN

    async def _feasible(self, total: int, *, cleared: bool = False) -> None:
        """Wait until PX4 finds the mission on board feasible.

        Args:
            total: Number of its items.
            cleared: No mission was on board before.

        Raises:
            PlanRefusedError: It is infeasible, or PX4 does not report it.
        """
        telemetry = self._telemetry
        # The last report, and the next one under way, may concern the previous plan.
        fresh = telemetry.plan.count + 2

        def judged() -> bool:
            if telemetry.plan.count < fresh or telemetry.plan.item_total != total:
                return False
            return telemetry.plan.mission_state != MISSION_INVALID or bool(telemetry.refusals)

        await telemetry.shows(judged, PLAN_FEASIBLE_S)
        if telemetry.plan.item_total == total:
            if telemetry.plan.mission_state > MISSION_INVALID:
                return
            if not self._reports_state and await self._can_run(cleared=cleared):
                return
        reasons = "; ".join(dict.fromkeys(telemetry.refusals))
        why = f": {reasons}" if reasons else telemetry.texts()
        raise PlanRefusedError(
            f"PX4 stored the mission but finds that it cannot be flown{why}"
            + ("" if why else "; its reason is in the ground station's messages")
        )

    async def _can_run(self, *, cleared: bool) -> bool:
        """Whether Mission mode can run, if MISSION_CURRENT does not report it (before 1.17).

        PX4 checks a mission only after it has read the fence on board.

        Raises PlanRefusedError if PX4 does not report this either.
        """
        telemetry, reports = self._telemetry, self._telemetry.reports
        if not cleared:  # until then they may concern the previous plan
            reloaded_s = telemetry.time_s + PLAN_RELOAD_S
            await telemetry.shows(lambda: telemetry.time_s >= reloaded_s, PLAN_CHECKS_S)
        before, end_s = reports.count, loop_s() + PLAN_CHECKS_S

        def runs() -> bool:
            return reports.count > before and bool(reports.mission_can_run)

        while not runs() and loop_s() < end_s:
            if await arming_report(telemetry) and telemetry.refusals:
                break
            await telemetry.shows(runs, PLAN_CHECKS_AGAIN_S)
        if reports.count > before and reports.mission_can_run is not None:
            return reports.mission_can_run
        version = telemetry.identity.version or ""
        raise PlanRefusedError(
            f"PX4 {version} stored the mission, and neither MISSION_CURRENT "
            "nor a report of its arming checks shows whether it can be flown: try again; if that "
            "does not help, check whether the link drops EVENT messages"
        )


async def _patiently(what: str, method: Callable[..., None], *arguments: Any) -> tuple[Any, ...]:
    """Run a transfer; retry if another is under way, or too many packets were lost."""
    for _ in range(PLAN_BUSY_ATTEMPTS - 1):
        reply = await _transfer(what, method, *arguments)
        if reply[0] not in _PASSING:
            return reply
        await asyncio.sleep(PLAN_BUSY_S)
    return await _transfer(what, method, *arguments)


async def _transfer(what: str, method: Callable[..., None], *arguments: Any) -> tuple[Any, ...]:
    try:
        return await call(method, *arguments, timeout_s=PLAN_TRANSFER_S)
    except TimeoutError:
        raise PlanRefusedError(
            f"{what}: the transfer did not end within {PLAN_TRANSFER_S:.0f} s; "
            "is the link very slow?"
        ) from None


def _compare(what: str, sent: list[PlanItem], on_board: list[PlanItem]) -> None:
    if len(sent) != len(on_board):
        raise PlanRefusedError(f"{what}: {len(sent)} items sent, {len(on_board)} are on board")
    for seq, (mine, theirs) in enumerate(zip(sent, on_board, strict=True)):
        if not mine.same_as(theirs):
            _log.info("%s: item %d was sent as %s, on board is %s", what, seq, mine, theirs)
            raise PlanRefusedError(f"{what}: item {seq} on board is another than was sent")


def _place(item: PlanItem) -> PlanItem:
    # PX4 returns places in a global frame of its choice.
    return PlanItem(
        item.command, Frame.GLOBAL_INT, (item.params[0], 0, 0, 0), item.x_deg_e7, item.y_deg_e7
    )
