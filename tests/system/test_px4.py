"""The PX4 implementation of the vehicle port, through real MAVSDK, against the simulated PX4."""

import asyncio
import dataclasses
import math

import pytest

from air_router.errors import NotConfirmedError, NoVehicleError, PlanRefusedError
from air_router.mission.flight_plan import Command, FlightPlan, Frame
from air_router.mission.loading import load_mission
from air_router.sim.ports import free_port
from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.instructions import Severity
from air_router.vehicle.px4 import px4, px4_connection, px4_plan
from air_router.vehicle.px4.px4 import Px4Vehicle
from air_router.vehicle.vehicle import (
    FlightMode,
    ItemReached,
    PlanCompared,
    PlanReplaced,
    Telemetry,
)
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Circle, Outline, Zone
from geo.frame import Point
from tests.system.simulated import simulated_vehicle

pytestmark = pytest.mark.xdist_group("flights 1")

LIMIT_S = 240  # against hangs only


@pytest.fixture
def mission(short_mission):
    return load_mission(short_mission)


@pytest.fixture
def vehicle(vehicle):
    vehicle(speed=8)


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(px4_connection, "FIND_S", 1.5)
    monkeypatch.setattr(px4, "FIRST_POSITIONS_S", 0.5)


def run(mission, port, script, **options):
    """Run an async script with a vehicle; whatever happens the connection is closed."""

    async def main():
        vehicle = Px4Vehicle(mission, f"udpin://127.0.0.1:{port}", VehicleClock(), **options)
        try:
            async with asyncio.timeout(LIMIT_S):
                return await script(vehicle)
        finally:
            await vehicle.close()

    return asyncio.run(main())


class Log:
    """The events of a vehicle, and waiting for one."""

    def __init__(self, vehicle):
        self.events = []
        self._updated = asyncio.Event()
        vehicle.subscribe(self._on_event)

    def _on_event(self, event):
        self.events.append(event)
        self._updated.set()

    @property
    def telemetry(self):
        return next(e for e in reversed(self.events) if isinstance(e, Telemetry))

    async def until(self, condition):
        while not condition():
            self._updated.clear()
            await self._updated.wait()


@pytest.mark.usefixtures("vehicle")
def test_every_verb_is_confirmed_by_the_vehicle(mission, udp_port):
    plan = FlightPlan.of(mission)

    async def script(vehicle):
        info = await vehicle.connect()
        assert (info.system_id, info.autopilot, info.version) == (1, "PX4", "1.18.0")
        assert math.dist(info.home, mission.home) < 2.0
        log = Log(vehicle)
        await vehicle.upload(plan)
        await vehicle.arm()
        await vehicle.start()
        high = mission.altitude_above_home_m - 2.0
        await log.until(lambda: log.telemetry.in_air and log.telemetry.altitude_m > high)
        await vehicle.jump(plan.item_of(1))
        assert log.telemetry.mode is FlightMode.MISSION
        first = mission.waypoints[0].position
        await log.until(lambda: math.dist(log.telemetry.position, first) < 3.0)
        await log.until(
            lambda: any(
                isinstance(e, ItemReached) and e.item == plan.item_of(1) for e in log.events
            )
        )
        beside = Point(first.east_m + 8.0, first.north_m + 8.0)
        await vehicle.reposition(beside, 40.0)
        await log.until(lambda: math.dist(log.telemetry.position, beside) < 2.0)
        open_ends = [w for w in mission.waypoints if mission.airspace.leg_clear(beside, w.position)]
        far = max((w.position for w in open_ends), key=lambda end: math.dist(beside, end))
        await vehicle.reposition(far, 40.0)
        await log.until(lambda: math.hypot(*log.telemetry.velocity_m_s) > 2.0)
        await vehicle.hold()  # which the mode alone, being Hold already, does not do
        await log.until(lambda: math.hypot(*log.telemetry.velocity_m_s) < 0.2)
        assert math.dist(log.telemetry.position, far) > 5.0
        assert abs(log.telemetry.altitude_m - 40.0) < 5.0
        assert log.telemetry.mode is FlightMode.HOLD
        assert abs(log.telemetry.altitude_m - 40.0) < 3.0
        with pytest.raises(NotConfirmedError, match="a gust"):  # looked at before the mode as well
            await vehicle.jump(plan.item_of(0), lambda: "a gust")
        assert log.telemetry.mode is FlightMode.HOLD
        await vehicle.jump(plan.item_of(0), lambda: None)
        await log.until(lambda: math.dist(log.telemetry.position, mission.home) < 3.0)
        with pytest.raises(NotConfirmedError, match="no item 99"):
            await vehicle.jump(99)
        await vehicle.hold()
        await log.until(lambda: log.telemetry.mode is FlightMode.HOLD)
        await vehicle.land()
        await log.until(lambda: not log.telemetry.armed)
        fastest = max(math.hypot(*e.velocity_m_s) for e in log.events if isinstance(e, Telemetry))
        assert fastest < mission.speed_m_s + 0.5

    run(mission, udp_port, script)


