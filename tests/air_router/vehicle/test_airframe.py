"""Which vehicles are flown, by the type and the autopilot that a HEARTBEAT names."""

import itertools

import pytest
from pymavlink.dialects.v20 import common as mavlink

from air_router.vehicle.airframe import MULTICOPTERS, VTOLS, Airframe, AirframeWatch

FLOWN = ("QUADROTOR", "COAXIAL", "HEXAROTOR", "OCTOROTOR", "TRICOPTER", "DODECAROTOR", "DECAROTOR")
TYPES = {
    kind: enum.name.removeprefix("MAV_TYPE_") for kind, enum in mavlink.enums["MAV_TYPE"].items()
}


def test_of_all_types_of_mavlink_only_multicopters_are_flown():
    flown = {name for kind, name in TYPES.items() if Airframe(kind).why_not_flown is None}
    assert flown == set(FLOWN)
    assert {TYPES[kind] for kind in VTOLS} == {name for name in TYPES.values() if "VTOL" in name}


@pytest.mark.parametrize("kind", MULTICOPTERS)
def test_neither_a_vtol_nor_another_autopilot_is_flown_whatever_its_type(kind):
    assert "VTOL" in Airframe(kind, vtol=True).why_not_flown
    assert "ArduPilot, not PX4" in Airframe(kind, autopilot=3).why_not_flown
    assert "MAV_AUTOPILOT 9, not PX4" in Airframe(kind, autopilot=9).why_not_flown


def test_the_reason_names_the_type():
    assert Airframe(1).why_not_flown.startswith("the vehicle is a fixed wing (MAV_TYPE 1)")
    assert "VTOL (MAV_TYPE 22)" in Airframe(22).why_not_flown
    assert "vehicle of MAV_TYPE 46" in Airframe(46).why_not_flown


def why_not_flown(*kinds):
    """Why no mission is flown after each of these HEARTBEATs."""
    watch = AirframeWatch()
    for kind in kinds:
        watch.heartbeat({"type": kind, "autopilot": 12})
        yield watch.why_not


def test_one_heartbeat_of_another_type_is_not_believed():
    assert not any(why_not_flown(2, 2, 1, *[2] * 30, 1, *[2] * 30))


def test_two_vehicles_that_take_turns_are_the_wrong_one_all_the_time():
    reasons = list(why_not_flown(2, *itertools.islice(itertools.cycle((1, 2)), 40)))
    assert reasons[:3] == [None, None, None]
    assert all("fixed wing" in why for why in reasons[3:])


def test_the_right_one_has_to_be_received_alone_for_ten_seconds():
    reasons = list(why_not_flown(1, 1, *[2] * 12))
    assert reasons[1] == reasons[10] != reasons[11] is None
