"""The motions of a PX4: take-off, flight to an item or a point, stop, landing, all confirmed."""

import asyncio
import logging
import math
from typing import Final

from air_router.errors import ArmingRefusedError, NotConfirmedError, PlanRefusedError
from air_router.mission import Mission
from air_router.vehicle import (
    FlightMode,
    Modes,
    Objection,
    TakenOverError,
    Telemetry,
    VehicleEvent,
    no_objection,
)
from air_router.vehicle.px4.limits import (
    ORDER_ATTEMPTS,
    ORDER_CONFIRM_S,
    ORDER_DONE_S,
    SAME_TARGET_M,
    STOP_TARGET_M,
)
from air_router.vehicle.px4.px4_commands import (
    Decide,
    NotShownError,
    Px4Commands,
    SentOrder,
    Shown,
)
from air_router.vehicle.px4.px4_order import (
    Px4Order,
    arm,
    change_speed,
    choose,
    land,
    reposition,
    set_current,
    stop,
)
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry
from air_router.vehicle.px4.versions import REPOSITION_CHANGES_MODE, version_of
from geo.frame import Point

_log = logging.getLogger(__name__)


_BEGIN_AT_ONCE: Final = frozenset(
    {FlightMode.MISSION, FlightMode.TAKEOFF, FlightMode.RETURN, FlightMode.LAND}
)
"""Modes in which a vehicle may take off as soon as it is armed, left by an earlier flight."""


