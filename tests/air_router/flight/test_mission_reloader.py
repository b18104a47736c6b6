"""The mission file read again in flight."""

import asyncio
import dataclasses
import math
import shutil
import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest

from air_router.controller.controller import Controller
from air_router.controller.model.actions import ReadAgain, RenewPlan, ReplanAirspace
from air_router.controller.model.authority import PlanOwner
from air_router.controller.model.events import AirspaceChanged, PlanRenewed
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.requests import Reload
from air_router.errors import NotConfirmedError, PlanKeptError, PlanRefusedError
from air_router.flight import mission_reloader as rereading
from air_router.flight.mission_reloader import NotReloadedError, ReloadReport, changed_areas
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.loading import load_mission
from air_router.record.log import Log
from air_router.record.replay import replay_record
from air_router.routing.router import Router
from geo.airspace.zone import Band, Circle, Zone
from geo.frame import Point
from mocha_link.team.document import DocumentError
from tests.air_router.conftest import MISSIONS
from tests.air_router.flight.whole_flight import WholeFlight, at_once

PENNOVATION = Path(__file__).parents[3] / "missions" / "pennovation"
ZONE = """
  - name: crane
    circle: {centre: [39.94160, -75.19930], radius_m: 5}
"""


@pytest.fixture
def file(tmp_path):
    for name in ("mission.yaml", "team.yaml", "world.yaml"):
        shutil.copy(PENNOVATION / name, tmp_path)
    return tmp_path / "mission.yaml"


def edit(file, old, new):
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


def add_zone(file, zone=ZONE):
    edit(file, "\nno_fly_zones:\n", f"\nno_fly_zones:{zone}")


def over(mission, number):
    latitude, longitude = mission.frame.to_geodetic(mission.waypoints[number - 1].position)
    return f"\n  - name: over\n    circle: {{centre: [{latitude}, {longitude}], radius_m: 3}}\n"


def test_a_flight_whose_waypoints_were_drawn_over_is_found_again_and_gone_on_with(
    file, pretend_vehicle, tmp_path
):
    began = load_mission(file)
    add_zone(file, over(began, 7))
    mission = load_mission(file, in_flight=True)
    changed = changed_areas(began)
    on_board = FlightPlan.of(began.with_areas(changed.fences, changed.zones))
    assert (mission.skipped, FlightPlan.of(mission)) == ({7}, on_board)
    field = Field(file, pretend_vehicle, tmp_path / "log", resume=True)
    field.vehicle.airframe.take_off()
    assert field.reload(lambda: None).outcome == "done", field.out.getvalue()
    assert field.vehicle.plan == on_board
    assert "waypoint 7" not in field.out.getvalue()


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ("\nno_fly_zones:", "\nno_fly_zones: [", DocumentError, "mission.yaml:"),
        ("speed_m_s: 3.5", "speed_m_s: 4.5", NotReloadedError, "speed m changed as well"),
        ("altitude_m: 40", "altitude_m: 41", NotReloadedError, "altitude above home m and cruise"),
        ("init_s: 180", "init_s: 181", NotReloadedError, "timers changed as well"),
        ("init_s: 180", "init_s: 180 ", NotReloadedError, "are as they were"),
        ("init_s: 180", "init_s: x", DocumentError, "init_s"),
    ],
)
def test_what_changes_nothing(file, old, new, error, message):
    mission = load_mission(file)
    edit(file, old, new)
    with pytest.raises(error, match=message.replace(".", r"\.")):
        changed_areas(mission)


def test_a_file_that_is_gone_or_lays_a_zone_over_home_changes_nothing(file):
    mission = load_mission(file)
    latitude, longitude = mission.frame.to_geodetic(mission.home)
    corners = [
        [latitude + a, longitude + b] for a, b in ((1e-4, 1e-4), (1e-4, -1e-4), (-1e-4, 0.0))
    ]
    add_zone(file, f"\n  - name: over\n    polygon: {corners}\n")
    with pytest.raises(DocumentError, match="home lies inside no-fly zone 'over'"):
        changed_areas(mission)
    file.unlink()
    with pytest.raises(DocumentError):
        changed_areas(mission)


