"""Requests to a PX4: the messages that a flight needs, and those of a pre-flight check.

A missing answer is not fatal.
"""

import asyncio
import logging
from collections.abc import Mapping, Sequence
from typing import Final

from air_router.vehicle import Inspection
from air_router.vehicle.px4.limits import (
    ARMING_REPORT_S,
    FIRST_RESPONSE_S,
    FLIGHT_INFORMATION_ATTEMPTS,
    INSPECTION_HEALTH_S,
    PARAMETER_ATTEMPTS,
    PARAMETER_RESPONSE_S,
    PARAMETERS_ABSENT,
    PARAMETERS_ABSENT_ATTEMPTS,
    STREAM_MISSING_S,
    STREAM_RATES_HZ,
    STREAM_REQUESTED_EVERY_S,
)
from air_router.vehicle.px4.mavlink_values import MavCmd, MessageId
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry

_log = logging.getLogger(__name__)


STREAMS: Final[Mapping[str, int]] = {
    each.name: each
    for each in (
        MessageId.HEARTBEAT,
        MessageId.SYS_STATUS,
        MessageId.GPS_RAW_INT,
        MessageId.GLOBAL_POSITION_INT,
        MessageId.MISSION_CURRENT,
        MessageId.POSITION_TARGET_GLOBAL_INT,
        MessageId.WIND_COV,
        MessageId.EXTENDED_SYS_STATE,
    )
}
"""The messages that a flight needs or uses, with their ids."""

ONCE: Final = (MessageId.HOME_POSITION, MessageId.AUTOPILOT_VERSION, MessageId.FLIGHT_INFORMATION)
"""Requested once on connecting."""


async def begin(telemetry: Px4Telemetry) -> None:
    """Request all messages that a flight uses."""
    requests = [
        (MavCmd.SET_MESSAGE_INTERVAL, STREAMS[name], 1e6 / hz)
        for name, hz in STREAM_RATES_HZ.items()
    ]
    requests += [(MavCmd.REQUEST_MESSAGE, what, 0.0) for what in ONCE]
    await asyncio.gather(*(_request(telemetry, *request) for request in requests))


async def request_flight_information(telemetry: Px4Telemetry) -> None:
    """Request FLIGHT_INFORMATION again: a lost datagram must not cost the flight its duration."""
    for _ in range(FLIGHT_INFORMATION_ATTEMPTS):
        await _request(telemetry, MavCmd.REQUEST_MESSAGE, MessageId.FLIGHT_INFORMATION)
        if await telemetry.shows(lambda: telemetry.flight_info_received, PARAMETER_RESPONSE_S):
            return


async def keep_streams(telemetry: Px4Telemetry) -> None:
    """Request missing streams at intervals, until canceled."""
    while True:
        await asyncio.sleep(STREAM_REQUESTED_EVERY_S)
        await request_again(telemetry)


async def request_again(telemetry: Px4Telemetry) -> None:
    """Request missing streams, at our rate or PX4's default."""
    for name in telemetry.missing(STREAM_MISSING_S):
        interval_us = 1e6 / STREAM_RATES_HZ[name] if name in STREAM_RATES_HZ else 0.0
        await _request(telemetry, MavCmd.SET_MESSAGE_INTERVAL, STREAMS[name], interval_us)


async def _request(telemetry: Px4Telemetry, command: int, *params: float) -> None:
    if await telemetry.request_result(command, *params, limit_s=FIRST_RESPONSE_S) is None:
        _log.info("command %d %s was not answered", command, params)


async def inspect(telemetry: Px4Telemetry, parameters: Sequence[str]) -> Inspection:
    """Request the data of an inspection, wait briefly, and assemble it.

    Args:
        telemetry: Messages of a PX4 on the ground.
        parameters: Names of the parameters to read.
    """
    reports = telemetry.reports
    await asyncio.gather(
        _read_parameters(telemetry, parameters),
        telemetry.shows(lambda: telemetry.status.health_good, INSPECTION_HEALTH_S),
    )
    await arming_report(telemetry)
    return Inspection(
        healthy=telemetry.status.health_good,
        problems=reports.problems,
        warnings=reports.warnings,
        gps=telemetry.gps.fix,
        battery=telemetry.status.battery,
        voltage_v=telemetry.status.voltage_v,
        wind_m_s=telemetry.wind_m_s,
        unix_s=telemetry.unix_s(),
        parameters={name: telemetry.parameters.get(name) for name in parameters},
        absent=frozenset(telemetry.absent_parameters),
    )


async def arming_report(telemetry: Px4Telemetry) -> bool:
    """Request PX4's health and arming checks; return whether the report was received."""
    before = telemetry.reports.count
    if await telemetry.request_result(MavCmd.RUN_PREARM_CHECKS, limit_s=ARMING_REPORT_S) != 0:
        return False
    return await telemetry.shows(lambda: telemetry.reports.count > before, ARMING_REPORT_S)


async def _read_parameters(telemetry: Px4Telemetry, names: Sequence[str]) -> None:
    """Read parameters, and repeat requests without an answer.

    PX4 1.18 reports an absent parameter; before that it does not answer.

    MAVSDK requests one after another, and waits three seconds for each absent one.
    """
    telemetry.forget_parameters()

    def missing() -> list[str]:
        known = telemetry.parameters.keys() | telemetry.absent_parameters
        return [name for name in names if name not in known]

    for attempt in range(PARAMETER_ATTEMPTS):
        wanted = missing()
        few = len(wanted) < int(PARAMETERS_ABSENT * len(names))
        if not wanted or (few and attempt >= PARAMETERS_ABSENT_ATTEMPTS):
            return
        for name in wanted:
            fault = telemetry.send("PARAM_REQUEST_READ", {"param_id": name, "param_index": -1})
            if fault is not None:
                _log.info("the request for %s was not sent: %s", name, fault)
        await telemetry.shows(lambda: not missing(), PARAMETER_RESPONSE_S)
