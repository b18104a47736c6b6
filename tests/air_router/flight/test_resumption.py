"""A flight that another companion goes on with: how long it has flown, what it has explored."""

import dataclasses
import errno
import re
import signal
from functools import partial

import pytest

from air_router.controller.model.actions import FlyToNode
from air_router.controller.model.events import FlownBefore
from air_router.controller.model.states import State
from air_router.flight import flight as flight_module
from air_router.flight.resumption import flown_before
from air_router.mission.flight_plan import FlightPlan
from air_router.record import recorder
from air_router.record.log import Log
from air_router.record.replay import replay_record
from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry
from air_router.vehicle.vehicle import (
    FlightMode,
    GpsFix,
    Inspection,
    PlanCompared,
    PlanReplaced,
    Telemetry,
    VehicleInfo,
)
from geo.frame import Point
from tests.air_router.flight.test_flight import Rig, sends
from tests.air_router.flight.whole_flight import at_once

INFO = VehicleInfo(1, "PX4", "1.17.0", Point(0.0, 0.0), 6.7)
DURATION_S = 200.0
HOME_AMSL_M = 6.7


@pytest.fixture
def mission(pennovation):
    return dataclasses.replace(pennovation, duration_s=DURATION_S)


@pytest.fixture
def first(mission, pretend_vehicle, tmp_path):
    """A flight whose companion was interrupted once it had visited a waypoint."""
    rig = Rig(mission, pretend_vehicle, tmp_path)
    controller, airframe = rig.flight.controller, rig.vehicle.airframe
    telemetry = airframe.telemetry
    airframe.telemetry = lambda: dataclasses.replace(
        telemetry(), altitude_amsl_m=HOME_AMSL_M + airframe.altitude_m
    )
    rig.plan((lambda: controller.exploration.mark()[0] == 1, sends(signal.SIGINT)))
    rig.run()
    return rig


def telemetry(rig, later_s=0.0):
    airframe = rig.vehicle.airframe
    return dataclasses.replace(airframe.telemetry(), time_s=airframe.now_s + later_s)


def test_the_record_has_since_when_it_flies_and_what_is_explored(first, mission, tmp_path):
    known = partial(flown_before, mission, INFO, folder=tmp_path, unix=lambda: 0.0)
    flown, home_amsl_m, text = known(telemetry(first, later_s=10.0))
    assert flown == first.flight.controller.flown
    assert home_amsl_m == pytest.approx(HOME_AMSL_M)
    assert (flown.visited, flown.left_out) == (1, ())
    assert flown.airborne_s < first.vehicle.airframe.now_s - 5.0
    assert f"1 of {len(mission.waypoints)} waypoints explored (by its record" in text


@pytest.mark.parametrize(
    ("later_s", "changes"),
    [
        (-100.0, {}),  # the vehicle's clock began anew since
        (100.0, {}),
        (0.0, {"uav": "another"}),
        (0.0, {"home": Point(1.0, 0.0)}),
    ],
)
def test_the_record_of_another_flight_is_left_alone(first, mission, tmp_path, later_s, changes):
    mission = dataclasses.replace(mission, **changes)
    _, _, text = flown_before(
        mission, INFO, telemetry(first, later_s), folder=tmp_path, unix=lambda: 0.0
    )
    assert "by its record" not in text


@pytest.mark.parametrize(("later_s", "by_record"), [(-5.0, True), (20.0, False)])
def test_the_record_of_a_flight_before_this_one_is_left_alone(
    first, mission, tmp_path, later_s, by_record
):
    """The vehicle was not switched off between the two, and the companion of this one left none."""
    took_off_s = first.flight.controller.flown.airborne_s + later_s
    info = dataclasses.replace(INFO, took_off_s=took_off_s)
    flown, home_amsl_m, text = flown_before(
        mission, info, telemetry(first, later_s=30.0), folder=tmp_path, unix=lambda: 0.0
    )
    assert ("by its record" in text) is by_record
    assert (home_amsl_m is not None) is by_record
    assert by_record or flown.airborne_s == took_off_s


