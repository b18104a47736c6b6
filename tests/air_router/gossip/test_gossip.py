import asyncio
import dataclasses
import io
import math
import socket
from pathlib import Path

import numpy as np
import pytest
from shapely import LineString
from shapely import Point as ShapelyPoint

from air_router.control.command_request import COSTLY_PER_S, Budget
from air_router.controller.model.actions import CommandAck, Refusal
from air_router.controller.model.events import PeerFault, RobotPath, RobotPose
from air_router.controller.model.requests import ComeHome, GoTo
from air_router.flight.flight import Flight
from air_router.flight.terminal import StatusLine
from air_router.gossip.gossip import Gossip
from air_router.gossip.mapper import Mapper
from air_router.gossip.team_messages import PATH_POINTS, PATH_READ, TeamMessageDecoder
from air_router.messages import (
    FARTHEST_M,
    AnswerMessage,
    GoalsMessage,
    MessageError,
    PathMessage,
    PoseMessage,
    SeekMessage,
)
from air_router.record.recorder import Recorder
from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Point
from geo.grid import MAX_CELLS, GridPatch, SemanticGrid, Terrain
from mocha_link import Message, Node, Team
from mocha_link.links.metrics import Direction, MessageStored, SyncEnded
from mocha_link.service.service_client import watch
from mocha_link.store.wire import Header
from mocha_link.team.team import Priority
from sitl.team.derived_team import derive_team

TEAM = Path(__file__).parents[3] / "missions" / "pennovation" / "team.yaml"


@pytest.fixture
def gossip(pennovation):
    made = Gossip(pennovation.frame, Team.load(TEAM), "titan", VehicleClock(), Mapper(pennovation))
    yield made
    made.close()


@pytest.fixture
def events(gossip, monkeypatch):
    """What the flight is given of events of its node; `latest` is what that holds."""
    node, listeners = gossip.node, []
    monkeypatch.setattr(node, "start", lambda: None)
    monkeypatch.setattr(node, "subscribe", listeners.append)

    def given(*happened, latest=lambda *_: None):
        monkeypatch.setattr(node, "latest", latest)
        found = []

        async def script():
            gossip.start(found.append)
            for event in happened:
                listeners[-1](event)
            await asyncio.sleep(0)

        asyncio.run(script())
        return found

    return given


@pytest.fixture
def event_of(events):
    """What the flight is given of a message that a peer has brought; None: nothing."""

    def found(message, peer):
        stored = MessageStored(peer, 10.0, message.robot, message.topic, message.header, 1)
        more = [event for event in events(stored, latest=lambda *_: message) if event is not stored]
        return more[0] if more else None

    return found


def received(topic, data):
    return Message("io", topic, Header(2, 0, 10, 0), Priority.HIGH, data, 10.0, 10.0)


def pose(frame, place):
    latitude_deg, longitude_deg = frame.to_geodetic(place)
    return PoseMessage(stamp_s=9.0, latitude_deg=latitude_deg, longitude_deg=longitude_deg)


def path(frame, way):
    return PathMessage(stamp_s=9.0, points=tuple(map(frame.to_geodetic, way))).encode()


def test_a_pose_and_a_path_are_events(event_of, pennovation):
    place = Point(30.0, -20.0)
    message = pose(pennovation.frame, place)
    event = event_of(received("/pose", message.encode()), "europa")
    assert isinstance(event, RobotPose)
    assert (event.robot, event.peer, event.stamp_s) == ("io", "europa", 9.0)
    assert event.position == pytest.approx(place, abs=1e-3)
    way = (Point(0.0, 0.0), place)
    event = event_of(received("/path", path(pennovation.frame, way)), "io")
    assert isinstance(event, RobotPath)
    assert (event.robot, event.stamp_s) == ("io", 9.0)
    assert [*map(tuple, event.points)] == [pytest.approx(p, abs=1e-3) for p in way]