@pytest.mark.usefixtures("vehicle")
def test_a_changed_fence_is_ours_in_flight_and_a_later_companion_gets_the_takeoff_time(
    mission, udp_port, monkeypatch
):
    plan = FlightPlan.of(mission)
    place = mission.waypoints[4].position
    over = Zone("over 5", Circle(place, 3.0))
    changed = mission.with_areas(mission.fences, (*mission.zones, over))
    assert changed.skipped == {5}
    apart = Zone("apart", Circle(Point(place[0] + 400.0, place[1]), 3.0))
    beside = mission.with_areas((), (*mission.zones, apart))

    async def script(vehicle):
        assert (await vehicle.connect()).took_off_s is None
        log = Log(vehicle)
        await vehicle.upload(plan)
        await vehicle.arm()
        await vehicle.start()
        await log.until(lambda: log.telemetry.in_air)
        took_off_s = log.telemetry.time_s
        high = mission.altitude_above_home_m - 2.0
        await log.until(lambda: log.telemetry.altitude_m > high)
        await vehicle.jump(plan.item_of(1))
        await vehicle.renew(FlightPlan.of(beside), lambda: None)
        assert log.telemetry.item == plan.item_of(1)  # the leg is flown on
        with pytest.raises(PlanRefusedError, match="hold first"):
            await vehicle.renew(FlightPlan.of(changed), lambda: None)
        await vehicle.hold()
        await vehicle.renew(FlightPlan.of(changed), lambda: None)
        await vehicle.recognise(FlightPlan.of(changed))
        await vehicle.jump(plan.item_of(2))
        await vehicle.hold()
        await vehicle.renew(plan, lambda: None)
        await vehicle.jump(plan.item_of(5))
        assert not any(isinstance(event, PlanReplaced) for event in log.events)
        assert log.telemetry.mode is FlightMode.MISSION
        await log.until(lambda: vehicle.telemetry.plan.guard.newest is not None)  # it is on guard
        await put_by_another(vehicle, FlightPlan.of(changed))
        await log.until(lambda: any(isinstance(event, PlanReplaced) for event in log.events))
        return took_off_s

    async def come_later(vehicle):
        receive = vehicle.telemetry._on_flight_information
        lost = []

        def late(fields):
            if lost:
                asyncio.get_running_loop().call_later(0.3, receive, fields)
            lost.append(fields)

        monkeypatch.setattr(vehicle.telemetry, "_on_flight_information", late)
        return (await vehicle.connect()).took_off_s

    took_off_s = run(mission, udp_port, script)
    assert run(mission, udp_port, come_later) == pytest.approx(took_off_s, abs=2.0)


def test_what_is_reported_before_a_vehicle_is_there_is_in_the_log(mission, udp_port, caplog):
    run(mission, udp_port, lambda vehicle: vehicle.announce("zones changed", Severity.INFO))
    assert "'zones changed' was not sent: no vehicle is connected yet" in caplog.text


def test_no_answer(mission, udp_port, monkeypatch):
    monkeypatch.setattr(px4_connection, "FIND_S", 0.3)
    with pytest.raises(NoVehicleError, match="nothing received within"):
        run(mission, udp_port, lambda vehicle: vehicle.connect())


@pytest.mark.parametrize(
    ("who", "message"),
    [
        (
            {"kind": 6, "autopilot": 8, "system_id": 255, "component_id": 190},
            "no autopilot's HEARTBEAT",
        ),
        ({"kind": 2, "autopilot": 3, "system_id": 1}, "is ARDUPILOT, not PX4"),
        ({"kind": 2, "autopilot": 12, "system_id": 7}, "system id 7, not 1.*--sysid 7"),
        ({"kind": 2, "autopilot": 12, "system_id": 1}, "sends no positions within"),
    ],
)
@pytest.mark.usefixtures("impatient")
def test_another_program_is_there(mission, heartbeats, udp_port, who, message):
    heartbeats(udp_port, **who)
    with pytest.raises(NoVehicleError, match=message):
        run(mission, udp_port, lambda vehicle: vehicle.connect())