@pytest.mark.parametrize("node", [0, 1, 4, 37])
def test_without_a_record_the_vehicle_is_queried_since_when_and_no_waypoint_is_explored(
    mission, node
):
    """It may be on its way to any item to seek a robot, or home: that is no progress."""
    item = FlightPlan.of(mission).item_of(node)
    received = Telemetry(200.0, mission.home, 40.0, in_air=True, item=item)
    flown, _, text = flown_before(mission, dataclasses.replace(INFO, took_off_s=50.0), received)
    assert flown == FlownBefore(50.0)
    assert text.startswith(f"in the air for 150 s, 0 of {len(mission.waypoints)} waypoints")
    assert "without a record all waypoints are explored again" in text
    flown, _, text = flown_before(mission, INFO, received)
    assert flown == FlownBefore(0.0)
    assert "so counted from when it was switched on" in text


@pytest.fixture
def second(first, mission, pretend_vehicle, tmp_path, monkeypatch):
    """A companion that goes on with it."""
    monkeypatch.setattr(flight_module, "flown_before", partial(flown_before, unix=lambda: 0.0))
    monkeypatch.setattr(flight_module.asyncio, "to_thread", at_once)
    rig = Rig(mission, pretend_vehicle, tmp_path, arm=False, resume=True)
    rig.vehicle.airframe = first.vehicle.airframe
    return rig


def test_a_resumed_flight_keeps_its_duration_and_does_not_begin_at_waypoint_1(
    first, second, mission
):
    flown, airframe = first.flight.controller.flown, first.vehicle.airframe
    second.vehicle.inspection = Inspection(gps=GpsFix(3, 14, 0.8), battery=0.3)
    result = second.run()
    assert (result.outcome, result.report["came_home_because"]) == (
        "done",
        "mission duration (200 s) reached",
    )
    *entries, _ = Log(second.recorder.path)
    assert replay_record(entries).difference is None
    legs = [e.value for e in entries if e.kind == "action" and isinstance(e.value, FlyToNode)]
    assert legs[0].node == mission.waypoints[1].number
    home_s = next(e.t for e in entries if getattr(e.value, "text", "").startswith("coming home"))
    assert home_s == pytest.approx(flown.airborne_s + DURATION_S, abs=1.0)
    printed = second.out.getvalue()
    assert "in flight: " in printed
    assert re.search(r"battery +30%", printed)  # not good, and printed
    assert airframe.mode is FlightMode.LAND
    assert second.vehicle.home_amsl_m == pytest.approx(HOME_AMSL_M)


def test_what_can_be_recorded_no_more_is_resumed_by_its_record_all_the_same(
    first, mission, pretend_vehicle, tmp_path, monkeypatch
):
    """A disk that has failed, and is read-only now."""

    def read_only(*_):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(recorder, "open_record", read_only)
    printed = []
    made = recorder.Recorder(tmp_path, "mission.yaml", must=False, trouble=printed.append)
    assert printed == [f"{tmp_path}: Read-only file system; the flight is not recorded"]
    (tmp_path / "newest.mcap").symlink_to(tmp_path / "gone.mcap")
    assert (made.path, made.folder) == (None, tmp_path)
    _, _, text = flown_before(
        mission, INFO, telemetry(first), folder=made.folder, own=made.path, unix=lambda: 0.0
    )
    assert "by its record" in text


def test_a_plan_that_is_replaced_while_the_flight_is_looked_at_is_not_flown(second):
    inspect = second.vehicle.inspect

    async def replaced_meanwhile(parameters):
        for event in (PlanReplaced(1.0), PlanCompared(1.0, "the mission: 8 items")):
            second.vehicle.callback(event)
        return await inspect(parameters)

    second.vehicle.inspect = replaced_meanwhile
    controller = second.flight.controller
    second.plan((lambda: controller.state is State.PASSIVE, sends(signal.SIGINT)))
    second.run()
    assert "hands off: another plan is on board (the mission: 8 items)" in second.out.getvalue()
    assert not {"jump", "reposition", "land"} & {*second.vehicle.verbs}


def test_since_when_it_flies_is_counted_from_its_boot(pennovation):
    vehicle = Px4Telemetry(pennovation.frame, VehicleClock())
    for fields, expected in (
        ({"time_boot_ms": 90_000, "takeoff_time_utc": 20_000_000}, 20.0),
        ({"time_boot_ms": 90_000, "takeoff_time_utc": 0}, None),
        ({"time_boot_ms": 90_000, "takeoff_time_utc": 1_790_000_000_000_000}, None),
    ):
        vehicle._on_flight_information(fields)
        assert vehicle.took_off_s == expected
