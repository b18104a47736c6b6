"""Params that mean nothing, which PX4 1.18 refuses: none of what we send has one."""

import math
from dataclasses import dataclass
from pathlib import Path

import pytest

from air_router.mission.flight_plan import FlightPlan
from air_router.mission.loading import load_mission
from air_router.vehicle.px4 import px4_order
from air_router.vehicle.vehicle import FlightMode
from sitl.px4sim.plan_store import FRAME_MISSION, FRAME_RELATIVE, Command
from sitl.px4sim.used_params import unused_param_of_command, unused_param_of_item

MISSION = Path(__file__).parents[3] / "missions" / "pennovation" / "mission.yaml"
_NOWHERE = 2**31 - 1
ORDERS = (
    px4_order.choose(FlightMode.MISSION),
    px4_order.choose(FlightMode.HOLD),
    px4_order.arm(FlightMode.MISSION),
    px4_order.land(),
    px4_order.change_speed(5.0),
    px4_order.reposition(47.4, 8.5, 500.0, 5.0),
    px4_order.stop(),
)


@dataclass(frozen=True, slots=True)
class Item:
    """Fields of MISSION_ITEM_INT; by default of a waypoint without parameters."""

    command: int = Command.NAV_WAYPOINT
    frame: int = FRAME_RELATIVE
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = math.nan
    x: int = 473977420
    y: int = 85455940
    z: float = 15.0


@pytest.mark.parametrize("order", ORDERS, ids=lambda order: order.words)
def test_no_command_of_ours(order):
    place = order.params[4:] if order.target is None else order.target
    assert unused_param_of_command(order.command, (*order.params[:4], *place)) is None


def test_no_item_of_ours():
    plan = FlightPlan.of(load_mission(MISSION))
    items = [*plan.items, *plan.fence, *plan.rally]
    assert len(items) > 20
    for item in items:
        params = {f"param{number}": value for number, value in enumerate(item.params, 1)}
        place = {"x": item.x_deg_e7, "y": item.y_deg_e7, "z": item.z_m}
        sent = Item(item.command, item.frame, **params, **place)
        assert unused_param_of_item(sent) is None, item


@pytest.mark.parametrize(
    ("item", "number"),
    [
        (Item(param3=5.0), 3),
        (Item(param3=math.nan), None),
        (Item(param1=2.0, param2=3.0, param4=90.0), None),
        (Item(Command.RALLY_POINT, param1=1.0), 1),
        (Item(Command.FENCE_POLYGON_EXCLUSION, param1=4.0), 7),
        (Item(Command.FENCE_POLYGON_EXCLUSION, param1=4.0, z=0.0), None),
        (Item(Command.NAV_RETURN_TO_LAUNCH, x=_NOWHERE, y=0, z=0.0), 6),
        (Item(Command.NAV_RETURN_TO_LAUNCH, x=_NOWHERE, y=-(2**31), z=math.nan), None),
        (Item(Command.NAV_RETURN_TO_LAUNCH, FRAME_MISSION, x=0, y=0, z=0.0), None),
        (Item(Command.NAV_RETURN_TO_LAUNCH, FRAME_MISSION, x=0, y=1, z=0.0), 6),
        (Item(9999, param3=5.0), None),
    ],
    ids=str,
)
def test_the_first_that_means_nothing(item, number):
    assert unused_param_of_item(item) == number