@pytest.fixture(scope="module")
def standing(shared_mission):
    """A mission, and the port of a vehicle that stands at its home: for what moves nothing."""
    port = free_port()
    links = f"--api-to=127.0.0.1:{port}", "--no-gcs", f"--truth-to=127.0.0.1:{free_port()}"
    with simulated_vehicle(shared_mission, "--speed=8", *links):
        yield load_mission(shared_mission), port


def with_zones(mission, *zones):
    airspace = Airspace(mission.fences, zones, mission.planner.clearance_m)
    return dataclasses.replace(mission, zones=zones, airspace=airspace)


def test_a_stored_plan_that_cannot_be_flown_is_refused(standing, monkeypatch):
    mission, udp_port = standing
    monkeypatch.setattr(px4_plan, "PLAN_FEASIBLE_S", 1.0)  # twenty seconds of the vehicle
    east_m, north_m = mission.waypoints[4].position
    corners = [(-3, -3), (3, -3), (3, 3), (-3, 3)]
    hidden = Zone("new", tuple(Point(east_m + x, north_m + y) for x, y in corners))
    drawn = with_zones(mission, *mission.zones[1:], hidden)

    async def script(vehicle):
        await vehicle.connect()
        with pytest.raises(PlanRefusedError, match="be flown: plan item 8 lies in a no-fly"):
            await vehicle.upload(FlightPlan.of(drawn))

    run(mission, udp_port, script)


@pytest.mark.parametrize("version", ["1.15", "1.16", "1.18"])
def test_another_version_of_px4_takes_the_plan_and_refuses_one_that_cannot_be_flown(
    shared_mission, version
):
    """Before 1.17 its arming checks report whether a mission can be flown."""
    mission, port = load_mission(shared_mission), free_port()
    links = f"--api-to=127.0.0.1:{port}", "--no-gcs", f"--truth-to=127.0.0.1:{free_port()}"
    over = Zone("over", Circle(mission.waypoints[4].position, 3.0))
    drawn = with_zones(mission, *mission.zones[1:], over)

    async def script(vehicle):
        info = await vehicle.connect()
        assert info.version.startswith(f"{version}.")
        log = Log(vehicle)
        with pytest.raises(PlanRefusedError, match="be flown: plan item 8 lies in a no-fly"):
            await vehicle.upload(FlightPlan.of(drawn))
        await vehicle.upload(FlightPlan.of(mission))
        await vehicle.arm()
        await vehicle.start()
        await log.until(lambda: log.telemetry.in_air)
        await vehicle.hold()
        with pytest.raises(PlanRefusedError, match="be flown: plan item 8 lies in a no-fly"):
            await vehicle.renew(_fence_of(drawn, FlightPlan.of(mission)), lambda: None)
        await vehicle.land()

    with simulated_vehicle(shared_mission, "--speed=20", *links, f"--px4-version={version}"):
        run(mission, port, script)


def _fence_of(mission, plan):
    return dataclasses.replace(plan, fence=FlightPlan.of(mission).fence)


def test_the_error_of_a_fence_with_too_many_points_has_how_many_px4_takes(standing):
    mission, udp_port = standing
    east_m, north_m = mission.waypoints[4].position
    turns = [turn / 8 * math.pi for turn in range(16)]
    ring = [Point(east_m + 10 * math.cos(t), north_m + 10 * math.sin(t)) for t in turns]
    drawn = with_zones(mission, *mission.zones, Zone("round", tuple(ring)))

    async def script(vehicle):
        await vehicle.connect()
        with pytest.raises(PlanRefusedError, match=r"79 points, PX4 1\.17 stores 64"):
            await vehicle.upload(FlightPlan.of(drawn))

    run(mission, udp_port, script)


def test_circles_holes_and_several_fences_read_back_as_they_were_sent(standing):
    mission, udp_port = standing
    hole = tuple(Point(*corner) for corner in ((-90.0, 150.0), (-80.0, 150.0), (-80.0, 160.0)))
    area = Outline(
        tuple(Point(e, n) for e, n in ((-300, -300), (300, -300), (300, 300), (-300, 300))), (hole,)
    )
    fences = (Circle(mission.home, 400.25), area)
    masts = (Zone("mast", Circle(Point(250.0, 250.0), 7.125)), mission.zones[0])
    airspace = Airspace(fences, masts, mission.planner.clearance_m)
    drawn = dataclasses.replace(mission, fences=fences, zones=masts, airspace=airspace)
    plan = FlightPlan.of(drawn)
    circles = [Command.FENCE_CIRCLE_INCLUSION, Command.FENCE_CIRCLE_EXCLUSION]
    assert [item.command for item in plan.fence[-2:]] == circles
    assert {item.command for item in plan.fence} == {
        Command.FENCE_CIRCLE_INCLUSION,
        Command.FENCE_INCLUSION,
        Command.FENCE_EXCLUSION,
        Command.FENCE_CIRCLE_EXCLUSION,
    }

    async def script(vehicle):
        await vehicle.connect()
        await vehicle.upload(plan)  # reads back, compares, and waits until PX4 finds it feasible

    run(drawn, udp_port, script)


