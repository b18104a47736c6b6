"""Putting a plan on board of a PX4 and making sure that it is the one that flies.

An accepted upload means *stored*: whether PX4 finds the mission feasible shows later, and only
in MISSION_CURRENT.mission_state. So what is on board is read back, compared, and waited for.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Final

from mavsdk.plugins.geofence.geofence import Geofence, GeofenceResult
from mavsdk.plugins.mission_raw.mission_raw import MissionItem, MissionRaw, MissionRawResult

from air_router.errors import PlanRefusedError
from air_router.mission.fence_plan import FENCE_POINTS
from air_router.mission.flight_plan import Command, FlightPlan, Frame, PlanItem
from air_router.vehicle.mavlink.mavsdk_bridge import call
from air_router.vehicle.px4.px4_telemetry import MISSION_INVALID, Px4Telemetry

_log = logging.getLogger(__name__)

TRANSFER_S: Final = 30.0
"""Wall-clock limit for one transfer; a slow telemetry radio takes its time."""

FEASIBLE_S: Final = 5.0
"""Wall-clock limit for PX4 to judge a mission: it does within a second."""

BUSY_ATTEMPTS: Final = 3
BUSY_S: Final = 5.5
"""PX4 ignores uploads for five seconds after a transfer that was not finished."""

_PASSING: Final = frozenset(
    {
        MissionRawResult.BUSY,
        MissionRawResult.ERROR,
        MissionRawResult.TIMEOUT,
        # Over a slow link an item of the list before comes once more, and PX4 answers that.
        MissionRawResult.PROTOCOL_ERROR,
    }
)
MISSION, FENCE, RALLY = 0, 1, 2  # MAV_MISSION_TYPE


async def upload_plan(raw: MissionRaw, telemetry: Px4Telemetry, plan: FlightPlan) -> None:
    """Upload the plan, read all of it back, and wait until PX4 finds the mission feasible.

    What MAVSDK cannot upload is an empty fence and no rally points: that is what `clear_fence` and
    `clear_rally_points` are for.

    Raises:
        PlanRefusedError: not taken, not the same when read back, or judged infeasible.
    """
    telemetry.forget_words()
    if plan.fence:
        await _upload("the fence", raw.upload_geofence_async, plan.fence, FENCE, telemetry)
    if plan.rally:
        upload = raw.upload_rally_points_async
        await _upload("the list of rally points", upload, plan.rally, RALLY, telemetry)
    await _upload("the mission", raw.upload_mission_async, plan.items, MISSION, telemetry)
    await compare_plan(raw, telemetry, plan)
    try:
        await _feasible(telemetry, len(plan.items))
    except PlanRefusedError:
        if telemetry.refusals:
            raise
        # The same mission was on board before, and PX4 keeps to what it thought of it when it was
        # switched on: it judges a mission anew only if it is another.
        await _transfer("no mission", raw.clear_mission_async)
        await _upload("the mission", raw.upload_mission_async, plan.items, MISSION, telemetry)
        await compare_plan(raw, telemetry, plan)
        await _feasible(telemetry, len(plan.items))


async def renew_plan(
    raw: MissionRaw,
    telemetry: Px4Telemetry,
    plan: FlightPlan,
    clear: Callable[[], Awaitable[None]],
    *,
    same_items: bool = False,
) -> None:
    """Put a changed fence on board, and what it makes of the items; see `Vehicle.renew`.

    PX4 judges the mission after each of them. New items might lie in the fence before, and those
    before in the new one: between the two there is none.

    Args:
        raw: up- and downloads.
        telemetry: what the vehicle says.
        plan: what is to be on board.
        clear: takes the fence off board.
        same_items: other items must not be sent now.

    Raises:
        PlanRefusedError: as `upload_plan`; or the items are others and must not be.
    """
    telemetry.forget_words()
    items = await _download("the mission", raw.download_mission_async, telemetry)
    if not _all_same(plan.items, items):
        if same_items:
            raise PlanRefusedError("other items while it flies the mission: hold first")
        await clear()
        await _upload("the mission", raw.upload_mission_async, plan.items, MISSION, telemetry)
    what = "the list of rally points"
    rally = await _download(what, raw.download_rallypoints_async, telemetry)
    if plan.rally and [_place(v) for v in plan.rally] != [_place(v) for v in rally]:
        await _upload(what, raw.upload_rally_points_async, plan.rally, RALLY, telemetry)
    if plan.fence:
        await _upload("the fence", raw.upload_geofence_async, plan.fence, FENCE, telemetry)
    else:
        await clear()
    await compare_plan(raw, telemetry, plan)
    await _feasible(telemetry, len(plan.items))


async def verify_plan(raw: MissionRaw, telemetry: Px4Telemetry, plan: FlightPlan) -> None:
    """Make sure that what is on board flies as the plan does, without changing it.

    Raises:
        PlanRefusedError: it is another plan, cannot be read, or PX4 finds that it cannot be flown.
    """
    await compare_plan(raw, telemetry, plan)
    await _feasible(telemetry, len(plan.items))


async def compare_plan(raw: MissionRaw, telemetry: Px4Telemetry, plan: FlightPlan) -> None:
    """Read fence, rally points and items back and compare.

    Raises:
        PlanRefusedError: what is on board is another plan.
    """
    fence = await _download("the fence", raw.download_geofence_async, telemetry)
    _compare("the fence", [_place(v) for v in plan.fence], [_place(v) for v in fence])
    what = "the list of rally points"
    rally = await _download(what, raw.download_rallypoints_async, telemetry)
    _compare(what, [_place(v) for v in plan.rally], [_place(v) for v in rally])
    items = await _download("the mission", raw.download_mission_async, telemetry)
    _compare("the mission", list(plan.items), items)


async def clear_fence(geofence: Geofence, telemetry: Px4Telemetry) -> None:
    """Take the fence of an earlier mission off board.

    Raises:
        PlanRefusedError: it stays.
    """
    (result,) = await _transfer("no fence", geofence.clear_geofence_async)
    if result != GeofenceResult.SUCCESS:
        raise PlanRefusedError(f"the fence on board stays: {result.name}{telemetry.said()}")


async def clear_rally_points(
    raw: MissionRaw, telemetry: Px4Telemetry, clear: Callable[[], None]
) -> None:
    """Take rally points of an earlier mission off board: a return would go there.

    Args:
        raw: downloads them.
        telemetry: what the vehicle says.
        clear: sends a MISSION_CLEAR_ALL for them; MAVSDK has no call for it.

    Raises:
        PlanRefusedError: they stay.
    """
    what = "the list of rally points"
    for _ in range(BUSY_ATTEMPTS):
        if not await _download(what, raw.download_rallypoints_async, telemetry):
            return
        clear()
    if await _download(what, raw.download_rallypoints_async, telemetry):
        raise PlanRefusedError(f"rally points of another mission stay on board{telemetry.said()}")


async def _upload(
    what: str,
    method: Callable[..., None],
    items: Sequence[PlanItem],
    mission_type: int,
    telemetry: Px4Telemetry,
) -> None:
    raw_items = [_to_raw(seq, item, mission_type) for seq, item in enumerate(items)]
    result, *_ = await _patiently(what, method, raw_items)
    if result == MissionRawResult.SUCCESS:
        return
    hint = ""
    if result == MissionRawResult.TOO_MANY_MISSION_ITEMS and mission_type == FENCE:
        count = f"it has {len(items)} points, PX4 1.17 stores {FENCE_POINTS} of a fence"
        hint = f"; {count}: draw it simpler"
    raise PlanRefusedError(f"{what} was not taken: {result.name}{telemetry.said()}{hint}")


async def _download(
    what: str, method: Callable[..., None], telemetry: Px4Telemetry
) -> list[PlanItem]:
    result, items = await _patiently(what, method)
    if result == MissionRawResult.NO_MISSION_AVAILABLE:
        return []
    if result != MissionRawResult.SUCCESS:
        raise PlanRefusedError(f"{what} cannot be read back: {result.name}{telemetry.said()}")
    return [_from_raw(what, item) for item in items]


async def _patiently(what: str, method: Callable[..., None], *arguments: Any) -> tuple[Any, ...]:
    """A transfer that is begun again where another is under way, or too many packets were lost."""
    for _ in range(BUSY_ATTEMPTS - 1):
        answer = await _transfer(what, method, *arguments)
        if answer[0] not in _PASSING:
            return answer
        await asyncio.sleep(BUSY_S)
    return await _transfer(what, method, *arguments)


async def _transfer(what: str, method: Callable[..., None], *arguments: Any) -> tuple[Any, ...]:
    try:
        return await call(method, *arguments, timeout_s=TRANSFER_S)
    except TimeoutError:
        raise PlanRefusedError(
            f"{what}: the transfer did not end within {TRANSFER_S:.0f} s; is the link very slow?"
        ) from None


async def _feasible(telemetry: Px4Telemetry, total: int) -> None:
    # What was said last may be of the plan before; the next report may have been on its way.
    fresh = telemetry.mission_reports + 2

    def judged() -> bool:
        if telemetry.mission_reports < fresh or telemetry.item_total != total:
            return False
        return telemetry.mission_state > MISSION_INVALID or bool(telemetry.refusals)

    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(FEASIBLE_S):
            await telemetry.wait_for(judged)
    if telemetry.mission_state > MISSION_INVALID and telemetry.item_total == total:
        return
    reasons = "; ".join(dict.fromkeys(telemetry.refusals))
    why = f": {reasons}" if reasons else telemetry.said()
    raise PlanRefusedError(
        f"PX4 stored the mission but finds that it cannot be flown{why}"
        + ("" if why else "; its reason is in the ground station's messages")
    )


def _all_same(mine: Sequence[PlanItem], theirs: Sequence[PlanItem]) -> bool:
    return len(mine) == len(theirs) and all(map(PlanItem.same_as, mine, theirs))


def _compare(what: str, sent: list[PlanItem], on_board: list[PlanItem]) -> None:
    if len(sent) != len(on_board):
        raise PlanRefusedError(f"{what}: {len(sent)} items sent, {len(on_board)} are on board")
    for seq, (mine, theirs) in enumerate(zip(sent, on_board, strict=True)):
        if not mine.same_as(theirs):
            _log.info("%s: item %d was sent as %s, on board is %s", what, seq, mine, theirs)
            raise PlanRefusedError(f"{what}: item {seq} on board is another than was sent")


def _place(item: PlanItem) -> PlanItem:
    # PX4 gives what is a place only back in a global frame of its choice.
    return PlanItem(
        item.command, Frame.GLOBAL_INT, (item.params[0], 0, 0, 0), item.x_deg_e7, item.y_deg_e7
    )


def _to_raw(seq: int, item: PlanItem, mission_type: int) -> MissionItem:
    first = int(seq == 0 and mission_type == MISSION)
    return MissionItem(
        seq=seq,
        frame=int(item.frame),
        command=int(item.command),
        current=first,
        autocontinue=int(item.autocontinue),
        param1=item.params[0],
        param2=item.params[1],
        param3=item.params[2],
        param4=item.params[3],
        x=item.x_deg_e7,
        y=item.y_deg_e7,
        z=item.z_m,
        mission_type=mission_type,
    )


def _from_raw(what: str, item: MissionItem) -> PlanItem:
    try:
        command, frame = Command(item.command), Frame(item.frame)
    except ValueError as error:
        raise PlanRefusedError(f"{what}: item {item.seq} on board is not ours: {error}") from None
    return PlanItem(
        command=command,
        frame=frame,
        params=(item.param1, item.param2, item.param3, item.param4),
        x_deg_e7=item.x,
        y_deg_e7=item.y,
        z_m=item.z,
        autocontinue=bool(item.autocontinue),
    )
