"""What a PX4 is told in order to stop, and in what pieces it is told something."""

import asyncio
from types import SimpleNamespace

import pytest

from air_router.errors import NotConfirmedError, PlanRefusedError
from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.px4.limits import ORDER_CONFIRM_S
from air_router.vehicle.px4.mavlink_values import STATUSTEXT_BYTES
from air_router.vehicle.px4.px4 import chunks_of
from air_router.vehicle.px4.px4_motions import Px4Motions
from air_router.vehicle.px4.px4_order import choose, stop
from air_router.vehicle.px4.px4_telemetry import PlanIds, Px4Telemetry
from air_router.vehicle.vehicle import FlightMode
from geo.frame import Point

PLACE = Point(40.0, 30.0)


class Told:
    """Follows what it is told at once."""

    def __init__(self, telemetry):
        self._telemetry = telemetry
        self.told = []

    async def look(self, words, out_of=None, objection=None):
        """It is in the mode that it was in."""

    async def send(self, wire, words, *, out_of, objection):
        self.told.append(wire)

    async def tell(self, order, shown, *, attempts):
        assert attempts > 1
        self._telemetry.mode = order.leads_to
        self.told.append(order)


@pytest.mark.parametrize(
    ("mode", "late", "order"),
    [
        (FlightMode.MISSION, None, choose(FlightMode.HOLD)),
        (FlightMode.MISSION, PLACE, stop()),  # it may be in Hold by that, and flying there
        (FlightMode.HOLD, None, stop()),
    ],
)
def test_a_vehicle_that_may_be_flying_to_a_point_is_stopped(pennovation, mode, late, order):
    async def script():
        telemetry = Px4Telemetry(pennovation.frame, VehicleClock())
        commands = Told(telemetry)
        motions = Px4Motions(pennovation, telemetry, commands)
        telemetry.mode = mode
        motions._late = late
        await motions.hold()
        assert motions._late is None
        return commands.told

    assert asyncio.run(script()) == [order]


@pytest.mark.parametrize(
    ("replaced", "chosen", "error"),
    [
        (True, FlightMode.HOLD, PlanRefusedError),
        (False, FlightMode.HOLD, NotConfirmedError),
        (True, FlightMode.POSITION, NotConfirmedError),  # the pilot's choice is what counts
    ],
)
def test_a_start_over_which_a_plan_is_put_on_board_is_refused(pennovation, replaced, chosen, error):
    async def script():
        telemetry = Px4Telemetry(pennovation.frame, VehicleClock())
        telemetry.mode, telemetry.armed, telemetry.in_air = FlightMode.HOLD, True, False
        telemetry.plan_ids = PlanIds(1, 1, 1)

        async def tell(order, shown, *, attempts):
            telemetry.plan_ids = PlanIds(2 if replaced else 1, 1, 1)
            telemetry.mode = chosen
            raise NotConfirmedError("Mission mode was asked for and does not show")

        commands = SimpleNamespace(tell=tell, look=Told(telemetry).look)
        with pytest.raises(error):
            await Px4Motions(pennovation, telemetry, commands).start()

    asyncio.run(script())


def test_a_jump_that_does_not_show_is_waited_for_in_flight_no_longer_than_outside(px4, pennovation):
    async def script():
        motions = Px4Motions(pennovation, px4.telemetry, Told(px4.telemetry))
        jump = asyncio.create_task(motions.jump(px4.item + 1))
        waited_s = 0.0
        while not jump.done():
            await asyncio.sleep(0.0)
            px4.run(0.1, rate=50.0)
            waited_s += 0.1
        with pytest.raises(NotConfirmedError, match="did not show"):
            await jump
        return waited_s

    assert asyncio.run(script()) == pytest.approx(ORDER_CONFIRM_S, abs=0.5)


def test_a_text_is_cut_by_bytes_and_not_within_a_letter():
    text = "hands off: breach of Kläranlage Süd and Gärtnerei, not resumed by itself ✈"
    chunks = chunks_of(text)
    assert "".join(chunks) == text
    assert max(len(chunk.encode()) for chunk in chunks) <= STATUSTEXT_BYTES
    assert chunks_of("short") == ["short"]
