import pytest

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere, LandHere
from air_router.controller.motion.commanded_mode import Custody
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point

HERE = Point(0.0, 0.0)
MOTIONS = [
    (FlyToNode(1, HERE), FlightMode.MISSION),
    (FlyToPoint(HERE, 40.0), FlightMode.HOLD),
    (HoldHere("why"), FlightMode.HOLD),
    (LandHere(), FlightMode.LAND),
]


def flying(mode, **changes):
    values = {"time_s": 1.0, "position": HERE, "altitude_m": 40.0, "in_air": True, "armed": True}
    return Telemetry(**values | {"mode": mode} | changes)


def ours(custody):
    return {mode for mode in FlightMode if not custody.taken(flying(mode))}


@pytest.fixture
def custody():
    custody = Custody()
    custody.assume(FlightMode.MISSION)
    return custody


@pytest.mark.parametrize(("motion", "mode"), MOTIONS)
def test_a_command_under_way_allows_the_old_and_the_new_mode(custody, motion, mode):
    custody.commanded(motion)
    assert ours(custody) == {FlightMode.MISSION, mode}
    custody.confirmed(motion)
    assert ours(custody) == {mode}


def test_a_failed_command_leaves_both_open_and_a_pilot_s_mode_is_still_seen(custody):
    motion = FlyToNode(1, HERE)
    custody.commanded(motion)
    assert custody.failed(motion)
    assert ours(custody) == {FlightMode.MISSION}


def test_a_late_confirmation_of_an_older_command_changes_nothing(custody):
    first, second = FlyToNode(1, HERE), FlyToPoint(HERE, 40.0)
    custody.commanded(first)
    custody.commanded(second)
    custody.confirmed(first)
    assert custody.pending is second
    assert not custody.failed(first)
    assert custody.pending is second


def test_on_the_ground_the_autopilot_may_change_its_mode(custody):
    custody.commanded(LandHere())
    assert not custody.taken(flying(FlightMode.HOLD, in_air=False))


def test_a_failsafe_in_the_very_mode_that_we_asked_for_is_seen(custody):
    hold = HoldHere("why")
    custody.commanded(hold)
    custody.confirmed(hold)
    assert not custody.taken(flying(FlightMode.HOLD))
    assert custody.taken(flying(FlightMode.HOLD, failsafe=True))
