"""What a flight asks a PX4 to send: at what rates, once at the beginning, again if it ends."""

import asyncio
import logging
from collections.abc import Mapping
from typing import Final

from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirect

from air_router.vehicle.mavlink.mavsdk_bridge import call, message
from air_router.vehicle.px4.px4_order import AUTOPILOT
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry

_log = logging.getLogger(__name__)

SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 511, 512  # MAV_CMD
GPS_RAW_INT, GLOBAL_POSITION_INT, POSITION_TARGET_GLOBAL_INT = 24, 33, 87  # message ids
WIND_COV = 231
AUTOPILOT_VERSION, HOME_POSITION, FLIGHT_INFORMATION = 148, 242, 264
RATES_HZ: Final[Mapping[int, float]] = {
    GLOBAL_POSITION_INT: 10.0,
    POSITION_TARGET_GLOBAL_INT: 2.0,
    GPS_RAW_INT: 2.0,
    WIND_COV: 1.0,
}
"""How often we want what PX4 sends so often that reading it takes our time."""

ONCE: Final = (HOME_POSITION, AUTOPILOT_VERSION, FLIGHT_INFORMATION)
"""What is asked for on connecting."""

STREAMS: Final[Mapping[str, int]] = {
    "HEARTBEAT": 0,
    "SYS_STATUS": 1,
    "GPS_RAW_INT": GPS_RAW_INT,
    "GLOBAL_POSITION_INT": GLOBAL_POSITION_INT,
    "MISSION_CURRENT": 42,
    "POSITION_TARGET_GLOBAL_INT": POSITION_TARGET_GLOBAL_INT,
    "EXTENDED_SYS_STATE": 245,
}
"""What a flight rests on, by message id."""

ASK_AGAIN_S: Final = 2.0
"""A stream that is missing for so long, while others come, is asked for, and again every
`ASK_EVERY_S` of our clock: it was turned off, perhaps, by another program on this link."""

ASK_EVERY_S: Final = 5.0

ONCE_S: Final = 1.5
"""Wall-clock limit for what is asked for at the beginning, and can be done without."""


class Px4Requests:
    """Asks for messages; without an answer things go on, only less well.

    Args:
        direct: What sends the requests.
        telemetry: What the vehicle says.
        system_id: Its MAVLink system id.
    """

    def __init__(self, direct: MavlinkDirect, telemetry: Px4Telemetry, system_id: int) -> None:
        self._direct = direct
        self._telemetry = telemetry
        self._system_id = system_id

    async def begin(self) -> None:
        """Ask for everything that a flight wants to hear."""
        requests = [(SET_MESSAGE_INTERVAL, what, 1e6 / hz) for what, hz in RATES_HZ.items()]
        requests += [(REQUEST_MESSAGE, what, 0.0) for what in ONCE]
        await asyncio.gather(*(self.request(*request) for request in requests))

    async def go_on(self) -> None:
        """Ask now and then for streams that are missing; until it is cancelled."""
        while True:
            await asyncio.sleep(ASK_EVERY_S)
            await self.ask_again()

    async def ask_again(self) -> None:
        """Ask for streams that are missing, at our rate or the autopilot's own."""
        for name in self._telemetry.missing(ASK_AGAIN_S):
            what = STREAMS[name]
            interval_us = 1e6 / RATES_HZ[what] if what in RATES_HZ else 0.0
            await self.request(SET_MESSAGE_INTERVAL, what, interval_us)

    async def request(self, command: int, *params: float) -> None:
        """Send a COMMAND_LONG and wait for its answer, whatever that says."""
        values = (*params, *(0.0,) * (7 - len(params)))
        fields = {
            "target_system": self._system_id,
            "target_component": AUTOPILOT,
            "command": command,
            "confirmation": 0,
            **{f"param{n}": value for n, value in enumerate(values, start=1)},
        }
        text = message("COMMAND_LONG", fields, self._system_id)
        try:
            await call(self._direct.send_command_async, text, timeout_s=ONCE_S)
        except TimeoutError:
            _log.info("command %d %s was not answered", command, params)
