"""A PX4 vehicle through MAVSDK: the one implementation of `air_router.vehicle.vehicle.Vehicle`.

Commands are believed when the vehicle's own messages show them (HEARTBEAT and CURRENT_MODE,
MISSION_CURRENT, POSITION_TARGET_GLOBAL_INT). What moves the vehicle leaves once (`px4_commands`).
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from types import MappingProxyType
from typing import Any, Final

from mavsdk.plugins.events.events import Events
from mavsdk.plugins.geofence.geofence import Geofence
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirect, MavlinkDirectError
from mavsdk.plugins.mission_raw.mission_raw import MissionRaw

from air_router.errors import ArmingRefusedError, NotConfirmedError, PlanRefusedError
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.mission import Mission
from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.events.px4_health import arming_problems
from air_router.vehicle.inspection import Inspection
from air_router.vehicle.mavlink.mavsdk_bridge import call, message
from air_router.vehicle.mavlink.px4_connection import Px4Connection
from air_router.vehicle.px4.px4_commands import Px4Commands
from air_router.vehicle.px4.px4_inspection import inspect
from air_router.vehicle.px4.px4_motions import Px4Motions
from air_router.vehicle.px4.px4_order import AUTOPILOT
from air_router.vehicle.px4.px4_plan import (
    RALLY,
    clear_fence,
    clear_rally_points,
    compare_plan,
    renew_plan,
    upload_plan,
    verify_plan,
)
from air_router.vehicle.px4.px4_plan_guard import PlanGuard
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry
from air_router.vehicle.vehicle import (
    FlightMode,
    LinkSilent,
    PlanCompared,
    PlanReplaced,
    Vehicle,
    VehicleEvent,
    VehicleInfo,
)
from geo.frame import Point

_log = logging.getLogger(__name__)

SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 511, 512  # MAV_CMD
GPS_RAW_INT, GLOBAL_POSITION_INT, POSITION_TARGET_GLOBAL_INT = 24, 33, 87  # message ids
WIND_COV = 231
AUTOPILOT_VERSION, HOME_POSITION, FLIGHT_INFORMATION = 148, 242, 264
RATES_HZ: Final = MappingProxyType(
    {GLOBAL_POSITION_INT: 10.0, POSITION_TARGET_GLOBAL_INT: 2.0, GPS_RAW_INT: 2.0, WIND_COV: 1.0}
)
"""How often we want what PX4 sends so often that reading it takes our time."""

ONCE: Final = (HOME_POSITION, AUTOPILOT_VERSION, FLIGHT_INFORMATION)
"""What is asked for on connecting."""

STREAMS: Final = MappingProxyType(
    {
        "HEARTBEAT": 0,
        "SYS_STATUS": 1,
        "GPS_RAW_INT": GPS_RAW_INT,
        "GLOBAL_POSITION_INT": GLOBAL_POSITION_INT,
        "MISSION_CURRENT": 42,
        "POSITION_TARGET_GLOBAL_INT": POSITION_TARGET_GLOBAL_INT,
        "EXTENDED_SYS_STATE": 245,
    }
)
"""What a flight rests on, by message id."""

ASK_AGAIN_S: Final = 2.0
"""A stream that is missing for so long, while others come, is asked for, and again every
`ASK_EVERY_S` of our clock: it was turned off, perhaps, by another program on this link."""

ASK_EVERY_S: Final = 5.0

ANSWER_S: Final = 5.0
"""Wall-clock limit for a command's answer; on the ground these take milliseconds."""

ONCE_S: Final = 1.5
"""Wall-clock limit for what is asked for at the beginning, and can be done without."""

SILENT_S: Final = 3.0
HEALTH_S: Final = 60.0
NOTICE: Final = 5
TEXT_LIMIT: Final = 50


