import pytest

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.monitor.safety_monitor import FOREIGN_ORDER_S, EventKind, SafetyMonitor
from air_router.controller.motion.command_gate import CommandedMode
from air_router.mission.flight_plan import FlightPlan
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point

HERE, THERE = Point(0.0, 0.0), Point(10.0, 0.0)


@pytest.fixture
def plan(pennovation):
    return FlightPlan.of(pennovation)


@pytest.fixture
def watched(pennovation, plan):
    """Gives a motion, confirmed, and looks at what the vehicle shows afterwards."""
    monitor, commanded_mode = (
        SafetyMonitor(MissionContext(pennovation, None), plan),
        CommandedMode(),
    )

    def look(motion, seconds, **shown):
        if commanded_mode.last is not motion:
            commanded_mode.commanded(motion)
            commanded_mode.confirmed(motion)
        values = {"position": pennovation.home, "altitude_m": 40.0, "in_air": True, "armed": True}
        mode = FlightMode.MISSION if isinstance(motion, FlyToNode) else FlightMode.HOLD
        kinds = [
            monitor.look(
                Telemetry(time_s=s, **values | {"mode": mode} | shown), commanded_mode
            ).kind
            for s in seconds
        ]
        return kinds[-1]

    return look


def test_an_order_of_another_while_it_hovers_in_hold(watched):
    goto = FlyToPoint(HERE, 40.0)
    assert watched(goto, (1.0,), target=Point(1.0, 1.0)) is EventKind.GOOD
    assert watched(goto, (2.0, 2.0 + FOREIGN_ORDER_S - 0.1), target=THERE) is EventKind.GOOD
    assert watched(goto, (2.0 + FOREIGN_ORDER_S,), target=THERE) is EventKind.FOREIGN_ORDER


def test_an_old_target_that_still_shows_for_a_moment_is_no_order(watched):
    goto = FlyToPoint(HERE, 40.0)
    assert watched(goto, (1.0, 2.0), target=THERE) is EventKind.GOOD
    assert watched(goto, (2.5,), target=HERE) is EventKind.GOOD
    assert watched(goto, (3.0, 4.0), target=THERE) is EventKind.GOOD


def test_a_vehicle_that_does_not_tell_its_target_is_believed(watched):
    assert watched(FlyToPoint(HERE, 40.0), (1.0, 99.0), target=None) is EventKind.GOOD


def test_where_it_stopped_is_ours_and_another_place_is_not(watched):
    hold = HoldHere("why")
    assert watched(hold, (1.0, 3.0), target=HERE) is EventKind.GOOD
    # It has braked: this is the place.
    assert watched(hold, (4.0, 9.0), target=THERE, position=THERE) is EventKind.GOOD
    assert watched(hold, (10.0, 12.0), target=HERE, position=THERE) is EventKind.FOREIGN_ORDER


@pytest.mark.parametrize(
    ("position", "velocity_m_s"), [(Point(4.0, 0.0), (0.0, 0.0)), (Point(9.0, 0.0), (5.0, 0.0))]
)
def test_the_target_of_before_a_hold_that_is_told_late_is_not_where_it_stopped(
    watched, position, velocity_m_s
):
    """A stop ten metres before the point that it flew to, then its target is heard, at last."""
    hold = HoldHere("why")
    late = {"target": THERE, "position": position, "velocity_m_s": velocity_m_s}
    assert watched(hold, (1.0, 4.0, 5.0), **late) is EventKind.GOOD
    assert watched(hold, (6.0, 9.0, 20.0), target=HERE, position=HERE) is EventKind.GOOD
    assert watched(hold, (21.0, 23.0), target=THERE, position=HERE) is EventKind.FOREIGN_ORDER


def test_a_far_place_right_after_a_hold_is_not_where_it_stopped(watched, pennovation):
    hold, far = HoldHere("why"), Point(pennovation.home.east_m + 60.0, pennovation.home.north_m)
    assert watched(hold, (1.0, 3.9, 4.0, 5.4), target=far) is EventKind.GOOD
    assert watched(hold, (5.5,), target=far) is EventKind.FOREIGN_ORDER


def test_another_plan_item_in_mission_mode(watched, plan):
    jump = FlyToNode(3, HERE)
    assert watched(jump, (1.0, 9.0), item=plan.item_of(3)) is EventKind.GOOD
    assert watched(jump, (10.0, 12.0), item=None) is EventKind.GOOD
    assert watched(jump, (20.0, 22.0), item=plan.item_of(4)) is EventKind.FOREIGN_ORDER


def test_a_breach(watched, pennovation):
    hold = HoldHere("why")
    assert watched(hold, (1.0,)) is EventKind.GOOD
    zone = pennovation.airspace.zones[0]
    west, south, east, north = zone.polygon.bounds
    inside = Point((west + east) / 2, (south + north) / 2)
    assert watched(hold, (2.0,), position=inside, in_air=False) is EventKind.GOOD
    assert watched(hold, (3.0,), position=inside) is EventKind.BREACH
    assert watched(hold, (4.0,), position=Point(5000.0, 0.0)) is EventKind.BREACH
    assert watched(hold, (5.0,)) is EventKind.GOOD