class Px4Motions:
    """The commands of `Vehicle` that move it; each returns once the vehicle follows.

    Args:
        mission: The mission with its local frame and speed.
        telemetry: The vehicle's messages.
        commands: Sends commands.
    """

    def __init__(self, mission: Mission, telemetry: Px4Telemetry, commands: Px4Commands) -> None:
        self._frame = mission.frame  # the frame of points
        self._speed_m_s = mission.speed_m_s  # cruise speed
        self._telemetry = telemetry
        self._commands = commands
        self._armed_in: FlightMode | None = None  # the pilot chose any other mode
        self._late: Point | None = None  # an unconfirmed destination that it may still fly to
        self._speed_known = False  # PX4 flies the plan at the mission's speed
        self._sending_speed: asyncio.Task[None] | None = None  # while it is unconfirmed
        telemetry.subscribe(self._note_speed)

    async def arm(self) -> None:
        """See `Vehicle.arm`.

        HEARTBEAT reports every second whether the vehicle is armed. A vehicle disarmed before that
        has acknowledged the command, but never reports armed.

        Raises:
            ArmingRefusedError: It was disarmed again at once.
            NotConfirmedError: It does not arm, or is silent.
        """
        telemetry = self._telemetry
        if telemetry.mode in _BEGIN_AT_ONCE:
            await self._choose(choose(FlightMode.HOLD), attempts=ORDER_ATTEMPTS)

        def shown(sent: SentOrder) -> bool:
            reported_s = telemetry.arrived_s("HEARTBEAT")
            done = reported_s > sent.acked_s + ORDER_DONE_S
            return (telemetry.armed and reported_s > sent.first_s) or done

        def decide() -> tuple[Px4Order, Shown]:
            self._armed_in = telemetry.mode
            return arm(telemetry.mode), shown

        await self._execute("arming", decide)
        self._check_armed()

    async def start(self) -> None:
        """See `Vehicle.start`.

        If nothing is received anymore, the vehicle may climb: its next messages will show it.

        Raises:
            PlanRefusedError: Another plan was uploaded meanwhile, so the command was not repeated.
            NotConfirmedError: It does not start.
        """
        telemetry = self._telemetry
        mode, plan = telemetry.mode, telemetry.plan.ids
        order = choose(FlightMode.MISSION)

        def decide() -> tuple[Px4Order, Shown]:
            self._check_armed()
            return order, self._mode_shown(order)

        try:
            await self._execute(order.words, decide, attempts=ORDER_ATTEMPTS, out_of={mode})
        except NotShownError as error:
            _log.warning("%s; it may be taking off", error)
        except NotConfirmedError:
            stays = telemetry.mode is mode and not telemetry.in_air
            if telemetry.plan.ids == plan or not stays:
                raise
            raise PlanRefusedError(
                "the plan or fence on board was replaced as it took off; it is on the ground: "
                "start the mission again"
            ) from None

    def _check_armed(self) -> None:
        telemetry = self._telemetry
        if not telemetry.armed:
            raise ArmingRefusedError(
                "it was armed, and disarmed again by the pilot, a ground station or the "
                "autopilot; it is not armed again"
            )
        if self._armed_in is not None and telemetry.mode not in {
            self._armed_in,
            FlightMode.MISSION,
        }:
            raise ArmingRefusedError(
                f"the pilot chose {telemetry.mode.value} mode once it was armed; "
                "it is left to the pilot"
            )

    async def jump(
        self, item: int, objection: Objection = no_objection, *, out_of: Modes = None
    ) -> None:
        """See `Vehicle.jump`: first the item, then the mode, so it never flies to an old item.

        Both are sent once: the leg was checked from the vehicle's position at that time.
        """
        telemetry = self._telemetry
        if 0 < telemetry.plan.item_total <= item:
            raise NotConfirmedError(f"the plan on board has no item {item}")
        words = f"the jump to item {item}"
        await self._commands.send(set_current(item), words, out_of=out_of, objection=objection)
        before = telemetry.mode
        # PX4 drops the jump without an answer while a ground station downloads the plan. In a fast
        # simulation the vehicle flies far in this wall time, so vehicle time also limits the wait.
        end_s = telemetry.clock.boot_s() + ORDER_CONFIRM_S
        await telemetry.shows(
            lambda: telemetry.item == item or telemetry.time_s > end_s, ORDER_CONFIRM_S
        )
        if telemetry.item != item:
            raise NotConfirmedError(f"{words} did not show in MISSION_CURRENT")
        now = telemetry.mode
        if now is not FlightMode.MISSION:
            # Only from our own Hold; the pilot chose any other mode.
            if now is not FlightMode.HOLD or before is not FlightMode.HOLD:
                if (taken := self._commands.taken({before})) is not None:
                    raise TakenOverError(f"the pilot chose {taken.value} mode", taken, sent=True)
                raise NotConfirmedError(f"an earlier command took effect instead of {words}")
            # Until the item is reported, it may have flown to its previous destination.
            mission = choose(FlightMode.MISSION)
            await self._choose(mission, out_of={FlightMode.HOLD}, objection=objection)
        self._late = None
        if not self._speed_known:
            self._send_speed()

    async def reposition(
        self,
        point: Point,
        altitude_m: float,
        objection: Objection = no_objection,
        *,
        out_of: Modes = None,
    ) -> None:
        """See `Vehicle.reposition`; sent once, like a jump.

        DO_REPOSITION uses altitudes above mean sea level. PX4 corrects home's altitude in flight,
        so the target is the current altitude plus the missing difference, both from one message. A
        home moved by a ground station changes neither: altitudes are relative to the take-off.
        """
        telemetry = self._telemetry
        latitude_deg, longitude_deg = self._frame.to_geodetic(point)

        def decide() -> tuple[Px4Order, Shown]:
            before = telemetry.target

            def shown(sent: SentOrder) -> bool:
                there = _near(telemetry.target, point)
                new = there and (not _near(before, point) or self._reported_after(sent))
                return telemetry.mode is FlightMode.HOLD and (sent.accepted or new)

            amsl_m = telemetry.place.altitude_amsl_m + altitude_m - telemetry.place.altitude_m
            place = latitude_deg, longitude_deg, amsl_m, self._speed_m_s
            self._late = point
            return reposition(*place, change_mode=not self._px4_decides()), shown

        await self._execute("a reposition", decide, out_of=out_of, objection=objection)
        self._late = None

    async def hold(self, *, out_of: Modes = None) -> None:
        """See `Vehicle.hold`.

        A vehicle that flies to a point is in Hold mode already, and requesting that mode again has
        no effect (PX4 1.17). A DO_REPOSITION without a place stops it. This is also sent if a
        flight to a point was commanded but not confirmed: it may still start.
        """

        def decide() -> tuple[Px4Order, Shown]:
            if self._telemetry.mode is FlightMode.HOLD or self._late is not None:
                return self._stop_here()
            order = choose(FlightMode.HOLD)
            return order, self._mode_shown(order)

        await self._execute("a hold", decide, attempts=ORDER_ATTEMPTS, out_of=out_of)
        self._late = None

    async def land(self, *, out_of: Modes = None) -> None:
        """See `Vehicle.land`."""
        await self._choose(land(), attempts=ORDER_ATTEMPTS, out_of=out_of)

    def stop_sending_speed(self) -> None:
        """Stop sending the speed."""
        if self._sending_speed is not None:
            self._sending_speed.cancel()

    async def _choose(
        self,
        order: Px4Order,
        *,
        attempts: int = 1,
        out_of: Modes = None,
        objection: Objection = no_objection,
    ) -> None:
        """Command a mode."""
        await self._execute(
            order.words,
            lambda: (order, self._mode_shown(order)),
            attempts=attempts,
            out_of=out_of,
            objection=objection,
        )

    def _mode_shown(self, order: Px4Order) -> Shown:
        """Whether a mode shows: PX4 1.16 and 1.17 acknowledge a mode that they then refuse."""
        telemetry = self._telemetry

        def shown(sent: SentOrder) -> bool:
            reported_s = telemetry.arrived_s("HEARTBEAT", "CURRENT_MODE")
            return telemetry.mode is order.leads_to and reported_s > sent.first_s

        return shown

    def _stop_here(self) -> tuple[Px4Order, Shown]:
        """Stops a vehicle that may be in Hold mode already: only its target confirms it."""
        telemetry, before = self._telemetry, self._telemetry.target

        def shown(sent: SentOrder) -> bool:
            if telemetry.mode is not FlightMode.HOLD:
                return False
            target, here = telemetry.target, telemetry.place.point
            if sent.accepted or target is None or here is None:
                return sent.accepted
            other = before is not None and not _near(target, before)
            return math.dist(target, here) <= STOP_TARGET_M and (
                other or self._reported_after(sent)
            )

        return stop(change_mode=not self._px4_decides()), shown

    def _px4_decides(self) -> bool:
        """Whether PX4 itself refuses a reposition after a pilot has chosen another mode.

        False while an earlier command of ours may still take the vehicle out of Hold: then the new
        command has to bring it back.
        """
        version = version_of(self._telemetry.identity.version or "")
        if version is None or REPOSITION_CHANGES_MODE.holds_in(version):
            return False
        holds = self._telemetry.mode is FlightMode.HOLD
        return holds and self._commands.late_modes() <= {FlightMode.HOLD}

    def _reported_after(self, sent: SentOrder) -> bool:
        """Whether the target was received after an acknowledgement that may be an older command's.

        An older command would already be visible in the target by then.
        """
        return self._telemetry.arrived_s("POSITION_TARGET_GLOBAL_INT") > sent.acked_s + ORDER_DONE_S

    async def _execute(
        self,
        words: str,
        decide: Decide,
        *,
        attempts: int = 1,
        out_of: Modes = None,
        objection: Objection = no_objection,
    ) -> None:
        """Send a command; see `Px4Commands.execute`."""
        order: Px4Order | None = None  # None: not sent

        def decided() -> tuple[Px4Order, Shown]:
            nonlocal order
            order, shown = decide()
            self.stop_sending_speed()  # the speed was for the previous motion
            return order, shown

        try:
            await self._commands.execute(
                words, decided, attempts=attempts, out_of=out_of, objection=objection
            )
        except NotConfirmedError:
            if order is not None and order.only_in_hold and await self._commands.check.received():
                taken = self._commands.taken({FlightMode.HOLD})
                if taken is not None:
                    text = f"{words} has no effect: the pilot chose {taken.value} mode"
                    raise TakenOverError(text, taken, sent=False) from None
            raise

    def _note_speed(self, event: VehicleEvent) -> None:
        """The plan sets the speed at take-off; any other mode resets it to PX4's parameter.

        Also a mode of the pilot's, who may then choose Mission mode again.
        """
        if not isinstance(event, Telemetry):
            return
        if not event.in_air:
            self._speed_known = True
        elif event.mode is not FlightMode.MISSION:
            self._speed_known = False
            self.stop_sending_speed()

    def _send_speed(self) -> None:
        """Send the mission's speed again.

        It is sent in parallel to the next command, which must not wait for it.
        """
        self.stop_sending_speed()
        self._sending_speed = asyncio.create_task(self._set_speed())

    async def _set_speed(self) -> None:
        order = change_speed(self._speed_m_s)
        try:
            await self._commands.execute(
                order.words,
                lambda: (order, lambda sent: sent.accepted),
                attempts=ORDER_ATTEMPTS,
                out_of={FlightMode.MISSION},
            )
        except NotConfirmedError as error:
            _log.warning("%s", error)
        else:
            self._speed_known = True


def _near(place: Point | None, other: Point) -> bool:
    return place is not None and math.dist(place, other) <= SAME_TARGET_M