@pytest.mark.parametrize(
    ("waited_h", "begins_h", "applies", "hours"),
    [
        (5.0, -0.5, True, False),  # loaded in the morning, flown and drawn in the afternoon
        (5.0, 3.0, False, True),
        (0.5, -0.5, True, True),
        (0.5, 3.0, False, True),
    ],
)
def test_a_zone_that_is_drawn_to_apply_now_does_however_long_the_flight_waited_for_its_pilot(
    file, waited_h, begins_h, applies, hours
):
    mission = load_mission(file, start=datetime.now(UTC) - timedelta(hours=waited_h))
    begins = datetime.now(UTC) + timedelta(hours=begins_h)
    ends = begins + timedelta(hours=1.0)
    period = f"{{from: {begins:%FT%TZ}, until: {ends:%FT%TZ}}}"
    add_zone(file, f"{ZONE}    active: [{period}]\n")
    changed = changed_areas(mission)
    (crane,) = (zone for zone in changed.zones if zone.name == "crane")
    airspace = mission.with_areas(changed.fences, changed.zones).airspace
    assert (crane in airspace.zones, crane.validity is not None) == (applies, hours)
    with pytest.raises(NotReloadedError, match="are as they were"):
        changed_areas(mission.with_areas(changed.fences, changed.zones))


def test_a_fence_that_does_not_fit_on_board_is_not_taken(file):
    mission = load_mission(file)
    corners = [[39.9416, -75.1993], [39.9416, -75.1992], [39.9417, -75.1992]]
    add_zone(file, f"\n  - name: third\n    polygon: {corners}\n")
    with pytest.raises(NotReloadedError, match="would have 66 points, PX4"):
        changed_areas(mission)


def test_ways_among_zones_of_every_height_are_planned_beside_the_flight_and_go_on_board(
    file, pretend_vehicle, tmp_path, monkeypatch
):
    mission = load_mission(file, duration_s=90.0)
    high = Zone("high", Circle(Point(300.0, 300.0), 8.0), band=Band(48.0, 90.0))
    mission = mission.with_areas(mission.fences, (*mission.zones, high))
    flight = WholeFlight(mission, pretend_vehicle, tmp_path / "log")
    airframe, made, is_made = flight.vehicle.airframe, [], threading.Event()
    telemetry, make = airframe.telemetry, Router.__init__

    def reads():
        if "coming home: the altitude is in doubt" in flight.out.getvalue():
            is_made.wait()  # in a flight as fast as this one it would have landed before
        far = math.dist(airframe.position, mission.home) > 30.0
        amsl_m = 489.0 + airframe.altitude_m
        gps_m = amsl_m + (20.0 if far or made else 0.0)
        return dataclasses.replace(telemetry(), altitude_amsl_m=amsl_m, gps_amsl_m=gps_m)

    def makes(*arguments):
        made.append(threading.current_thread())
        make(*arguments)
        is_made.set()

    airframe.telemetry = reads
    monkeypatch.setattr(Router, "__init__", makes)
    flight.run()
    assert "the altitude is in doubt" in flight.out.getvalue()
    assert made
    assert threading.main_thread() not in made
    assert "zones changed: all apply at every altitude" in flight.out.getvalue()
    assert replay_record([*Log(flight.recorder.path)]).difference is None


LOW = """
  - name: low
    circle: {centre: [39.94160, -75.19930], radius_m: 5}
    altitude: {upper_m: 20}
"""


def test_with_the_altitude_in_doubt_the_file_is_compared_as_it_is_drawn(file):
    add_zone(file, LOW)
    mission = load_mission(file)
    in_doubt = mission.with_all_zones(50.0)
    assert in_doubt.zones != mission.zones
    with pytest.raises(NotReloadedError, match="are as they were"):
        changed_areas(in_doubt)
    add_zone(file)
    assert changed_areas(in_doubt).zones == load_mission(file).zones


def test_a_reload_during_an_upload_has_that_as_its_reason(file):
    controller = Controller(FlightSetup(load_mission(file)))
    reader = rereading.MissionReloader(
        controller, None, lambda event: controller.handle(event, 1.0), [].append
    )

    async def read(zone):
        add_zone(file, zone)
        await reader.work(ReadAgain())
        return reader.latest

    assert asyncio.run(read(LOW)).good  # uploaded at once: the vehicle is on the ground
    again = asyncio.run(read(ZONE))
    assert (again.good, again.why) == (False, "not reloaded: an upload is in progress")


@pytest.mark.parametrize("replans", [True, False])
def test_ways_that_another_change_came_before_are_not_flown(file, replans):
    """They were planned for what counted before that."""
    events, prepared, mission = [], [], load_mission(file)
    controller = SimpleNamespace(
        mission=mission, all_zones=True, replans=replans, prepare=prepared.append
    )
    reader = rereading.MissionReloader(controller, None, events.append, events.append)
    asyncio.run(reader.work(ReplanAirspace()))
    assert events == [AirspaceChanged(mission.fences, mission.zones)] * replans
    assert len(prepared) == replans


