"""Awaitable MAVSDK calls, built on its callback layer.

MAVSDK's own asyncio layer blocks an executor thread in C for each call; canceling such an await (a
time-out is enough) keeps the process from ending. Its callback layer needs no thread, so a call
without an answer costs only an unused future.
"""

import asyncio
import json
import logging
from collections.abc import Callable, Collection
from typing import Any, NamedTuple

from mavsdk.logging import LogLevel, log_subscribe
from mavsdk.mavsdk import Mavsdk
from mavsdk.plugins.geofence.geofence import Geofence
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.mission_raw.mission_raw import MissionItem, MissionRaw

from air_router.errors import PlanRefusedError
from air_router.mission import Command, Frame, PlanItem
from air_router.vehicle.px4.mavlink_values import MISSION

_log = logging.getLogger(__name__)


_LEVELS = {  # important results are also returned, and logged by us
    LogLevel.WARN: logging.INFO,
    LogLevel.ERROR: logging.INFO,
}


def route_log() -> None:
    """Send MAVSDK's log, which it prints on stdout, to Python's logging."""

    def to_logging(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
        _log.log(_LEVELS.get(level, logging.DEBUG), "MAVSDK: %s", message)
        return True

    log_subscribe(to_logging)


async def call(method: Callable[..., None], *arguments: Any, timeout_s: float) -> tuple[Any, ...]:
    """Call a `..._async` method of a MAVSDK plugin and await its callback's arguments.

    Args:
        method: The bound method, which takes its arguments and then a callback.
        arguments: The arguments before the callback.
        timeout_s: Wall-clock limit.

    Returns:
        The callback's arguments without the user data.

    Raises:
        TimeoutError: no answer in time; a late one is ignored.
    """
    loop = asyncio.get_running_loop()
    result: asyncio.Future[tuple[Any, ...]] = loop.create_future()

    def resolve(values: tuple[Any, ...]) -> None:
        if not result.done():
            result.set_result(values)

    def on_result(*values: Any) -> None:  # on MAVSDK's thread
        _from_thread(loop, resolve, values[:-1])

    method(*arguments, on_result)
    async with asyncio.timeout(timeout_s):
        return await result


class Received(NamedTuple):
    """A received message.

    Attributes:
        fields: The fields, as in the MAVLink definition.
        sender: System id and component id.
        arrived_s: Time of reception on the monotonic clock; the loop may handle it later.
    """

    fields: dict[str, Any]
    sender: tuple[int, int]
    arrived_s: float


def subscribe(direct: MavlinkDirect, name: str, callback: Callable[[Received], None]) -> None:
    """Pass every message of this name to `callback` on the loop."""
    loop = asyncio.get_running_loop()

    def on_message(message: MavlinkMessage, _user_data: Any) -> None:  # on MAVSDK's thread
        arrived_s = loop.time()
        sender = (message.system_id, message.component_id)
        _from_thread(loop, callback, Received(json.loads(message.fields_json), sender, arrived_s))

    direct.subscribe_message(name, on_message)


def destroy(mavsdk: Mavsdk, plugins: Collection[MavlinkDirect | MissionRaw | Geofence]) -> None:
    """End MAVSDK and its threads; blocks until they have ended.

    MAVSDK 4.1 releases a plugin's callbacks before its threads have ended: a late message would be
    passed to freed memory and crash the process. So references are kept here.
    """
    kept = [(list(each._callbacks), dict(each._subscriptions)) for each in plugins]  # noqa: SLF001
    mavsdk.destroy()
    kept.clear()


def message(name: str, fields: dict[str, Any], target: int = 0) -> MavlinkMessage:
    """A message to send through MavlinkDirect; fields as in the MAVLink definition."""
    return MavlinkMessage(
        message_name=name,
        target_system_id=target,
        target_component_id=1 if target else 0,
        fields_json=json.dumps(fields),
    )


def _from_thread(
    loop: asyncio.AbstractEventLoop, function: Callable[..., None], *args: Any
) -> None:
    try:
        loop.call_soon_threadsafe(function, *args)
    except RuntimeError:
        _log.debug("a message was received after the end of the flight")


def to_raw(seq: int, item: PlanItem, mission_type: int) -> MissionItem:
    """Convert an item of one of the lists for MAVSDK's upload."""
    current = int(seq == 0 and mission_type == MISSION)
    head = (seq, int(item.frame), int(item.command), current, int(item.autocontinue))
    place = (item.x_deg_e7, item.y_deg_e7, item.z_m)
    return MissionItem(*head, *item.params, *place, mission_type)


def from_raw(what: str, item: MissionItem) -> PlanItem:
    """Convert an item that was read back. Raises PlanRefusedError for an unknown kind."""
    try:
        command, frame = Command(item.command), Frame(item.frame)
    except ValueError as error:
        raise PlanRefusedError(f"{what}: item {item.seq} on board is not ours: {error}") from None
    params = (item.param1, item.param2, item.param3, item.param4)
    autocontinue = bool(item.autocontinue)
    return PlanItem(command, frame, params, item.x, item.y, item.z, autocontinue=autocontinue)