def test_a_path_of_many_points_is_an_event_with_less_detail(event_of, pennovation):
    way = [Point(i / 10, 40 * math.sin(i / 1000)) for i in range(8000)]
    event = event_of(received("/path", path(pennovation.frame, way)), "io")
    assert len(event.points) <= PATH_POINTS
    assert event.points[0] == pytest.approx(way[0], abs=1e-3)
    assert event.points[-1] == pytest.approx(way[-1], abs=1e-3)
    line = LineString(event.points)
    assert max(line.distance(ShapelyPoint(p)) for p in way[::50]) <= 2.1


def test_a_path_that_no_robot_drives_takes_no_longer_to_read(event_of, pennovation, monkeypatch):
    """Of ten thousand points to and fro none can be left out: that took five seconds."""
    looked_at = []

    def line(way):
        looked_at.append(len(way))
        return LineString(way)

    monkeypatch.setattr("air_router.gossip.team_messages.LineString", line)
    way = [Point(i / 2, 4000.0 * (i % 2)) for i in range(10_000)]
    event = event_of(received("/path", path(pennovation.frame, way)), "io")
    assert max(looked_at) <= PATH_READ + 1
    assert len(event.points) <= PATH_POINTS
    assert event.points[-1] == pytest.approx(way[-1], abs=1e-3)


def test_goals_are_looked_at_no_faster_than_other_requests(gossip, pennovation, monkeypatch):
    """Of those that have to wait the newest counts; the sender of the others is answered."""
    place = pennovation.frame.to_geodetic(Point(30.0, -20.0))
    given, answers, now_s = [], [], [0.0]
    monkeypatch.setattr(gossip, "publish_ack", answers.append)
    gossip._reader = TeamMessageDecoder(pennovation.frame, name="titan", goals_from=("io",))
    gossip._deliver = lambda event: given.append(getattr(event, "request_id", None))
    gossip._budget = Budget(COSTLY_PER_S, 2.0, lambda: now_s[0])
    for number in range(50):
        goals = GoalsMessage(stamp_s=1.0, id=str(number), points=(place,)).encode()
        monkeypatch.setattr(
            gossip.node, "latest", lambda _, topic, data=goals: received(topic, data)
        )
        stored = MessageStored("europa", 10.0, "io", "/goals", Header(2, 0, 10, 0), len(goals))
        gossip._translate(stored)
    assert [number for number in given if number is not None] == ["0", "1"]
    now_s[0] = 1.0
    gossip.publish_telemetry(Telemetry(50.0, Point(0.0, 0.0), 40.0))
    gossip.publish_telemetry(Telemetry(51.0, Point(0.0, 0.0), 40.0))
    assert [number for number in given if number is not None] == ["0", "1", "49"]
    replaced = [str(number) for number in range(2, 49)]
    assert [answer.request_id for answer in answers] == replaced
    assert {(answer.by, answer.accepted, answer.code) for answer in answers} == {
        ("io", False, Refusal.REPLACED)
    }


def test_only_what_the_mission_may_use_is_decompressed(events, pennovation):
    read = []
    message = received("/pose", pose(pennovation.frame, Point(30.0, -20.0)).encode())
    given = events(
        *(
            MessageStored("europa", 10.0, "io", topic, Header(2, 0, 10, 0), 1)
            for topic in ("/map", "/goals", "/answers", "/pose")
        ),
        latest=lambda _, topic: read.append(topic) or message,
    )
    assert read == ["/pose"]
    assert len(given) == 5


def test_nothing_is_published_later_than_it_is_received(pennovation):
    reader, later = TeamMessageDecoder(pennovation.frame), 9.9e10
    latitude_deg, longitude_deg = pennovation.frame.to_geodetic(Point(30.0, -20.0))
    there = {"latitude_deg": latitude_deg, "longitude_deg": longitude_deg}
    for topic, message in (
        ("/pose", PoseMessage(stamp_s=later, **there)),
        ("/path", PathMessage(stamp_s=later, points=((latitude_deg, longitude_deg),))),
        ("/seek", SeekMessage(stamp_s=later, robot="io")),
    ):
        event = reader.event_of("io", topic, message.encode(), peer="io", unix_s=1000.0)
        assert event.stamp_s == 1000.0


