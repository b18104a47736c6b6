"""Several UAVs: who only searches, and who seeks whom."""

import math
from pathlib import Path

import pytest

from air_router.controller.model.actions import FlyToNode, Seeking
from air_router.controller.model.events import RobotPose, RobotSought
from air_router.controller.model.requests import ComeHome, GoOn
from air_router.controller.model.states import State
from air_router.controller.targets.limits import SOUGHT_BY_OTHER_S
from air_router.controller.targets.target_list import TargetList
from air_router.gossip.gossip import SEEK_INTERVAL_S, Gossip
from air_router.gossip.mapper import Mapper
from air_router.gossip.team_messages import TeamMessageDecoder
from air_router.messages import MessageError, SeekMessage
from air_router.mission.loading import load_mission
from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point
from mocha_link import Team
from tests.air_router.conftest import CORNERS

MISSIONS = Path(__file__).parents[3] / "missions"


def seeking(flight):
    return [a.robot for a in flight.actions if isinstance(a, Seeking)]


def receive_from(flight, other, seen=0):
    """Give a flight what another one published since; returns how much that is now."""
    published = seeking(other)
    for robot in published[seen:]:
        flight.give(RobotSought(other.name, robot, flight.now_s))
    return len(published)


def test_a_vehicle_that_only_searches_searches_at_once_and_never_explores(pretend):
    flight = pretend(explore=False, duration_s=600.0)
    flight.robots = dict(CORNERS)
    flight.take_off()
    assert flight.controller.state is State.SEARCH
    flight.lands(1500.0)
    assert set(flight.states) == {State.SEARCH, State.COMM, State.HOME, State.LAND, State.DONE}
    found = {a.robot for a in flight.actions if getattr(a, "target", None) is State.COMM}
    assert found == set(CORNERS)
    assert flight.closest_m() >= flight.mission.planner.clearance_m


def test_one_that_only_searches_goes_to_the_next_robot_when_it_does_not_meet_one(airborne):
    flight = airborne(explore=False)
    first = flight.controller.context.task.robot
    flight.fly_until(lambda: flight.controller.context.task.robot != first)
    assert flight.controller.state is State.SEARCH
    assert State.EXPL not in flight.states
    assert seeking(flight) == ["callisto", "europa"]


def test_one_that_only_searches_hovers_when_no_robot_can_be_sought_and_tries_again(airborne):
    flight = airborne(explore=False, seek=())
    flight.fly_until(lambda: flight.now_s > 150.0)
    assert flight.controller.state is State.SEARCH
    assert not any(isinstance(motion, FlyToNode) for motion in flight.motions)


def test_resumed_it_searches_on(airborne):
    flight = airborne(explore=False)
    flight.pilot_chooses(FlightMode.OTHER)
    assert flight.controller.state is State.PASSIVE
    flight.pilot_chooses(FlightMode.HOLD)
    flight.give(GoOn())
    assert flight.controller.state is State.SEARCH


def test_it_publishes_whom_it_seeks_and_when_it_does_no_longer(pretend):
    flight = pretend()
    flight.robots = {"callisto": CORNERS["callisto"]}
    flight.take_off()
    flight.fly_to_state(State.SEARCH)
    assert seeking(flight) == ["callisto"]
    flight.fly_to_state(State.COMM)
    assert seeking(flight) == ["callisto"]
    flight.fly_to_state(State.EXPL)
    assert seeking(flight) == ["callisto", None]
    flight.fly_to_state(State.SEARCH)
    flight.operator_requests(ComeHome())
    assert seeking(flight) == ["callisto", None, "europa", None]


def test_a_robot_that_another_uav_seeks_comes_last_for_some_minutes():
    targets = TargetList(("callisto", "europa", "io"))
    targets.sought_by_other("atlas", "callisto", 0.0)
    assert targets.candidates(1.0) == ("europa", "io", "callisto")
    assert targets.candidates(SOUGHT_BY_OTHER_S + 1.0) == ("callisto", "europa", "io")
    targets.sought_by_other("atlas", "io", 10.0)
    assert targets.candidates(11.0) == ("callisto", "europa", "io")
    assert targets.free(11.0) == ("callisto", "europa")
    targets.sought_by_other("atlas", None, 20.0)
    assert targets.free(20.0) == targets.names


@pytest.mark.parametrize(("ours", "yields"), [("titan", True), ("alpha", False), ("", False)])
def test_of_two_that_seek_the_same_robot_the_lower_name_keeps_it(airborne, ours, yields):
    flight = airborne(explore=False, name=ours)
    assert flight.controller.context.task.robot == "callisto"
    flight.give(RobotSought("atlas", "callisto", 1.0))
    assert flight.controller.context.task.robot == ("europa" if yields else "callisto")
    assert flight.controller.state is State.SEARCH


def test_one_that_hovers_over_a_robot_already_keeps_it(airborne):
    flight = airborne(explore=False)
    flight.give(RobotPose("callisto", CORNERS["callisto"], 1.0, "callisto"))
    assert flight.controller.state is State.COMM
    flight.give(RobotSought("atlas", "callisto", 1.0))
    assert (flight.controller.state, flight.controller.context.task.robot) == (
        State.COMM,
        "callisto",
    )


def test_the_same_message_again_or_one_that_leaves_no_other_robot_changes_nothing(airborne):
    flight = airborne(explore=False, seek=("io",))
    for stamp_s in range(5):
        flight.give(RobotSought("atlas", "io", stamp_s))
    assert flight.states == [State.SEARCH]


