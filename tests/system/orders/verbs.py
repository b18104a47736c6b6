"""The orders that tests send to a vehicle, and what its autopilot does then."""

import pytest

from air_router.errors import NotConfirmedError
from geo.frame import Point
from tests.system.scripted_px4 import (
    GROUND,
    HOLD,
    LAND,
    LAND_NOW,
    REPOSITION,
    SET_MODE,
)

LIMIT_S = 60
ITEM = 5
THERE, ELSEWHERE = Point(40.0, 30.0), Point(-60.0, 30.0)
ACCEPTED, TEMPORARILY_REJECTED, DENIED, IN_PROGRESS = 0, 1, 2, 5


def fails(verb, match=None):
    async def script(vehicle):
        with pytest.raises(NotConfirmedError, match=match):
            await verb(vehicle)

    return script


def hold(vehicle):
    return vehicle.hold()


def land(vehicle):
    return vehicle.land()


def start(vehicle):
    return vehicle.start()


def jump(vehicle):
    return vehicle.jump(ITEM)


def reposition(vehicle):
    return vehicle.reposition(THERE, 30.0)


WAITING = {"mode": HOLD, "landed": GROUND}
ORDERS = {
    hold: [("COMMAND_LONG", SET_MODE)],
    land: [("COMMAND_LONG", LAND_NOW)],
    start: [("COMMAND_LONG", SET_MODE)],
    reposition: [("COMMAND_INT", REPOSITION)],
}
JUMP = [("MISSION_SET_CURRENT", None), ("COMMAND_LONG", SET_MODE)]
STOP = [("COMMAND_INT", REPOSITION)]


def state_for(verb):
    return WAITING if verb is start else {}


def silent(px4, _order):
    px4.talks = False


def deaf(_px4, _order):
    pass


def set_item(px4, order):
    if order.get_type() == "MISSION_SET_CURRENT":
        px4.item = order.seq


def follows(px4, order):
    """It follows the command and acknowledges nothing."""
    set_item(px4, order)
    match getattr(order, "command", None):
        case 176:
            px4.mode = (int(order.param2) << 16) | (int(order.param3) << 24)
        case 21:
            px4.mode = LAND
        case 192 if order.x == 2**31 - 1:
            px4.target = px4.places(Point(0.5, 0.5))
        case 192:
            px4.mode, px4.target = HOLD, (order.x / 1e7, order.y / 1e7)