@pytest.mark.parametrize(
    "data",
    [b"", b"{}", b"\xff\x00", b'{"stamp_s": 1, "latitude_deg": 95, "longitude_deg": 0}'],
)
def test_junk_is_a_fault_of_the_robot(event_of, data):
    assert isinstance(event_of(received("/pose", data), "io"), PeerFault)
    assert isinstance(event_of(received("/path", data), "io"), PeerFault)


def test_what_cannot_be_read_is_reported_once_for_each_topic(event_of):
    reported = []
    for _ in range(3):
        reported.append(event_of(received("/pose", b"{}"), "io"))
        reported.append(event_of(received("/path", b"{}"), "europa"))
    assert reported[2:] == [None] * 4
    assert [fault.words.partition(" cannot")[0] for fault in reported[:2]] == [
        "/pose of io",
        "/path of io",
    ]


def test_a_robot_that_is_met_and_publishes_nothing_is_reported_once(events):
    """Not one that does, and not one that is met but a few times."""
    delivered = events(
        *(
            SyncEnded(peer, 1.0, direction, 0, 10, 0.1)
            for peer, times in (("io", 12), ("europa", 12), ("callisto", 4))
            for _ in range(times)
            for direction in (Direction.IN, Direction.OUT)
        ),
        latest=lambda robot, _: robot == "europa" or None,
    )
    (fault,) = [event.words for event in delivered if isinstance(event, PeerFault)]
    assert fault.startswith("io was synced with 5 times but published nothing on /pose (json/Pose)")


def test_of_several_messages_in_one_the_newest_is_read(event_of, pennovation):
    """As a topic with `aggregate` brings them."""
    old, new = (pose(pennovation.frame, Point(3.0, north)).encode() for north in (4.0, 5.0))
    several = dataclasses.replace(received("/pose", b"packed"), parts=(old, new))
    assert event_of(several, "io").position == pytest.approx((3.0, 5.0), abs=1e-3)


def test_a_message_without_a_stamp_is_as_old_as_when_its_node_took_it(event_of, pennovation):
    unstamped = pose(pennovation.frame, Point(3.0, 4.0)).model_copy(update={"stamp_s": 0.0})
    assert event_of(received("/pose", unstamped.encode()), "io").stamp_s == 10.0


def test_a_place_beyond_every_mission_is_not_sought(event_of, pennovation):
    far = pose(pennovation.frame, Point(0.0, FARTHEST_M + 10.0))
    assert isinstance(event_of(received("/pose", far.encode()), "io"), PeerFault)
    way = path(pennovation.frame, (Point(0.0, 0.0), Point(0.0, FARTHEST_M + 10.0)))
    assert isinstance(event_of(received("/path", way), "io"), PeerFault)
    antipode = b'{"stamp_s": 1, "latitude_deg": -39.9, "longitude_deg": 104.8}'
    assert event_of(received("/pose", antipode), "io") is None


@pytest.mark.parametrize("corner", [Point(9_000.0, 7_000.0), Point(-2_000.0, 2_100.0)])
def test_of_a_mission_that_is_too_wide_for_a_map_the_part_around_home_is_painted(
    pennovation, corner
):
    last = dataclasses.replace(pennovation.waypoints[-1], position=corner)
    mission = dataclasses.replace(pennovation, waypoints=(*pennovation.waypoints[:-1], last))
    grid = Mapper(mission).grid
    rows, columns = grid.cells.shape
    assert 3_900_000 < rows * columns <= MAX_CELLS
    for near in (Point(40.0, 40.0), Point(-40.0, -40.0)):
        home = mission.home
        row = home.north_m + near.north_m - grid.south_m
        column = home.east_m + near.east_m - grid.west_m
        assert 0 < row < rows
        assert 0 < column < columns


