"""A PX4 vehicle through MAVSDK: the one implementation of `air_router.vehicle.Vehicle`.

Commands are believed when the vehicle's own messages show them (HEARTBEAT and CURRENT_MODE,
MISSION_CURRENT), never for their acknowledgement: PX4 1.16 and 1.17 acknowledge every mode
change before they decide on it.
"""

from __future__ import annotations

import asyncio
import json
import logging
import math
from collections.abc import Callable, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from mavsdk.plugins.action.action import Action, ActionResult
from mavsdk.plugins.geofence.geofence import Geofence
from mavsdk.plugins.mavlink_direct.mavlink_direct import (
    MavlinkDirect,
    MavlinkDirectError,
    MavlinkDirectResult,
)
from mavsdk.plugins.mission_raw.mission_raw import MissionRaw

from air_router.errors import ArmingRefusedError, NotConfirmedError
from air_router.mavsdk_bridge import call, message
from air_router.px4_connection import Px4Connection
from air_router.px4_health import arming_problems
from air_router.px4_inspection import inspect
from air_router.px4_plan import RALLY, clear_fence, clear_rally_points, compare_plan, upload_plan
from air_router.px4_telemetry import Px4Telemetry
from air_router.vehicle import FlightMode, LinkSilent, Vehicle, VehicleEvent, VehicleInfo

if TYPE_CHECKING:
    from mavsdk.system import System

    from air_router.clock import VehicleClock
    from air_router.flight_plan import FlightPlan
    from air_router.inspection import Inspection
    from air_router.mission import Mission
    from geo.frame import Point

_log = logging.getLogger(__name__)

AUTOPILOT: Final = 1  # MAV_COMP_ID_AUTOPILOT1
DO_REPOSITION, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 192, 511, 512  # MAV_CMD
GLOBAL_INT: Final = 5  # MAV_FRAME; PX4 takes the altitude as AMSL in every frame
NOWHERE: Final = 2**31 - 1
GPS_RAW_INT, GLOBAL_POSITION_INT, POSITION_TARGET_GLOBAL_INT = 24, 33, 87  # message ids
AUTOPILOT_VERSION, HOME_POSITION = 148, 242
RATES_HZ: Final = MappingProxyType(
    {GLOBAL_POSITION_INT: 10.0, POSITION_TARGET_GLOBAL_INT: 2.0, GPS_RAW_INT: 2.0}
)
"""How often we want what PX4 sends so often that reading it takes our time."""

ANSWER_S: Final = 5.0
"""Wall-clock limit for a command's answer; on the ground these take milliseconds."""

CONFIRM_S: Final = 3.0
"""Wall-clock limit for a command to show: modes appear with the next HEARTBEAT, at 1 Hz."""

ONCE_S: Final = 1.5
"""Wall-clock limit for what is asked for at the beginning, and can be done without."""

ATTEMPTS: Final = 3
SILENT_S: Final = 3.0
HEALTH_S: Final = 60.0
NOTICE: Final = 5
TEXT_LIMIT: Final = 50


