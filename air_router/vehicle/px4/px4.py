"""A PX4 vehicle through MAVSDK: the one implementation of `air_router.vehicle.vehicle.Vehicle`.

Commands are believed when the vehicle's own messages show them (HEARTBEAT and CURRENT_MODE,
MISSION_CURRENT, POSITION_TARGET_GLOBAL_INT). What moves the vehicle leaves once (`px4_commands`).
"""

import asyncio
import logging
from collections.abc import Callable, Sequence
from typing import Final

from mavsdk.plugins.events.events import Events
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirect, MavlinkDirectError

from air_router.errors import ArmingRefusedError, NotConfirmedError
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.mission import Mission
from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.events.px4_health import arming_problems
from air_router.vehicle.inspection import Inspection
from air_router.vehicle.mavlink.mavsdk_bridge import message
from air_router.vehicle.mavlink.px4_connection import Px4Connection
from air_router.vehicle.px4.px4_commands import Px4Commands
from air_router.vehicle.px4.px4_inspection import inspect
from air_router.vehicle.px4.px4_motions import Px4Motions
from air_router.vehicle.px4.px4_plan import PlanTransfer
from air_router.vehicle.px4.px4_plan_guard import PlanGuard
from air_router.vehicle.px4.px4_requests import ONCE_S, Px4Requests
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

_log = logging.getLogger(__name__)

SILENT_S: Final = 3.0
HEALTH_S: Final = 60.0
NOTICE: Final = 5
TEXT_LIMIT: Final = 50


class Px4Vehicle(Px4Motions, Vehicle):
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
        telemetry = Px4Telemetry(mission.frame, clock)
        super().__init__(mission, telemetry, Px4Commands(telemetry, system_id))
        self._events: Callable[[], Events]  # makes the plugin; for reports on arming
        self._plans: PlanTransfer  # from `connect` on
        self._direct: MavlinkDirect  # from `connect` on
        self._plan_lock = asyncio.Lock()  # one transfer of the plan at a time, and none at take-off
        self._plan_guard = PlanGuard(self._compare, self._on_compared)
        self._telemetry.subscribe(self._on_event)
        self._texts_sent = 0  # id of a text in pieces
        self._watches: list[asyncio.Task[None]] = []  # none: it is not connected
        self._callback: Callable[[VehicleEvent], None] | None = None  # told of vehicle events

    @property
    def telemetry(self) -> Px4Telemetry:
        """What the vehicle said last."""
        return self._telemetry

    async def connect(self) -> VehicleInfo:
        """See `Vehicle.connect`; also asks for the positions often enough to fly by them."""
        plugins = await self._connection.open()
        self._direct, self._events = plugins.direct, plugins.events
        self._plans = PlanTransfer(plugins, self._telemetry, self._connection.system_id)
        self._telemetry.listen(self._direct, self._connection.system_id)
        self._commands.listen(self._direct)
        telemetry = self._telemetry
        requests = Px4Requests(self._direct, telemetry, self._connection.system_id)
        await requests.begin()
        await self._connection.heard(telemetry.complete, "positions")
        await telemetry.shows(telemetry.introduced, ONCE_S)
        work = (self._watch_silence(), requests.go_on())
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
            await self._plans.compare(plan)
            self._guard(plan)

    async def upload(self, plan: FlightPlan) -> None:
        """See `Vehicle.upload`."""
        async with self._plan_lock:
            await self._plans.upload(plan)
            self._guard(plan)

    async def renew(self, plan: FlightPlan) -> None:
        """See `Vehicle.renew`."""
        async with self._plan_lock:
            self._telemetry.leave_plan_alone()
            try:
                flying = self._telemetry.in_air and self._telemetry.mode is FlightMode.MISSION
                await self._plans.renew(plan, same_items=bool(flying))
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
            await super().arm()
        except NotConfirmedError as error:
            raise ArmingRefusedError(
                f"{error}{await arming_problems(self._events)}; see the arming checks in the "
                "ground station"
            ) from None

    async def start(self) -> None:
        """See `Vehicle.start`."""
        async with self._plan_lock:  # PX4 begins what is on board when the mode changes
            await super().start()

    async def announce(self, text: str) -> None:
        """See `Vehicle.announce`: PX4 forwards a companion's STATUSTEXT to the ground station."""
        if not self._watches:
            _log.warning("the pilot was not told %r: no vehicle is connected yet", text)
            return
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
        self.stop_telling()
        self._plan_guard.close()
        await self._connection.close()

    def _guard(self, plan: FlightPlan) -> None:
        """This plan is on board; another, or the same anew, is noticed from now on."""
        self._plan_guard.plan = plan
        self._telemetry.guard_plan()

    async def _compare(self, plan: FlightPlan) -> None:
        async with self._plan_lock:
            await self._plans.verify(plan)

    def _on_event(self, event: VehicleEvent) -> None:
        if isinstance(event, PlanReplaced):
            self._plan_guard.replaced()

    def _on_compared(self, difference: str | None) -> None:
        if self._callback is not None:
            # Not from here: an error in what it leads to would end the comparing, unseen.
            event = PlanCompared(self._telemetry.time_s, difference)
            asyncio.get_running_loop().call_soon(self._callback, event)

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