def test_other_programs_can_watch_the_links_and_map_and_pose_are_published(pennovation, tmp_path):
    team = derive_team(Team.load(TEAM), tmp_path)
    mapper = Mapper(pennovation)
    clock = VehicleClock(unix=lambda: 1.8e9)
    made = Gossip(pennovation.frame, team, "titan", clock, mapper, metrics="tcp://127.0.0.1:*")

    async def fly():
        events = []
        made.start(events.append)
        try:
            watching = asyncio.to_thread(lambda: next(watch(made._metrics.endpoint)))
            kind, snapshot = await watching
            cells = np.full((3, 3), Terrain.ROAD, dtype=np.uint8)
            corner = (mapper.grid.west_m, mapper.grid.south_m)
            assert mapper.paint(GridPatch(*corner, 1.0, cells).encode())
            made.publish_telemetry(Telemetry(50.0, Point(0.0, 0.0), 40.0))
            held = made.node.latest("titan", "/map")
            pose = PoseMessage.decode(made.node.latest("titan", "/pose").data)
            assert pose.stamp_s == 1.8e9  # not the vehicle's own time since it booted
            return kind, snapshot, SemanticGrid.decode(held.data).known_cells, events
        finally:
            made.close()

    kind, snapshot, cells, _ = asyncio.run(fly())
    assert kind == "links"
    assert set(snapshot["links"]) == {"callisto", "europa", "io"}
    assert cells == 9


WITH_BASE = """
robots:
  basestation: {kind: base_station, address: 127.0.0.1, base_port: PORT_A, clients: [titan]}
  titan: {kind: aerial_robot, address: 127.0.0.1, base_port: PORT_B, clients: [basestation]}
kinds:
  base_station:
    topics: [{name: /goals, type: json/Goals, priority: high}]
  aerial_robot:
    topics: [{name: /answers, type: json/Answer, priority: high}]
trigger: {interval_s: 0.1}
"""


def team_with_base(folder):
    with socket.socket() as a, socket.socket() as b:
        a.bind(("127.0.0.1", 0))
        b.bind(("127.0.0.1", 0))
        ports = {"PORT_A": str(a.getsockname()[1]), "PORT_B": str(b.getsockname()[1])}
    text = WITH_BASE.replace("PORT_A", ports["PORT_A"]).replace("PORT_B", ports["PORT_B"])
    (folder / "team.yaml").write_text(text)
    return Team.load(folder / "team.yaml")


def test_goals_of_a_base_station_come_once_and_their_answer_goes_back(pennovation, tmp_path):
    team = team_with_base(tmp_path)
    frame, place = pennovation.frame, Point(30.0, -20.0)
    goals = GoalsMessage(stamp_s=1.0, id="a7", points=(frame.to_geodetic(place),), hold_s=9.0)
    made = Gossip(
        frame, team, "titan", VehicleClock(), Mapper(pennovation), goals_from=("basestation",)
    )

    async def meet():
        came, back = asyncio.Event(), asyncio.Event()
        requests, answers, loop = [], [], asyncio.get_running_loop()

        def deliver(event):
            if isinstance(event, GoTo):
                requests.append(event)
                made.publish_ack(CommandAck("a7", "basestation", False, "no", Refusal.NO_WAY))
                came.set()

        def at_base(event):
            if isinstance(event, MessageStored) and event.topic == "/answers":
                answers.append(base.latest("titan", "/answers").data)
                loop.call_soon_threadsafe(back.set)

        made.start(deliver)
        with Node(team, "basestation") as base:
            base.subscribe(at_base)
            base.publish("/goals", goals.encode())
            await asyncio.wait_for(came.wait(), 60)
            base.publish("/goals", goals.model_copy(update={"stamp_s": 2.0}).encode())
            await asyncio.wait_for(back.wait(), 60)
            back.clear()
            base.publish("/goals", b'{"stamp_s": 3, "id": "b1", "to": "atlas", "points": []}')
            base.publish("/goals", b'{"stamp_s": 4, "id": "b2", "points": [[151.2, -33.9]]}')
            await asyncio.wait_for(back.wait(), 60)
        return requests, answers

    try:
        (request,), (answer, *_, last) = asyncio.run(meet())
    finally:
        made.close()
    assert request.points[0] == pytest.approx(place, abs=1e-3)
    assert (request.by, request.request_id, request.hold_s) == ("basestation", "a7", 9.0)
    assert request.waits
    sent = AnswerMessage.decode(answer)
    assert (sent.to, sent.id, sent.accepted, sent.code) == ("basestation", "a7", False, "no-way")
    sent = AnswerMessage.decode(last)
    assert (sent.id, sent.accepted, sent.code) == ("b2", False, "not-read")
    assert "points.0.0: Input should be less than or equal to 90" in sent.why


