"""What a PX4 is told in order to stop, and in what pieces it is told something."""

import asyncio

import pytest

from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.px4.px4 import TEXT_LIMIT, chunks_of
from air_router.vehicle.px4.px4_motions import Px4Motions
from air_router.vehicle.px4.px4_order import choose, stop
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry
from air_router.vehicle.vehicle import FlightMode
from geo.frame import Point

PLACE = Point(40.0, 30.0)


class Told:
    """Follows what it is told at once."""

    def __init__(self, telemetry):
        self._telemetry = telemetry
        self.told = []

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


def test_a_text_is_cut_by_bytes_and_not_within_a_letter():
    text = "hands off: breach of Kläranlage Süd and Gärtnerei, not resumed by itself ✈"
    chunks = chunks_of(text)
    assert "".join(chunks) == text
    assert max(len(chunk.encode()) for chunk in chunks) <= TEXT_LIMIT
    assert chunks_of("short") == ["short"]
