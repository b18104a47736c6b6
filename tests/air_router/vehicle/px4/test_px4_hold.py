"""What a PX4 is sent in order to stop, and the chunks in which it is sent a text."""

import asyncio
from types import SimpleNamespace

import pytest

from air_router.errors import NotConfirmedError, PlanRefusedError
from air_router.vehicle.px4.limits import ORDER_CONFIRM_S
from air_router.vehicle.px4.mavlink_values import STATUSTEXT_BYTES
from air_router.vehicle.px4.px4 import chunks_of
from air_router.vehicle.px4.px4_motions import Px4Motions
from air_router.vehicle.px4.px4_order import choose, stop
from air_router.vehicle.vehicle import FlightMode
from geo.frame import Point
from tests.air_router.vehicle.px4.conftest import HOLD, MISSION, ON_GROUND

PLACE = Point(40.0, 30.0)
POSITION = 0x00030000


def flies(px4, mode):
    """It reports the mode, whatever it reported before."""
    modes = {FlightMode.HOLD: HOLD, FlightMode.MISSION: MISSION, FlightMode.POSITION: POSITION}
    px4.mode = px4.intended = modes[mode]
    px4.sends("HEARTBEAT")
    assert px4.telemetry.mode is mode


class FollowedCommands:
    """Commands that the vehicle follows at once."""

    def __init__(self, px4):
        self._px4 = px4
        self.sent = []

    async def send(self, wire, words, *, out_of, objection):
        self.sent.append(wire)

    async def execute(self, words, decide, *, attempts, out_of, objection):
        assert attempts > 1
        order, _shown = decide()
        flies(self._px4, order.leads_to)
        self.sent.append(order)


@pytest.mark.parametrize(
    ("mode", "late", "order"),
    [
        (FlightMode.MISSION, None, choose(FlightMode.HOLD)),
        (FlightMode.MISSION, PLACE, stop()),  # it may be in Hold by that, and flying there
        (FlightMode.HOLD, None, stop()),
    ],
)
def test_a_vehicle_that_may_be_flying_to_a_point_is_stopped(px4, pennovation, mode, late, order):
    async def script():
        commands = FollowedCommands(px4)
        motions = Px4Motions(pennovation, px4.telemetry, commands)
        flies(px4, mode)
        motions._late = late
        await motions.hold()
        assert motions._late is None
        return commands.sent

    assert asyncio.run(script()) == [order]


@pytest.mark.parametrize(
    ("replaced", "chosen", "error"),
    [
        (True, FlightMode.HOLD, PlanRefusedError),
        (False, FlightMode.HOLD, NotConfirmedError),
        (True, FlightMode.POSITION, NotConfirmedError),  # the pilot's choice is what counts
    ],
)
def test_a_start_over_which_a_plan_is_put_on_board_is_refused(
    px4, pennovation, replaced, chosen, error
):
    async def script():
        px4.landed, px4.height_m = ON_GROUND, 0.0
        px4.run(1.0)
        flies(px4, FlightMode.HOLD)
        px4.sends("MISSION_CURRENT", mission_id=1, fence_id=1, rally_points_id=1)

        async def execute(words, decide, *, attempts, out_of, objection):
            identifier = 2 if replaced else 1
            px4.sends("MISSION_CURRENT", mission_id=identifier, fence_id=1, rally_points_id=1)
            flies(px4, chosen)
            raise NotConfirmedError("Mission mode was requested and does not show")

        commands = SimpleNamespace(execute=execute)
        with pytest.raises(error):
            await Px4Motions(pennovation, px4.telemetry, commands).start()

    asyncio.run(script())


def test_a_jump_that_does_not_show_is_waited_for_in_flight_no_longer_than_outside(px4, pennovation):
    async def script():
        motions = Px4Motions(pennovation, px4.telemetry, FollowedCommands(px4))
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