def test_goals_of_others_for_others_too_late_or_broken_are_no_requests(pennovation):
    frame = pennovation.frame
    place = frame.to_geodetic(Point(30.0, -20.0))

    def read(reader, robot="basestation", topic="/goals", **changes):
        values = {"stamp_s": 1.0, "id": "a", "points": (place,), **changes}
        data = GoalsMessage.model_construct(**values).encode()
        return reader.event_of(robot, topic, data, peer=robot, unix_s=100.0)

    reader = TeamMessageDecoder(frame, name="titan", goals_from=("basestation",))
    assert read(TeamMessageDecoder(frame, name="titan")) is None
    assert read(reader, robot="io") is None
    assert read(reader, to="atlas") is None
    assert read(reader, until_s=99.0) is None
    for broken in ({"points": ()}, {"points": (place,) * 51}, {"hold_s": -1.0}, {"id": ""}):
        with pytest.raises(MessageError):
            read(reader, **broken)
    taken = read(reader, to="titan", until_s=101.0)
    assert (taken.request_id, taken.waits_s) == ("a", 1.0)
    assert read(reader) is None  # the same again
    assert read(reader, id="b").request_id == "b"
    assert read(reader, stamp_s=2.0) is None  # also after others


def test_a_whole_flight_goes_where_a_base_station_wants_it(pennovation, pretend_vehicle, tmp_path):
    team, place = team_with_base(tmp_path), Point(-150.0, 60.0)
    frame = pennovation.frame
    mission = dataclasses.replace(
        pennovation, uav="titan", goals_from=("basestation",), duration_s=None
    )
    wall_s = iter(range(10**9))
    clock = VehicleClock(monotonic=lambda: next(wall_s) * 1e-6, unix=lambda: 1.7e9)
    vehicle, mapper = pretend_vehicle(mission, clock), Mapper(mission)
    printed = io.StringIO()
    with Node(team, "basestation") as base, Recorder(None, "m") as recorder:
        goals = GoalsMessage(stamp_s=1.0, id="a7", points=(frame.to_geodetic(place),), hold_s=1.0)
        base.publish("/goals", goals.encode())
        flight = Flight(
            mission,
            vehicle,
            clock=clock,
            gossip=Gossip(frame, team, "titan", clock, mapper, goals_from=mission.goals_from),
            mapper=mapper,
            seek=("basestation",),
            recorder=recorder,
            status=StatusLine(printed),
            arm=True,
        )

        def on_step():
            back = base.latest("titan", "/answers")
            if back is not None and "at the last point" in printed.getvalue():
                vehicle.on_step = lambda: None
                flight.commands.submit(ComeHome())

        vehicle.on_step = on_step
        result = asyncio.run(flight.run())
        answer = AnswerMessage.decode(base.latest("titan", "/answers").data)
    assert result.outcome == "done"
    assert min(math.dist(place, at) for at in result.track) < 2.0
    assert (answer.id, answer.accepted) == ("a7", True)
