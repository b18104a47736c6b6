"""A PX4 vehicle through MAVSDK: the one implementation of `air_router.vehicle.vehicle.Vehicle`.

Commands are confirmed by the vehicle's own messages (HEARTBEAT and CURRENT_MODE, MISSION_CURRENT,
POSITION_TARGET_GLOBAL_INT). A command that moves the vehicle is sent once (`px4_commands`).
"""

import asyncio
import logging
from collections.abc import Callable, Sequence
from typing import Final

from air_router.errors import ArmingRefusedError, NotConfirmedError, NoVehicleError
from air_router.mission import FlightPlan, Mission
from air_router.vehicle import (
    FlightMode,
    Inspection,
    LinkSilent,
    MavlinkSpoofed,
    PlanCompared,
    PlanReplaced,
    Severity,
    Vehicle,
    VehicleClock,
    VehicleEvent,
    VehicleInfo,
)
from air_router.vehicle.px4 import px4_requests
from air_router.vehicle.px4.limits import (
    ARMING_HEALTH_S,
    FIRST_POSITIONS_S,
    FIRST_RESPONSE_S,
    LINK_SILENT_CHECKS,
    LINK_SILENT_S,
    SPOOFED_MESSAGES,
)
from air_router.vehicle.px4.mavlink_values import STATUSTEXT_BYTES
from air_router.vehicle.px4.px4_commands import Px4Commands
from air_router.vehicle.px4.px4_connection import Px4Connection
from air_router.vehicle.px4.px4_motions import Px4Motions
from air_router.vehicle.px4.px4_plan import OnboardPlan
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry

_log = logging.getLogger(__name__)


_MAV_SEVERITY: Final = {Severity.INFO: 6, Severity.WARNING: 4, Severity.ALARM: 2}
"""INFO, WARNING ("a possible future error if this is not resolved") and CRITICAL ("action must be
taken immediately") of common.xml. QGroundControl lists all of them, and reads NOTICE (5) and more
severe ones aloud (`severity <= MAV_SEVERITY_NOTICE` in its Vehicle.cc): INFO is only shown."""