async def put_by_another(vehicle, plan):
    """Put a plan on board as if the answers had gone to another ground station."""
    known = vehicle.telemetry.plan.ids
    await vehicle._onboard.put(plan)
    vehicle.telemetry.plan.guard.begin(known)


def test_a_plan_that_a_ground_station_uploads_is_noticed(standing):
    mission, udp_port = standing
    plan = FlightPlan.of(mission)
    other = dataclasses.replace(plan, items=plan.items[:-1])

    async def script(vehicle):
        await vehicle.connect()
        log = Log(vehicle)
        await vehicle.upload(plan)
        await log.until(lambda: vehicle.telemetry.plan.guard.newest is not None)  # it is on guard
        await put_by_another(vehicle, other)
        await log.until(lambda: any(isinstance(e, PlanCompared) for e in log.events))
        (compared,) = [e for e in log.events if isinstance(e, PlanCompared)]
        assert (
            compared.difference
            == f"the mission: {len(plan.items)} items sent, {len(plan.items) - 1} are on board"
        )

    run(mission, udp_port, script)


def test_the_same_plan_that_a_station_rounded_and_uploads_again_is_ours(standing):
    mission, udp_port = standing
    plan = FlightPlan.of(mission)
    rounded = dataclasses.replace(
        plan,
        items=tuple(
            dataclasses.replace(i, x_deg_e7=i.x_deg_e7 + bool(i.x_deg_e7)) for i in plan.items
        ),
    )

    async def script(vehicle):
        await vehicle.connect()
        log = Log(vehicle)
        await vehicle.upload(plan)
        await log.until(lambda: vehicle.telemetry.plan.guard.newest is not None)  # it is on guard
        await put_by_another(vehicle, rounded)
        await log.until(lambda: any(isinstance(e, PlanCompared) for e in log.events))
        events = [e for e in log.events if isinstance(e, PlanReplaced | PlanCompared)]
        assert [type(e) for e in events] == [PlanReplaced, PlanCompared]
        assert events[-1].difference is None

    run(mission, udp_port, script)


def test_a_mission_without_a_fence_takes_the_one_before_off_board(standing):
    mission, udp_port = standing
    fenced = FlightPlan.of(mission)

    async def script(vehicle):
        await vehicle.connect()
        await vehicle.upload(fenced)
        await vehicle.upload(dataclasses.replace(fenced, fence=()))
        assert await vehicle._onboard.download(vehicle._onboard.fence) == []

    run(mission, udp_port, script)


def test_a_plan_is_recognised_without_changing_it(standing):
    mission, udp_port = standing
    plan = FlightPlan.of(mission)

    async def script(vehicle):
        await vehicle.connect()
        with pytest.raises(PlanRefusedError, match="on board"):
            await vehicle.recognise(plan)
        await vehicle.upload(plan)
        await vehicle.recognise(plan)

    run(mission, udp_port, script)


def stored(vehicle):
    return vehicle._onboard.download(vehicle._onboard.rally)


def test_the_autopilot_returns_to_this_mission_s_rally_points_only(standing):
    mission, udp_port = standing
    places = [mission.waypoints[0].position, mission.waypoints[1].position]
    with_rally = FlightPlan.of(dataclasses.replace(mission, rally_points=tuple(places)))
    without = FlightPlan.of(dataclasses.replace(mission, rally_points=()))

    async def script(vehicle):
        await vehicle.connect()
        await vehicle.upload(with_rally)
        found = await stored(vehicle)
        assert [item.command for item in found] == [Command.RALLY_POINT] * 2
        for item, place in zip(found, places, strict=True):
            there = mission.frame.to_local(item.x_deg_e7 / 1e7, item.y_deg_e7 / 1e7)
            assert math.dist(there, place) < 0.01
            assert item.z_m == 0.0
            assert with_rally.rally[0].frame is Frame.RELATIVE_ALT  # Return knows no INT frames
        with pytest.raises(PlanRefusedError, match=r"rally points: 0 items sent, 2 are on board"):
            await vehicle.recognise(without)
        await vehicle.upload(without)
        assert await stored(vehicle) == []

    run(mission, udp_port, script)
