"""What a PX4 is told in order to stop, and in what pieces it is told something."""

import asyncio

import pytest

from air_router.clock import VehicleClock
from air_router.errors import PlanRefusedError
from air_router.px4 import TEXT_LIMIT, Px4Vehicle, chunks_of
from air_router.px4_motions import Px4Motions
from air_router.px4_order import choose, stop
from air_router.px4_telemetry import Px4Telemetry
from air_router.vehicle import FlightMode
from geo.frame import Point

PLACE = Point(40.0, 30.0)


class Told:
    """What tells a PX4 that is in Hold mode as soon as it is asked, and flies somewhere."""

    def __init__(self, telemetry, flies_to):
        self._telemetry = telemetry
        self._flies_to = flies_to
        self.told = []

    async def tell(self, order, shown, *, attempts):
        assert attempts > 1
        self._telemetry.mode = order.leads_to
        self._telemetry._target = self._flies_to
        self.told.append(order)


@pytest.mark.parametrize(
    ("late", "flies_to", "stopped"),
    [
        (None, PLACE, 0),  # nothing of ours is late: wherever it flies to is somebody else's
        (PLACE, Point(40.3, 30.0), 1),
        (PLACE, Point(10.0, 0.0), 0),  # where it brakes, or where a pilot sends it
    ],
)
def test_a_hold_that_shows_by_an_order_from_before_is_followed_by_a_stop(
    pennovation, late, flies_to, stopped
):
    async def script():
        telemetry = Px4Telemetry(pennovation.frame, VehicleClock())
        commands = Told(telemetry, flies_to)
        motions = Px4Motions(pennovation, telemetry, commands)
        telemetry.mode = FlightMode.MISSION
        motions._late = late
        await motions.hold()
        assert motions._late is None
        return commands.told

    assert asyncio.run(script()) == [choose(FlightMode.HOLD), stop()][: 1 + stopped]


def test_a_text_is_cut_by_bytes_and_not_within_a_letter():
    text = "hands off: breach of Kläranlage Süd and Gärtnerei, not resumed by itself ✈"
    chunks = chunks_of(text)
    assert "".join(chunks) == text
    assert max(len(chunk.encode()) for chunk in chunks) <= TEXT_LIMIT
    assert chunks_of("short") == ["short"]


def test_a_link_that_is_gone_while_the_plan_is_renewed_is_no_crash(pennovation):
    from mavsdk.plugins.mavlink_direct.mavlink_direct import (  # noqa: PLC0415
        MavlinkDirectError,
        MavlinkDirectResult,
    )

    class Gone:
        def send_message(self, sent):
            raise MavlinkDirectError(MavlinkDirectResult.CONNECTION_ERROR, "send_message()", sent)

    async def script():
        vehicle = Px4Vehicle(pennovation, "udpin://127.0.0.1:14540", VehicleClock())
        vehicle._direct = Gone()
        vehicle._clear_rally_points()

    with pytest.raises(PlanRefusedError, match="CONNECTION_ERROR"):
        asyncio.run(script())