class Px4Vehicle(Px4Motions, Vehicle):
    """Flies one PX4.

    Args:
        mission: The mission with its local frame and speed; commands use WGS-84 degrees.
        url: MAVSDK connection URL, such as `udpin://127.0.0.1:14540`.
        clock: The vehicle's clock.
        system_id: The vehicle's MAVLink system id, which this program also uses.
        connection: Opens the link; a rehearsal connects to a vehicle in the same process.
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
        self._url, self._connection = url, connection(url, system_id)
        telemetry = Px4Telemetry(mission.frame, clock)
        super().__init__(mission, telemetry, Px4Commands(telemetry))
        self._onboard: OnboardPlan  # from `connect` on
        self._texts_sent = 0  # id of a text in chunks
        self._watches: list[asyncio.Task[None]] = []  # empty: not connected
        self._catching_up: asyncio.Task[bool] | None = None  # requests the mode after a gap
        self._callback: Callable[[VehicleEvent], None] | None = None  # receives vehicle events
        self._spoofing_announced = False  # a sender that poses as the vehicle was announced

    @property
    def telemetry(self) -> Px4Telemetry:
        """The vehicle's last reports."""
        return self._telemetry

    async def connect(self) -> VehicleInfo:
        """See `Vehicle.connect`; also requests positions at the rate that a flight needs."""
        plugins = await self._connection.open()
        telemetry = self._telemetry
        self._onboard = OnboardPlan(
            plugins, telemetry, self._commands.check.received, self._on_compared
        )
        telemetry.subscribe(self._on_event)
        telemetry.listen(plugins.direct, self._connection.system_id)
        self._commands.listen()
        await px4_requests.begin(telemetry)
        if not await telemetry.shows(telemetry.complete, FIRST_POSITIONS_S):
            raise NoVehicleError(
                f"{self._url}: PX4 answers but sends no positions within "
                f"{FIRST_POSITIONS_S:.0f} s; is its GPS ready, and is the link set to "
                "MAVLink mode 'Onboard'?"
            )
        if not await telemetry.shows(telemetry.introduced, FIRST_RESPONSE_S) and telemetry.in_air:
            await px4_requests.request_flight_information(telemetry)
        if telemetry.identity.version is None:
            _log.warning(
                "%s: PX4 does not answer; if it has a signing key, give --signing-key FILE",
                self._url,
            )
        work = (self._watch_silence(), px4_requests.keep_streams(telemetry))
        self._watches = [asyncio.create_task(watch) for watch in work]
        return VehicleInfo(
            system_id=telemetry.system_id,
            autopilot="PX4",
            version=telemetry.identity.version or "of unknown version",
            home=telemetry.place.home,
            home_altitude_amsl_m=telemetry.place.home_altitude_amsl_m,
            took_off_s=telemetry.took_off_s,
            airframe=telemetry.identity.airframes.airframe,
        )

    def subscribe(self, callback: Callable[[VehicleEvent], None]) -> None:
        """See `Vehicle.subscribe`."""
        self._callback = callback
        self._telemetry.subscribe(callback)

    async def inspect(self, parameters: Sequence[str]) -> Inspection:
        """See `Vehicle.inspect`; a vehicle that was just switched on gets some seconds."""
        return await px4_requests.inspect(self._telemetry, parameters)

    async def recognise(self, plan: FlightPlan) -> None:
        """See `Vehicle.recognise`."""
        await self._onboard.recognise(plan)

    def count_heights_from(self, home_amsl_m: float) -> None:
        """See `Vehicle.count_heights_from`."""
        self._telemetry.count_heights_from(home_amsl_m)

    async def upload(self, plan: FlightPlan) -> None:
        """See `Vehicle.upload`."""
        await self._onboard.upload(plan)

    async def renew(self, plan: FlightPlan, objection: Callable[[], str | None]) -> None:
        """See `Vehicle.renew`."""
        await self._onboard.renew(plan, objection)

    async def arm(self) -> None:
        """See `Vehicle.arm`."""
        telemetry = self._telemetry
        before = telemetry.mode
        if not await telemetry.shows(lambda: telemetry.status.health_good, ARMING_HEALTH_S):
            raise ArmingRefusedError(
                f"not ready to arm after {ARMING_HEALTH_S:.0f} s{telemetry.reports.words}"
                f"{telemetry.texts()}; see the arming checks in the ground station"
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
                f"{error}{telemetry.reports.words}; see the arming checks in the ground station"
            ) from None

    async def start(self) -> None:
        """See `Vehicle.start`."""
        async with self._onboard.lock:  # PX4 starts the plan on board when the mode changes
            await super().start()

    async def announce(self, text: str, severity: Severity) -> None:
        """See `Vehicle.announce`: PX4 forwards a companion's STATUSTEXT to the ground station."""
        if not self._watches:
            _log.warning("announcement %r was not sent: no vehicle is connected yet", text)
            return
        self._texts_sent = self._texts_sent % 0xFFFF + 1
        chunks = chunks_of(text)
        number = self._texts_sent if len(chunks) > 1 else 0
        for chunk, part in enumerate(chunks):
            fields = {
                "severity": _MAV_SEVERITY[severity],
                "text": part,
                "id": number,
                "chunk_seq": chunk,
            }
            fault = self._telemetry.send("STATUSTEXT", fields, to_all=True)
            if fault is not None:
                _log.warning("announcement %r was not sent: %s", text, fault)
                return

    async def close(self) -> None:
        """See `Vehicle.close`."""
        for watch in self._watches:
            watch.cancel()
        if self._catching_up is not None:
            self._catching_up.cancel()
        if self._watches:
            self._onboard.close()
        self.stop_sending_speed()
        await self._connection.close()

    def _on_event(self, event: VehicleEvent) -> None:
        if isinstance(event, PlanReplaced):
            self._onboard.replaced()
        elif isinstance(event, LinkSilent) and (
            self._catching_up is None or self._catching_up.done()
        ):
            # The pilot's choice during the gap is known within milliseconds, before the next
            # HEARTBEAT. Until then the controller's `link_restored` starts nothing.
            check = self._commands.check
            self._catching_up = asyncio.get_running_loop().create_task(check.received())

    def _on_compared(self, difference: str | None) -> None:
        if self._callback is not None:
            # Not called directly: an error in a callback would end the comparison unnoticed.
            event = PlanCompared(self._telemetry.time_s, difference)
            asyncio.get_running_loop().call_soon(self._callback, event)

    def _announce_spoofing(self) -> None:
        count = self._connection.posing
        if (
            count >= SPOOFED_MESSAGES
            and not self._spoofing_announced
            and self._callback is not None
        ):
            self._spoofing_announced = True
            event = MavlinkSpoofed(self._telemetry.time_s, count)
            asyncio.get_running_loop().call_soon(self._callback, event)

    async def _watch_silence(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            began_s = loop.time()
            await asyncio.sleep(LINK_SILENT_S / LINK_SILENT_CHECKS)
            self._announce_spoofing()
            if loop.time() - began_s > LINK_SILENT_S:
                continue  # this program stalled, and messages wait in the socket
            silent_s = self._telemetry.silent_s()
            if silent_s > LINK_SILENT_S and self._callback is not None:
                # Not called directly: an error in a callback would end this task unnoticed.
                loop.call_soon(self._callback, LinkSilent(self._telemetry.time_s, silent_s))


def chunks_of(text: str) -> list[str]:
    """Split a text into chunks for STATUSTEXT: 50 bytes of UTF-8, no character split."""
    chunks = [""]
    for letter in text:
        if len((chunks[-1] + letter).encode()) > STATUSTEXT_BYTES:
            chunks.append("")
        chunks[-1] += letter
    return chunks