class Field(WholeFlight):
    """One whose mission file changes on the way."""

    def __init__(self, file, vehicle_class, folder, *, resume=False):
        mission = load_mission(file, duration_s=90.0, in_flight=resume)
        super().__init__(mission, vehicle_class, folder, arm=not resume, resume=resume)

    def reload(self, edits):
        """Fly; under way something is done to the file, and it is read again."""
        requested = []

        def on_step():
            home_m = abs(self.vehicle.airframe.position[0]) + abs(self.vehicle.airframe.position[1])
            if not requested and home_m > 30.0:
                requested.append(True)
                edits()
                self.flight.commands.submit(Reload())

        self.vehicle.on_step = on_step
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(rereading.asyncio, "to_thread", at_once)
            return self.run()


@pytest.fixture
def field(file, pretend_vehicle, tmp_path):
    return Field(file, pretend_vehicle, tmp_path / "log")


def test_reloaded_in_flight_the_new_fence_goes_on_board_and_the_mission_on(field, file):
    before = load_mission(file)
    result = field.reload(lambda: add_zone(file))
    assert result.outcome == "done", field.out.getvalue()
    assert field.vehicle.verbs.count("renew") == 1
    assert field.vehicle.plan == FlightPlan.of(load_mission(file))
    assert field.vehicle.plan.fence != FlightPlan.of(before).fence
    printed = field.out.getvalue()
    assert "the operator: accepted: the mission file is read again" in printed
    assert "zones changed: 'crane' is new" in printed
    assert "the changed fence is on board" in printed
    assert result.report["closest_approach_m"] >= 5.0


def test_an_error_in_the_file_is_reported_and_changes_nothing(field, file):
    result = field.reload(lambda: file.write_text("name: [", encoding="utf-8"))
    assert result.outcome == "done"
    assert "renew" not in field.vehicle.verbs
    assert "not reloaded: " in field.out.getvalue()


def test_a_fault_in_reading_it_is_reported_and_the_flight_goes_on(field, file, monkeypatch):
    def broken(mission, on_board, all_zones):
        raise ZeroDivisionError(str(mission.path))

    monkeypatch.setattr(rereading, "_read", broken)
    assert field.reload(lambda: None).outcome == "done"
    assert "not reloaded, by a fault of this program: ZeroDivisionError" in field.out.getvalue()


def test_what_is_saved_while_the_file_is_read_is_read_once_more(file):
    async def script():
        mission, events, gates = load_mission(file), [], [threading.Event(), threading.Event()]
        reads = iter(gates)
        printed, began = [], asyncio.Event()
        loop = asyncio.get_running_loop()

        def read(mission, on_board, all_zones):
            gate = next(reads)
            loop.call_soon_threadsafe(began.set)
            gate.wait()
            raise rereading.NotReloadedError("as they were")

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(rereading, "_read", read)
            controller = SimpleNamespace(mission=mission, all_zones=False)
            reader = rereading.MissionReloader(controller, None, events.append, printed.append)
            first = asyncio.ensure_future(reader.work(ReadAgain()))
            assert reader.latest == ReloadReport()
            await began.wait()
            await asyncio.gather(*(reader.work(ReadAgain()) for _ in range(3)))
            for gate in gates:
                gate.set()
            await first
            assert reader.latest == ReloadReport(under_way=False, why="not reloaded: as they were")
        return printed, events

    assert asyncio.run(script()) == (["not reloaded: as they were"] * 2, [])


@pytest.mark.parametrize(
    ("back", "message"),
    [
        (None, "; the one before is"),
        (NotConfirmedError("silent"), "; and the one before is not back"),
    ],
)
def test_a_fence_that_is_not_taken_brings_the_vehicle_home(field, file, back, message):
    field.vehicle.failures["renew"] = [PlanRefusedError("PX4 did not accept the fence: TIMEOUT")]
    field.vehicle.failures["renew"] += [back] if back else []
    before = FlightPlan.of(load_mission(file))
    result = field.reload(lambda: add_zone(file))
    assert result.report["came_home_because"] == "the changed fence is not on board"
    assert field.vehicle.plan == before
    assert f"TIMEOUT{message}" in field.out.getvalue()
    assert field.vehicle.verbs.count("renew") == 2


def test_after_a_refusal_before_anything_was_sent_the_plan_on_board_is_left_as_it_is(field, file):
    field.vehicle.failures["renew"] = [PlanKeptError("no current flight mode was received")]
    result = field.reload(lambda: add_zone(file))
    assert result.report["came_home_because"] == "the changed fence is not on board"
    assert field.vehicle.verbs.count("renew") == 1
    assert "is not on board: no current flight mode was received. " in field.out.getvalue()


