import numpy as np
import pytest

from air_router.controller.model.actions import Finish, MissionWaits, RenewPlan, StateChanged
from air_router.controller.model.events import AirspaceChanged, PlanRenewed
from air_router.controller.model.states import Signal, State
from air_router.errors import ExitCode
from air_router.flight.flight_stats import FlightStats, ending_of
from air_router.gossip.mapper import Mapper
from air_router.report.flight_table import table
from air_router.vehicle.vehicle import Telemetry
from geo.airspace.zone import Circle, Zone
from geo.frame import Point
from geo.grid import GridPatch, Terrain
from mocha_link.links.metrics import Direction, SyncEnded, SyncStarted, SyncTimedOut


@pytest.fixture
def mapper(pennovation):
    return Mapper(pennovation)


@pytest.fixture
def stats(pennovation, mapper):
    return FlightStats.of(pennovation, mapper, ("io", "europa"))


def fly(stats, *places, start_s=10.0):
    for second, (east_m, north_m) in enumerate(places):
        now_s = start_s + second
        position = Point(east_m, north_m)
        stats.step(Telemetry(now_s, position, 40.0, armed=True, in_air=True), (), now_s)


def seen(mapper, rows, row=0):
    cells = np.full((rows, 10), Terrain.GRASS, dtype=np.uint8)
    west_m, south_m = mapper.grid.west_m, mapper.grid.south_m + row
    assert mapper.paint(GridPatch(west_m, south_m, 1.0, cells).encode())


def sync(stats, peer, direction, at_s, size=100):
    stats.step(SyncStarted(peer, at_s, direction), (), at_s)
    stats.step(SyncEnded(peer, at_s, direction, 1, size, 0.1), (), at_s + 0.1)


def test_distance_duration_and_closest_approach(stats, pennovation):
    fly(stats, (0.0, 0.0), (30.0, 0.0), (30.0, 40.0))
    report = stats.report("done", unix_s=0.0)
    assert report["distance_m"] == 70.0
    assert report["duration_s"] == 2.0
    track = [Point(0.0, 0.0), Point(30.0, 0.0), Point(30.0, 40.0)]
    closest_m, what = pennovation.airspace.track_distance_m(track)
    assert report["closest_approach_m"] == round(closest_m, 2)
    assert report["closest_approach_to"] == what


def test_what_the_pilot_flies_afterwards_is_the_pilot_s(stats):
    fly(stats, (0.0, 0.0), (5.0, 0.0))
    before = stats.report("pilot", 0.0)["closest_approach_m"]
    stats.step(None, (StateChanged(State.INIT, Signal.TAKEN_OVER, State.PASSIVE, None),), 0.0)
    fly(stats, (10.0, -40.0), start_s=20.0)  # into a zone
    report = stats.report("pilot", 0.0)
    assert report["closest_approach_m"] == before
    assert len(stats.flown.points) == 3


def test_what_is_flown_after_the_pilot_gave_it_back_counts_again(stats, pennovation):
    fly(stats, (0.0, 0.0), (5.0, 0.0))
    stats.step(None, (StateChanged(State.INIT, Signal.TAKEN_OVER, State.PASSIVE, None),), 0.0)
    fly(stats, (10.0, -40.0), start_s=20.0)  # into a zone, and across it
    stats.step(None, (StateChanged(State.PASSIVE, Signal.RESUMED, State.EXPL, None),), 0.0)
    fly(stats, (75.0, -150.0), start_s=30.0)
    ours = [[Point(0.0, 0.0), Point(5.0, 0.0)], [Point(75.0, -150.0)]]
    closest_m, _ = min(map(pennovation.airspace.track_distance_m, ours))
    assert stats.report("done", 0.0)["closest_approach_m"] == round(closest_m, 2)


def test_zones_that_the_controller_refused_are_not_judged_by(stats, pennovation):
    fly(stats, (0.0, 0.0), (5.0, 0.0))
    stats.step(AirspaceChanged(pennovation.fences, pennovation.zones), (RenewPlan(),), 12.0)
    drawn = Zone("refused", Circle(Point(5.0, 3.0), 4.0))
    stats.step(AirspaceChanged(pennovation.fences, (*pennovation.zones, drawn)), (), 12.5)
    stats.step(PlanRenewed(), (), 13.0)
    fly(stats, (5.0, 0.2), (5.0, 0.4), start_s=14.0)
    assert stats.report("done", 0.0)["closest_approach_to"] != "refused"
    accepted = AirspaceChanged(pennovation.fences, (*pennovation.zones, drawn))
    stats.step(accepted, (), 16.0)
    stats.step(None, (RenewPlan(),), 0.0)
    stats.step(PlanRenewed(), (), 17.0)
    fly(stats, (5.0, 0.2), (5.0, 0.4), start_s=18.0)
    assert stats.report("done", 0.0)["closest_approach_to"] == "refused"


def test_the_share_of_the_map_is_what_was_there_to_be_fetched(stats, mapper):
    seen(mapper, rows=4)
    mapper.publish(10.0)
    seen(mapper, rows=4, row=4)  # painted, but not yet published when the robot comes
    sync(stats, "io", Direction.OUT, 12.0)
    robots = stats.report("done", 0.0)["robots"]
    assert robots["io"]["map_share"] == 0.5
    assert robots["europa"]["map_share"] is None
    mapper.publish(13.0)
    sync(stats, "io", Direction.OUT, 14.0)
    assert stats.report("done", 0.0)["robots"]["io"]["map_share"] == 1.0


