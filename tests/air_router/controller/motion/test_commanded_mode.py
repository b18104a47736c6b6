import pytest

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere, LandHere
from air_router.controller.motion.command_gate import CommandedMode
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


def ours(commanded_mode):
    return {mode for mode in FlightMode if not commanded_mode.taken(flying(mode))}


@pytest.fixture
def commanded_mode():
    commanded_mode = CommandedMode()
    commanded_mode.assume(FlightMode.MISSION)
    return commanded_mode


@pytest.mark.parametrize(("motion", "mode"), MOTIONS)
def test_a_command_under_way_allows_the_old_and_the_new_mode(commanded_mode, motion, mode):
    commanded_mode.commanded(motion)
    assert ours(commanded_mode) == {FlightMode.MISSION, mode}
    commanded_mode.confirmed(motion)
    assert ours(commanded_mode) == {mode}


def test_a_failed_command_leaves_both_open_and_a_pilot_s_mode_is_still_seen(commanded_mode):
    motion = FlyToNode(1, HERE)
    commanded_mode.commanded(motion)
    assert commanded_mode.failed(motion)
    assert ours(commanded_mode) == {FlightMode.MISSION}


def test_a_late_confirmation_of_an_older_command_changes_nothing(commanded_mode):
    first, second = FlyToNode(1, HERE), FlyToPoint(HERE, 40.0)
    commanded_mode.commanded(first)
    commanded_mode.commanded(second)
    commanded_mode.confirmed(first)
    assert commanded_mode.pending is second
    assert not commanded_mode.failed(first)
    assert commanded_mode.pending is second


def test_on_the_ground_the_autopilot_may_change_its_mode(commanded_mode):
    commanded_mode.commanded(LandHere())
    assert not commanded_mode.taken(flying(FlightMode.HOLD, in_air=False))


def test_a_failsafe_in_the_very_mode_that_we_asked_for_is_seen(commanded_mode):
    hold = HoldHere("why")
    commanded_mode.commanded(hold)
    commanded_mode.confirmed(hold)
    assert not commanded_mode.taken(flying(FlightMode.HOLD))
    assert commanded_mode.taken(flying(FlightMode.HOLD, failsafe=True))
