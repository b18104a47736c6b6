import pytest

from air_router.actions import FlyToNode, FlyToPoint, HoldHere, LandHere
from air_router.custody import Custody
from air_router.vehicle import FlightMode, Telemetry
from geo.frame import Point

HERE = Point(0.0, 0.0)
MOTIONS = [
    (FlyToNode(1, HERE), FlightMode.MISSION),
    (FlyToPoint(HERE, 40.0), FlightMode.HOLD),
    (HoldHere("why"), FlightMode.HOLD),
    (LandHere(), FlightMode.LAND),
]


def flying(mode):
    return Telemetry(time_s=1.0, position=HERE, altitude_m=40.0, in_air=True, armed=True, mode=mode)


@pytest.mark.parametrize(("motion", "mode"), MOTIONS)
def test_a_confirmed_command_allows_only_its_own_mode(motion, mode):
    custody = Custody()
    custody.commanded(motion)
    assert not any(custody.taken(flying(other)) for other in FlightMode)
    custody.confirmed(motion)
    assert [m for m in FlightMode if not custody.taken(flying(m))] == [mode]


def test_a_late_confirmation_of_an_older_command_changes_nothing():
    first, second = FlyToNode(1, HERE), FlyToPoint(HERE, 40.0)
    custody = Custody()
    custody.commanded(first)
    custody.commanded(second)
    custody.confirmed(first)
    assert custody.pending is second
    assert not custody.failed(first)
    assert custody.pending is second


def test_after_a_failed_command_hovering_is_ours_and_flying_by_hand_is_not():
    motion = FlyToNode(1, HERE)
    custody = Custody()
    custody.commanded(motion)
    assert custody.failed(motion)
    assert not custody.taken(flying(FlightMode.HOLD))
    assert not custody.taken(flying(FlightMode.MISSION))
    assert custody.taken(flying(FlightMode.OTHER))
    assert custody.taken(flying(FlightMode.RETURN))