def test_syncs_are_counted_by_direction_and_unknown_robots_only_as_interactions(stats):
    sync(stats, "io", Direction.IN, 1.0, size=70)
    sync(stats, "io", Direction.OUT, 2.0, size=500)
    sync(stats, "basestation", Direction.IN, 3.0)
    cut = SyncEnded("io", 3.5, Direction.IN, messages=1, bytes=9, duration_s=0.1, complete=False)
    stats.step(SyncStarted("io", 3.4, Direction.IN), (), 3.4)
    stats.step(cut, (), 3.5)
    stats.step(SyncStarted("io", 4.0, Direction.IN), (), 4.0)
    stats.step(SyncTimedOut("io", 9.0, Direction.IN, "silent"), (), 9.0)
    report = stats.report("done", 0.0)
    io = report["robots"]["io"]
    assert (io["syncs_in"], io["syncs_out"], io["bytes_in"], io["bytes_out"]) == (2, 1, 79, 500)
    assert report["interactions"] == {"started": 5, "completed": 3, "partial": 1, "timed_out": 1}


def test_states_in_the_order_of_the_first_visit_and_robots_found(stats):
    fly(stats, (0.0, 0.0), (30.0, 0.0))
    for source, signal, target, robot in (
        (State.READY, Signal.AIRBORNE, State.INIT, None),
        (State.INIT, Signal.TIMER, State.SEARCH, None),
        (State.SEARCH, Signal.FOUND, State.COMM, "io"),
        (State.COMM, Signal.SYNCED, State.EXPL, "io"),
        (State.EXPL, Signal.TIMER, State.SEARCH, None),
        (State.SEARCH, Signal.FOUND, State.COMM, "io"),
    ):
        stats.step(None, (StateChanged(source, signal, target, robot),), 0.0)
    report = stats.report("done", 0.0)
    assert report["states_visited"] == ["INIT", "SEARCH", "COMM", "EXPL"]
    assert report["robots"]["io"]["found"] == 2
    assert stats.meetings == [("io", (30.0, 0.0))] * 2


def test_a_flight_that_comes_home_before_it_is_off_the_ground_is_not_done(stats):
    landed = Finish(landed_by_us=True, why="landed at home")
    stats.step(Telemetry(10.0, Point(0.0, 0.0), 1.0, armed=True, in_air=True), (), 10.0)
    assert not stats.flew
    assert ending_of(landed, "home was moved")[0] == "ended: home was moved"
    fly(stats, (0.0, 0.0))
    assert stats.flew
    assert ending_of(landed)[0] == "done"


def test_a_flight_that_was_stopped_as_it_took_off_is_refused():
    stopped = Finish(landed_by_us=False, why="the plan was replaced", refused=True)
    assert ending_of(stopped) == ("refused: the plan was replaced", ExitCode.REFUSED)


def test_the_table_has_what_exploring_robots_have_found_if_they_look_for_anything(stats):
    report = stats.report("done", unix_s=0.0)
    found = [{"goal": "v1", "robot": "io", "at_s": 5.0}]
    printed = table({**report, "world": {"goals": {"total": 15, "found": found}}})
    assert "vehicles found by robots that explore: 1 of 15\n" in printed
    assert "explore" not in table({**report, "world": {"goals": {"total": 0, "found": []}}})


def test_ages_and_the_table(stats):
    fly(stats, (0.0, 0.0), (30.0, 0.0))
    report = stats.report("done", unix_s=1042.0, stamps_s={"io": 1000.0})
    assert report["robots"]["io"]["newest_age_s"] == 42.0
    text = table(report)
    assert "42 s old" in text
    assert "closest approach" in text
    assert "europa" in text


def test_how_often_and_how_long_each_interlock_kept_the_mission_waiting(stats):
    for now_s, change in (
        (10.0, MissionWaits("LINK_SILENT", "nothing is received from the vehicle", 10.0)),
        (12.0, MissionWaits("INPUT_MISSING", "GPS has no fix", 12.0)),
        (15.0, MissionWaits(None)),
        (20.0, MissionWaits("INPUT_MISSING", "GPS has no fix", 20.0)),
        (21.5, MissionWaits(None)),
    ):
        stats.step(Telemetry(now_s, Point(0.0, 0.0), 40.0), [change], now_s)
    assert stats.report("done", 0.0)["waits"] == {
        "LINK_SILENT": {"times": 1, "total_s": 2.0},
        "INPUT_MISSING": {"times": 2, "total_s": 4.5},
    }


def test_a_wait_that_the_flight_ends_in_counts_to_its_end(stats):
    """As that for a link that is lost."""
    place = Point(0.0, 0.0)
    for now_s, changes in ((20.0, [MissionWaits("LINK_SILENT", "no message", 19.0)]), (30.0, [])):
        stats.step(Telemetry(now_s, place, 40.0), changes, now_s)
    for _ in range(2):  # a report changes nothing
        waits = stats.report("lost", 0.0)["waits"]
        assert waits == {"LINK_SILENT": {"times": 1, "total_s": 11.0}}
