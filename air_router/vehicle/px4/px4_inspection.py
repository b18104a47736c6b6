"""Asking a PX4 on the ground for all that a pre-flight check looks at."""

import asyncio
import contextlib
import json
import logging
from collections.abc import Callable, Sequence
from typing import Any, Final

from mavsdk.plugins.events.events import Events
from mavsdk.plugins.mavlink_direct.mavlink_direct import (
    MavlinkDirect,
    MavlinkDirectError,
    MavlinkDirectResult,
)

from air_router.vehicle.events.px4_health import reported_problems
from air_router.vehicle.inspection import Inspection
from air_router.vehicle.mavlink.mavsdk_bridge import call, message
from air_router.vehicle.px4.px4_order import AUTOPILOT
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry

_log = logging.getLogger(__name__)

RUN_PREARM_CHECKS: Final = 401  # MAV_CMD: PX4 sends its health and arming report anew

HEALTH_S: Final = 4.0
"""Wall-clock time for a vehicle that was just switched on to become healthy."""

REPORT_S: Final = 1.0
WORDS_S: Final = 1.0
PARAMETER_S: Final = 0.5
ATTEMPTS: Final = 5


async def inspect(
    events: Callable[[], Events],
    direct: MavlinkDirect,
    telemetry: Px4Telemetry,
    system_id: int,
    parameters: Sequence[str],
) -> Inspection:
    """Ask, wait a little where it is worth it, and put together what came."""
    target = {"target_system": system_id, "target_component": AUTOPILOT}
    await asyncio.gather(
        _parameters(direct, telemetry, target, parameters),
        _until(telemetry, lambda: telemetry.health_good, HEALTH_S),
    )
    await _report(direct, telemetry, target)
    report = telemetry.reports.last
    problems = () if report is None else report.problems
    if not telemetry.health_good and not problems:
        problems = await reported_problems(events, WORDS_S)
    return Inspection(
        healthy=telemetry.health_good,
        problems=problems,
        warnings=() if report is None else report.warnings,
        gps=telemetry.gps,
        battery=telemetry.battery,
        voltage_v=telemetry.voltage_v,
        wind_m_s=telemetry.wind_m_s,
        unix_s=telemetry.unix_s(),
        parameters={name: telemetry.parameters.get(name) for name in parameters},
    )


async def _parameters(
    direct: MavlinkDirect, telemetry: Px4Telemetry, target: dict[str, int], names: Sequence[str]
) -> None:
    """Read parameters: PX4 answers nothing for one that it does not have, so lost is asked again.

    MAVSDK asks for one after the other and waits three seconds for each that is missing.
    """
    telemetry.parameters.clear()
    known = telemetry.parameters
    for attempt in range(ATTEMPTS):
        missing = [name for name in names if name not in known]
        if not missing or (attempt > 1 and len(missing) < len(names) // 4):
            return
        for name in missing:
            _send(direct, "PARAM_REQUEST_READ", {**target, "param_id": name, "param_index": -1})
        await _until(telemetry, lambda: all(name in known for name in names), PARAMETER_S)


async def _report(direct: MavlinkDirect, telemetry: Px4Telemetry, target: dict[str, int]) -> None:
    before = telemetry.reports.count
    params = {f"param{n}": 0.0 for n in range(1, 8)}
    fields = {**target, "command": RUN_PREARM_CHECKS, "confirmation": 0, **params}
    command = message("COMMAND_LONG", fields, target["target_system"])
    try:
        result, answer = await call(direct.send_command_async, command, timeout_s=REPORT_S)
    except TimeoutError:
        return
    if result == MavlinkDirectResult.SUCCESS and json.loads(answer.fields_json)["result"] == 0:
        await _until(telemetry, lambda: telemetry.reports.count > before, REPORT_S)


def _send(direct: MavlinkDirect, name: str, fields: dict[str, Any]) -> None:
    try:
        direct.send_message(message(name, fields))
    except MavlinkDirectError as error:
        _log.info("%s was not sent: %s", name, error.result.name)


async def _until(telemetry: Px4Telemetry, condition: Callable[[], bool], limit_s: float) -> None:
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(limit_s):
            await telemetry.wait_for(condition)