def test_a_plan_that_was_left_half_uploaded_is_restored_after_any_later_refusal(field, file):
    vehicle, printed, requested = field.vehicle, field.out.getvalue, []
    before = FlightPlan.of(load_mission(file))
    vehicle.failures["renew"] = [
        PlanRefusedError("PX4 did not accept the fence: TIMEOUT"),
        PlanRefusedError("PX4 did not accept the fence: TIMEOUT"),
        PlanKeptError("no current flight mode was received"),
    ]

    def again():
        if not requested and "is not back" in printed():
            requested.append(field.flight.commands.submit(Reload()))

    def draw():
        add_zone(file)
        step = vehicle.on_step
        vehicle.on_step = lambda: (step(), again())

    field.reload(draw)
    assert "no current flight mode was received; the one before is" in printed()
    assert vehicle.plan == before


def test_what_did_not_get_on_board_is_put_there_when_it_is_reloaded_once_more(field, file):
    refused = PlanRefusedError("PX4 did not accept the fence: TIMEOUT")
    vehicle, printed, requested = field.vehicle, field.out.getvalue, []
    vehicle.failures["renew"] = [refused]

    def again():
        if not requested and "is not on board" in printed():
            requested.append(field.flight.commands.submit(Reload()))

    def draw():
        add_zone(file)
        step = vehicle.on_step
        vehicle.on_step = lambda: (step(), again())

    assert field.reload(draw).outcome == "done", printed()
    assert vehicle.verbs.count("renew") == 3
    assert vehicle.plan == FlightPlan.of(load_mission(file))
    assert "zones changed: to those that are not on board yet" in printed()
    assert "the changed fence is on board" in printed()


def test_of_two_uploads_only_the_result_of_the_newest_is_reported(pennovation):
    """The first was not waited for any more, and its list still goes over a poor link."""

    class SlowLink:
        def __init__(self):
            self.lock, self.over = asyncio.Lock(), asyncio.Event()
            self.objections = []

        async def renew(self, plan, objection):
            async with self.lock:
                await self.over.wait()
                if objection() is not None:
                    self.objections.append(objection())
                    raise PlanRefusedError(objection())

    async def script():
        events, link = [], SlowLink()
        controller = SimpleNamespace(mission=pennovation, why_no_upload=lambda: None)
        reader = rereading.MissionReloader(controller, link, events.append, events.append)
        reader.plan_on_board()
        uploads = [asyncio.ensure_future(reader.work(RenewPlan())) for _ in range(2)]
        await asyncio.sleep(0)
        link.over.set()
        await asyncio.gather(*uploads)
        return events, link.objections

    events, objections = asyncio.run(script())
    assert events == [PlanRenewed()]
    assert {*objections} == {"a newer one follows"}


@pytest.mark.parametrize("verb", ["connect", "upload"])
def test_what_is_reloaded_before_the_vehicle_is_ready_goes_on_board_after_the_plan(
    field, file, verb
):
    vehicle, answers, do = field.vehicle, [], getattr(field.vehicle, verb)

    async def do_meanwhile(*arguments):
        add_zone(file)
        answers.append(field.flight.commands.submit(Reload()))
        while "zones changed" not in field.out.getvalue():  # noqa: ASYNC110
            await asyncio.sleep(0)
        for _ in range(9):
            await asyncio.sleep(0)
        return await do(*arguments)

    setattr(vehicle, verb, do_meanwhile)
    assert field.run().outcome == "done", field.out.getvalue()
    assert [v for v in vehicle.verbs if v in {"connect", "upload", "renew", "arm"}] == [
        *("connect", "upload", "renew", "arm")
    ]
    assert vehicle.plan == FlightPlan.of(load_mission(file))
    (answer,) = answers
    assert answer.accepted
    assert verb == "upload" or answer.why.endswith("changes are uploaded after the plan")


@pytest.mark.parametrize("whose", list(PlanOwner))
def test_a_reload_is_good_only_while_this_missions_plan_is_on_board(whose):
    mission = load_mission(MISSIONS / "pennovation" / "mission.yaml")
    controller = Controller(FlightSetup(mission))
    controller.context.authority.on_board = whose
    reader = rereading.MissionReloader(controller, None, [].append, [].append)
    assert reader.report is None
    reader.latest = ReloadReport(under_way=False, good=True, why="the flight keeps to them")
    assert reader.report.good is (whose is PlanOwner.OURS)
    assert ("another plan is on board" in reader.report.why) is (whose is PlanOwner.ANOTHER)
    assert ("being compared" in reader.report.why) is (whose is PlanOwner.REPLACED)