class Px4Vehicle(Vehicle):
    """Flies one PX4.

    Args:
        mission: Its local frame and speed; the vehicle is told WGS-84 degrees.
        url: MAVSDK connection URL, such as `udpin://0.0.0.0:14540`.
        clock: Told the vehicle's time.
        system_id: The vehicle's MAVLink system id; ours must be the same.
    """

    def __init__(
        self, mission: Mission, url: str, clock: VehicleClock, *, system_id: int = 1
    ) -> None:
        self._mission = mission
        self._connection = Px4Connection(url, system_id)
        self._telemetry = Px4Telemetry(mission.frame, clock)
        self._system: System
        self._action: Action
        self._raw: MissionRaw
        self._geofence: Geofence
        self._direct: MavlinkDirect
        self._texts_sent = 0
        self._watch: asyncio.Task[None] | None = None
        self._callback: Callable[[VehicleEvent], None] | None = None

    @property
    def telemetry(self) -> Px4Telemetry:
        """What the vehicle said last."""
        return self._telemetry

    async def connect(self) -> VehicleInfo:
        """See `Vehicle.connect`; also asks for the positions often enough to fly by them."""
        system = self._system = await self._connection.open()
        self._action = Action(system)
        self._raw = MissionRaw(system)
        self._geofence = Geofence(system)
        self._direct = MavlinkDirect(system)
        self._telemetry.listen(self._direct, self._connection.system_id)
        wishes = [(SET_MESSAGE_INTERVAL, what, 1e6 / hz) for what, hz in RATES_HZ.items()]
        wishes += [(REQUEST_MESSAGE, what, 0.0) for what in (HOME_POSITION, AUTOPILOT_VERSION)]
        await asyncio.gather(*(self._wish(*wish) for wish in wishes))
        telemetry = self._telemetry
        await self._connection.heard(telemetry.complete, "positions")
        await self._shows(lambda: None not in (telemetry.version, telemetry.home), ONCE_S)
        self._watch = asyncio.create_task(self._watch_silence())
        return VehicleInfo(
            system_id=self._connection.system_id,
            autopilot="PX4",
            version=self._telemetry.version or "of unknown version",
            home=self._telemetry.home,
            home_altitude_amsl_m=self._telemetry.home_altitude_amsl_m,
        )

    def subscribe(self, callback: Callable[[VehicleEvent], None]) -> None:
        """See `Vehicle.subscribe`."""
        self._callback = callback
        self._telemetry.subscribe(callback)

    async def inspect(self, parameters: Sequence[str]) -> Inspection:
        """See `Vehicle.inspect`; a vehicle that is just being switched on is given some seconds."""
        return await inspect(
            self._system, self._direct, self._telemetry, self._connection.system_id, parameters
        )

    async def recognise(self, plan: FlightPlan) -> None:
        """See `Vehicle.recognise`."""
        await compare_plan(self._raw, self._telemetry, plan)
        self._telemetry.guard_plan()

    async def upload(self, plan: FlightPlan) -> None:
        """See `Vehicle.upload`: fence first, so that the mission is judged against it."""
        if not plan.fence:
            await clear_fence(self._geofence, self._telemetry)
        if not plan.rally:
            await clear_rally_points(self._raw, self._telemetry, self._clear_rally_points)
        await upload_plan(self._raw, self._telemetry, plan)
        self._telemetry.guard_plan()

    async def arm(self) -> None:
        """See `Vehicle.arm`."""
        if self._telemetry.armed:
            return
        try:
            await self._shown(lambda: self._telemetry.health_good, HEALTH_S)
        except TimeoutError:
            raise ArmingRefusedError(
                f"not ready to arm after {HEALTH_S:.0f} s{await arming_problems(self._system)}"
                f"{self._telemetry.said()}; see the arming checks in the ground station"
            ) from None
        for _ in range(ATTEMPTS):
            (result,) = await self._answer(self._action.arm_async)
            if result == ActionResult.SUCCESS and await self._shows(lambda: self._telemetry.armed):
                return
        raise ArmingRefusedError(
            f"the autopilot answers {result.name}{await arming_problems(self._system)}"
            f"{self._telemetry.said()}; see the arming checks in the ground station"
        )

    async def start(self) -> None:
        """See `Vehicle.start`."""
        await self._mode(FlightMode.MISSION, self._raw.start_mission_async)

    async def jump(self, item: int) -> None:
        """See `Vehicle.jump`: the item first, then the mode, so that no old item is flown to.

        It is sent once and not, as MAVSDK's own call would, again and again: a leg was checked
        from where the vehicle was when it was commanded.
        """
        if 0 < self._telemetry.item_total <= item:
            raise NotConfirmedError(f"the plan on board has no item {item}")
        before = self._telemetry.mode
        fields = {
            "target_system": self._connection.system_id,
            "target_component": AUTOPILOT,
            "seq": item,
        }
        try:
            self._direct.send_message(message("MISSION_SET_CURRENT", fields))
        except MavlinkDirectError as error:
            raise NotConfirmedError(f"the jump was not sent: {error.result.name}") from None
        # PX4 drops the jump without an answer while somebody downloads the plan.
        if not await self._shows(lambda: self._telemetry.item == item):
            raise NotConfirmedError(f"the jump to item {item} did not show in MISSION_CURRENT")
        now = self._telemetry.mode
        if now is not FlightMode.MISSION:
            # Out of our own hovering; any other mode, or a change meanwhile, is the pilot's.
            if now is not FlightMode.HOLD or before is not FlightMode.HOLD:
                raise NotConfirmedError(f"somebody chose {now.value} mode")
            await self._mode(FlightMode.MISSION, self._raw.start_mission_async, attempts=1)
            await self._set_speed()

    async def reposition(self, point: Point, altitude_m: float) -> None:
        """See `Vehicle.reposition`.

        DO_REPOSITION is always above mean sea level. Home's altitude moves in flight, so the
        target is the present altitude corrected by what is missing, both of one message.
        """
        latitude_deg, longitude_deg = self._mission.frame.to_geodetic(point)
        amsl_m = self._telemetry.altitude_amsl_m + altitude_m - self._telemetry.altitude_m
        (result,) = await self._answer(
            self._action.goto_location_async, latitude_deg, longitude_deg, amsl_m, math.nan
        )
        if result != ActionResult.SUCCESS:
            raise NotConfirmedError(f"reposition: {result.name}{self._telemetry.said()}")
        if not await self._shows(lambda: self._telemetry.mode is FlightMode.HOLD):
            raise NotConfirmedError(f"reposition: still in {self._telemetry.mode.value} mode")
        await self._set_speed()

    async def hold(self) -> None:
        """See `Vehicle.hold`.

        A vehicle that flies to a point is in Hold mode already: asked for again it changes nothing
        (as a PX4 1.17 does). What stops it is a DO_REPOSITION to no place at all.
        """
        if self._telemetry.mode is FlightMode.HOLD:
            await self._stop_here()
        else:
            await self._mode(FlightMode.HOLD, self._action.hold_async)

    async def _stop_here(self) -> None:
        fields = {
            "target_system": self._connection.system_id,
            "target_component": AUTOPILOT,
            "frame": GLOBAL_INT,
            "command": DO_REPOSITION,
            "current": 0,
            "autocontinue": 0,
            "param1": -1.0,
            "param2": 1.0,  # change the mode
            "param3": 0.0,
            "param4": None,  # not a number: the heading stays
            "x": NOWHERE,
            "y": NOWHERE,
            "z": None,
        }
        command = message("COMMAND_INT", fields, self._connection.system_id)
        result, answer = await self._answer(self._direct.send_command_async, command)
        if result != MavlinkDirectResult.SUCCESS or json.loads(answer.fields_json)["result"] != 0:
            raise NotConfirmedError(f"hold: the vehicle does not take it{self._telemetry.said()}")

    async def land(self) -> None:
        """See `Vehicle.land`."""
        await self._mode(FlightMode.LAND, self._action.land_async)

    async def announce(self, text: str) -> None:
        """See `Vehicle.announce`: PX4 forwards a companion's STATUSTEXT to the ground station."""
        self._texts_sent = self._texts_sent % 0xFFFF + 1
        for chunk, start in enumerate(range(0, len(text), TEXT_LIMIT)):
            fields = {
                "severity": NOTICE,
                "text": text[start : start + TEXT_LIMIT],
                "id": self._texts_sent if len(text) > TEXT_LIMIT else 0,
                "chunk_seq": chunk,
            }
            try:
                self._direct.send_message(message("STATUSTEXT", fields))
            except MavlinkDirectError as error:
                _log.warning("the pilot was not told %r: %s", text, error.result.name)
                return

    async def close(self) -> None:
        """See `Vehicle.close`."""
        if self._watch is not None:
            self._watch.cancel()
        await self._connection.close()

    def _clear_rally_points(self) -> None:
        target = {"target_system": self._connection.system_id, "target_component": AUTOPILOT}
        self._direct.send_message(message("MISSION_CLEAR_ALL", target | {"mission_type": RALLY}))

    async def _mode(
        self, mode: FlightMode, command: Callable[..., None], *, attempts: int = ATTEMPTS
    ) -> None:
        before = self._telemetry.mode
        for _ in range(attempts):
            await self._answer(command)
            if await self._shows(lambda: self._telemetry.mode is mode):
                return
            if self._telemetry.mode is not before:
                break  # somebody else's choice is not commanded over
        raise NotConfirmedError(
            f"{mode.value} mode was asked for and the vehicle stays in "
            f"{self._telemetry.mode.value}{self._telemetry.said()}"
        )

    async def _set_speed(self) -> None:
        """A mode change sets PX4's speed back to its parameter; say the mission's again."""
        (result,) = await self._answer(
            self._action.set_current_speed_async, self._mission.speed_m_s
        )
        if result != ActionResult.SUCCESS:
            _log.warning("speed %.1f m/s: %s", self._mission.speed_m_s, result.name)

    async def _answer(self, method: Callable[..., None], *arguments: Any) -> tuple[Any, ...]:
        try:
            return await call(method, *arguments, timeout_s=ANSWER_S)
        except TimeoutError:
            name = method.__name__.removesuffix("_async")
            raise NotConfirmedError(f"{name}: no answer within {ANSWER_S:.0f} s") from None

    async def _shown(self, condition: Callable[[], bool], limit_s: float) -> None:
        async with asyncio.timeout(limit_s):
            await self._telemetry.wait_for(condition)

    async def _shows(self, condition: Callable[[], bool], limit_s: float = CONFIRM_S) -> bool:
        try:
            await self._shown(condition, limit_s)
        except TimeoutError:
            return False
        return True

    async def _wish(self, command: int, *params: float) -> None:
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

    async def _watch_silence(self) -> None:
        while True:
            await asyncio.sleep(SILENT_S / 3)
            silent_s = self._telemetry.silent_s()
            if silent_s > SILENT_S and self._callback is not None:
                self._callback(LinkSilent(self._telemetry.time_s, silent_s))