class Px4Vehicle(Vehicle):
    """Flies one PX4.

    Args:
        mission: Its local frame and speed; the vehicle is told WGS-84 degrees.
        url: MAVSDK connection URL, such as `udpin://127.0.0.1:14540`.
        clock: Told the vehicle's time.
        system_id: The vehicle's MAVLink system id; ours must be the same.
        connection: What opens the link; a rehearsal's leads to a vehicle in the same process.
    """

    def __init__(
        self,
        mission: Mission,
        url: str,
        clock: VehicleClock,
        *,
        system_id: int = 1,
        connection: Callable[[str, int], Px4Connection] = Px4Connection,
    ) -> None:
        self._connection = connection(url, system_id)
        self._telemetry = Px4Telemetry(mission.frame, clock)
        self._commands = Px4Commands(self._telemetry, system_id)
        self._motions = Px4Motions(mission, self._telemetry, self._commands)
        self._events: Callable[[], Events]  # makes the plugin; for reports on arming
        self._raw: MissionRaw  # missions, from `connect` on
        self._geofence: Geofence  # from `connect` on
        self._direct: MavlinkDirect  # from `connect` on
        self._plan_lock = asyncio.Lock()  # one transfer of the plan at a time, and none at take-off
        self._plan_guard = PlanGuard(self._compare, self._on_compared)
        self._telemetry.subscribe(self._on_event)
        self._texts_sent = 0  # id of a text in pieces
        self._watches: list[asyncio.Task[None]] = []  # run while it is connected
        self._callback: Callable[[VehicleEvent], None] | None = None  # told of vehicle events

    @property
    def telemetry(self) -> Px4Telemetry:
        """What the vehicle said last."""
        return self._telemetry

    async def connect(self) -> VehicleInfo:
        """See `Vehicle.connect`; also asks for the positions often enough to fly by them."""
        plugins = await self._connection.open()
        self._direct, self._raw = plugins.direct, plugins.raw
        self._geofence, self._events = plugins.geofence, plugins.events
        self._telemetry.listen(self._direct, self._connection.system_id)
        self._commands.listen(self._direct)
        requests = [(SET_MESSAGE_INTERVAL, what, 1e6 / hz) for what, hz in RATES_HZ.items()]
        requests += [(REQUEST_MESSAGE, what, 0.0) for what in ONCE]
        await asyncio.gather(*(self._request_message(*request) for request in requests))
        telemetry = self._telemetry
        await self._connection.heard(telemetry.complete, "positions")
        await telemetry.shows(lambda: None not in (telemetry.version, telemetry.home), ONCE_S)
        work = (self._watch_silence(), self._watch_streams())
        self._watches = [asyncio.create_task(watch) for watch in work]
        return VehicleInfo(
            system_id=self._connection.system_id,
            autopilot="PX4",
            version=self._telemetry.version or "of unknown version",
            home=self._telemetry.home,
            home_altitude_amsl_m=self._telemetry.home_altitude_amsl_m,
            took_off_s=self._telemetry.took_off_s,
        )

    def subscribe(self, callback: Callable[[VehicleEvent], None]) -> None:
        """See `Vehicle.subscribe`."""
        self._callback = callback
        self._telemetry.subscribe(callback)

    async def inspect(self, parameters: Sequence[str]) -> Inspection:
        """See `Vehicle.inspect`; a vehicle that is just being switched on is given some seconds."""
        return await inspect(
            self._events, self._direct, self._telemetry, self._connection.system_id, parameters
        )

    async def recognise(self, plan: FlightPlan) -> None:
        """See `Vehicle.recognise`."""
        async with self._plan_lock:
            await compare_plan(self._raw, self._telemetry, plan)
            self._guard(plan)

    async def upload(self, plan: FlightPlan) -> None:
        """See `Vehicle.upload`: fence first, so that the mission is judged against it."""
        async with self._plan_lock:
            if not plan.fence:
                await clear_fence(self._geofence, self._telemetry)
            if not plan.rally:
                await clear_rally_points(self._raw, self._telemetry, self._clear_rally_points)
            await upload_plan(self._raw, self._telemetry, plan)
            self._guard(plan)

    async def renew(self, plan: FlightPlan) -> None:
        """See `Vehicle.renew`."""
        async with self._plan_lock:
            await self._renew(plan)

    async def _renew(self, plan: FlightPlan) -> None:
        self._telemetry.leave_plan_alone()
        try:
            if not plan.rally:
                await clear_rally_points(self._raw, self._telemetry, self._clear_rally_points)
            flying = self._telemetry.in_air and self._telemetry.mode is FlightMode.MISSION
            await renew_plan(
                self._raw,
                self._telemetry,
                plan,
                lambda: clear_fence(self._geofence, self._telemetry),
                same_items=bool(flying),
            )
            self._plan_guard.plan = plan
        finally:
            self._telemetry.guard_plan()

    async def arm(self) -> None:
        """See `Vehicle.arm`."""
        telemetry = self._telemetry
        before = telemetry.mode
        if not await telemetry.shows(lambda: telemetry.health_good, HEALTH_S):
            raise ArmingRefusedError(
                f"not ready to arm after {HEALTH_S:.0f} s{await arming_problems(self._events)}"
                f"{telemetry.said()}; see the arming checks in the ground station"
            )
        if telemetry.armed or telemetry.mode not in {before, FlightMode.HOLD, FlightMode.MISSION}:
            raise ArmingRefusedError(
                f"the pilot has armed it, or chosen {telemetry.mode.value} mode; "
                "it is left to the pilot"
            )
        try:
            await self._motions.arm()
        except NotConfirmedError as error:
            raise ArmingRefusedError(
                f"{error}{await arming_problems(self._events)}; see the arming checks in the "
                "ground station"
            ) from None

    async def start(self) -> None:
        """See `Vehicle.start`."""
        async with self._plan_lock:  # PX4 begins what is on board when the mode changes
            await self._motions.start()

    async def jump(self, item: int, objection: Callable[[], str | None] | None = None) -> None:
        """See `Vehicle.jump`."""
        await self._motions.jump(item, objection)

    async def reposition(self, point: Point, altitude_m: float) -> None:
        """See `Vehicle.reposition`."""
        await self._motions.reposition(point, altitude_m)

    async def hold(self) -> None:
        """See `Vehicle.hold`."""
        await self._motions.hold()

    async def land(self) -> None:
        """See `Vehicle.land`."""
        await self._motions.land()

    async def announce(self, text: str) -> None:
        """See `Vehicle.announce`: PX4 forwards a companion's STATUSTEXT to the ground station."""
        self._texts_sent = self._texts_sent % 0xFFFF + 1
        chunks = chunks_of(text)
        for chunk, part in enumerate(chunks):
            fields = {
                "severity": NOTICE,
                "text": part,
                "id": self._texts_sent if len(chunks) > 1 else 0,
                "chunk_seq": chunk,
            }
            try:
                self._direct.send_message(message("STATUSTEXT", fields))
            except MavlinkDirectError as error:
                _log.warning("the pilot was not told %r: %s", text, error.result.name)
                return

    async def close(self) -> None:
        """See `Vehicle.close`."""
        for watch in self._watches:
            watch.cancel()
        self._motions.close()
        self._plan_guard.close()
        await self._connection.close()

    def _guard(self, plan: FlightPlan) -> None:
        """This plan is on board; another, or the same anew, is noticed from now on."""
        self._plan_guard.plan = plan
        self._telemetry.guard_plan()

    async def _compare(self, plan: FlightPlan) -> None:
        async with self._plan_lock:
            await verify_plan(self._raw, self._telemetry, plan)

    def _on_event(self, event: VehicleEvent) -> None:
        if isinstance(event, PlanReplaced):
            self._plan_guard.replaced()

    def _on_compared(self, difference: str | None) -> None:
        if self._callback is not None:
            # Not from here: an error in what it leads to would end the comparing, unseen.
            event = PlanCompared(self._telemetry.time_s, difference)
            asyncio.get_running_loop().call_soon(self._callback, event)

    def _clear_rally_points(self) -> None:
        target = {"target_system": self._connection.system_id, "target_component": AUTOPILOT}
        try:
            self._direct.send_message(
                message("MISSION_CLEAR_ALL", target | {"mission_type": RALLY})
            )
        except MavlinkDirectError as error:
            raise PlanRefusedError(f"rally points stay on board: {error.result.name}") from None

    async def _answer(self, method: Callable[..., None], *arguments: Any) -> tuple[Any, ...]:
        try:
            return await call(method, *arguments, timeout_s=ANSWER_S)
        except TimeoutError:
            name = method.__name__.removesuffix("_async")
            raise NotConfirmedError(f"{name}: no answer within {ANSWER_S:.0f} s") from None

    async def _request_message(self, command: int, *params: float) -> None:
        """Ask for a message or its rate; without it things go on, only less well."""
        try:
            async with asyncio.timeout(ONCE_S):
                await self._command(command, *params)
        except (NotConfirmedError, TimeoutError):
            _log.info("command %d %s was not answered", command, params)

    async def _command(self, command: int, *params: float) -> None:
        """Send a COMMAND_LONG and wait for its answer, whatever that says."""
        values = (*params, *(0.0,) * (7 - len(params)))
        fields = {
            "target_system": self._connection.system_id,
            "target_component": AUTOPILOT,
            "command": command,
            "confirmation": 0,
            **{f"param{n}": value for n, value in enumerate(values, start=1)},
        }
        text = message("COMMAND_LONG", fields, self._connection.system_id)
        await self._answer(self._direct.send_command_async, text)

    async def _watch_streams(self) -> None:
        while True:
            await asyncio.sleep(ASK_EVERY_S)
            await self._ask_again()

    async def _ask_again(self) -> None:
        """Ask for streams that are missing, at our rate or the autopilot's own."""
        for name in self._telemetry.missing(ASK_AGAIN_S):
            what = STREAMS[name]
            interval_us = 1e6 / RATES_HZ[what] if what in RATES_HZ else 0.0
            await self._request_message(SET_MESSAGE_INTERVAL, what, interval_us)

    async def _watch_silence(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(SILENT_S / 3)
            silent_s = self._telemetry.silent_s()
            if silent_s > SILENT_S and self._callback is not None:
                # Not from here: an error in what it leads to would end this watch, unseen.
                loop.call_soon(self._callback, LinkSilent(self._telemetry.time_s, silent_s))


def chunks_of(text: str) -> list[str]:
    """A text in pieces that a STATUSTEXT takes: 50 bytes of UTF-8, no letter cut in two."""
    chunks = [""]
    for letter in text:
        if len((chunks[-1] + letter).encode()) > TEXT_LIMIT:
            chunks.append("")
        chunks[-1] += letter
    return chunks