def test_two_in_range_never_seek_the_same_robot_for_longer_than_a_message_takes(pretend):
    atlas, titan = (pretend(explore=False, name=name) for name in ("atlas", "titan"))
    for flight in (atlas, titan):
        flight.robots = dict(CORNERS)
        flight.take_off()
    received, together_s = [0, 0], 0
    met = {"atlas": set(), "titan": set()}
    for _ in range(2500):
        atlas.step()
        titan.step()
        received = [
            receive_from(titan, atlas, received[0]),
            receive_from(atlas, titan, received[1]),
        ]
        for name, flight in (("atlas", atlas), ("titan", titan)):
            if flight.controller.state is State.COMM:
                met[name].add(flight.controller.context.task.robot)
        both = {atlas.controller.state, titan.controller.state} == {State.SEARCH}
        together_s += (
            both and atlas.controller.context.task.robot == titan.controller.context.task.robot
        )
    assert together_s == 0
    assert met["atlas"] | met["titan"] == set(CORNERS)
    apart = (math.dist(a, b) for a, b in zip(atlas.track, titan.track, strict=False))
    assert min(apart) < 60.0, "they met, so the layers matter"


@pytest.mark.parametrize("robot", ["io", None])
def test_whom_another_uav_seeks_is_an_event_while_it_is_fresh(pennovation, robot):
    reader = TeamMessageDecoder(pennovation.frame)
    data = SeekMessage(stamp_s=1000.0, robot=robot).encode()
    read = {"peer": "io", "data": data}
    fresh = reader.event_of("atlas", "/seek", unix_s=1100.0, **read)
    assert fresh == RobotSought("atlas", robot, 1000.0)
    assert reader.event_of("atlas", "/seek", unix_s=1000.1 + SOUGHT_BY_OTHER_S, **read) is None


@pytest.mark.parametrize("data", [b"{}", b'{"stamp_s": 1}', b'{"stamp_s": 1, "robot": ""}', b"[]"])
def test_junk_about_whom_a_uav_seeks_is_refused(data):
    with pytest.raises(MessageError):
        SeekMessage.decode(data)


@pytest.fixture
def gossip_of(pennovation):
    made = []

    def make(mission):
        team = Team.load(MISSIONS / mission / "team.yaml")
        made.append(Gossip(pennovation.frame, team, "titan", VehicleClock(), Mapper(pennovation)))
        return made[-1]

    yield make
    for gossip in made:
        gossip.close()


def test_whom_we_seek_is_published_at_once_and_again_before_it_is_forgotten(gossip_of):
    gossip = gossip_of("pair")

    def sought():
        message = gossip.node.latest("titan", "/seek")
        return None if message is None else SeekMessage.decode(message.data).robot

    def published():
        return gossip.node.latest("titan", "/seek").header

    gossip.publish_telemetry(Telemetry(5.0, Point(0.0, 0.0), 0.0))
    assert sought() is None, "no robot was sought yet"
    gossip.publish_sought("io", 10.0)
    assert sought() == "io"
    first = published()
    gossip.publish_telemetry(Telemetry(9.0 + SEEK_INTERVAL_S, Point(0.0, 0.0), 0.0))
    assert published() == first
    gossip.publish_telemetry(Telemetry(10.0 + SEEK_INTERVAL_S, Point(0.0, 0.0), 0.0))
    assert (sought(), published() == first) == ("io", False)
    gossip.publish_sought(None, 50.0)
    assert sought() is None


def test_in_a_team_without_the_topic_nothing_is_published(gossip_of):
    gossip = gossip_of("pennovation")
    gossip.publish_sought("io", 10.0)
    assert gossip.node.latest("titan", "/map") is None


@pytest.fixture(scope="module")
def atlas():
    """A UAV that flies 48 m high, below another one at 60 m."""
    return load_mission(MISSIONS / "pair" / "mission.yaml", uav="atlas")


@pytest.mark.parametrize(("altitude_m", "leads"), [(48.0, True), (53.9, True), (54.1, False)])
def test_mission_mode_in_the_layer_of_another_uav_is_held(pretend, atlas, altitude_m, leads):
    flight = pretend(atlas, explore=False, name="atlas")
    flight.take_off_halfway(FlightMode.OTHER)
    flight.altitude_m = altitude_m
    flight.pilot_chooses(FlightMode.MISSION)
    assert (flight.controller.state is State.SEARCH) is leads
    assert any("another UAV's layer" in text for text in flight.announced) is not leads
    if not leads:
        assert flight.mode is FlightMode.HOLD
        flight.pilot_chooses(FlightMode.OTHER)
        flight.altitude_m = 48.0
        flight.pilot_chooses(FlightMode.HOLD)
        flight.give(GoOn())
        assert flight.controller.state is State.SEARCH


def test_a_flight_is_not_resumed_in_the_layer_of_another_uav(airborne, atlas):
    flight = airborne(atlas, explore=False, name="atlas")
    flight.pilot_chooses(FlightMode.OTHER)
    flight.altitude_m = 60.0
    flight.pilot_chooses(FlightMode.HOLD)
    flight.give(GoOn())
    assert flight.controller.state is State.PASSIVE
    assert any("descend to 48 m first" in text for text in flight.announced)
    flight.altitude_m = 50.0
    flight.step()
    flight.give(GoOn())
    assert flight.controller.state is State.SEARCH
