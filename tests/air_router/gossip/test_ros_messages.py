"""Poses and paths in ROS types, hostile ones among them, and the map as an OccupancyGrid."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="ROS messages need the extra 'ros'")

from air_router.gossip import ros_messages
from air_router.gossip.gossip import Gossip
from air_router.gossip.mapper import Mapper
from air_router.gossip.ros_messages import (
    OCCUPANCY,
    ROS_LIMIT_BYTES,
    occupancy_writer,
    readers_of,
)
from air_router.messages import MessageError, PathMessage, PoseMessage
from air_router.mission.team import FIX, LOCAL_POSES, PATH, path_topic, pose_topic
from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Geodetic, LocalFrame, Point
from geo.grid import GridPatch, SemanticGrid, Terrain
from mocha_link import Team
from mocha_link.errors import MissingExtraError
from mocha_link.ros.ros import RosCodec
from mocha_link.team.document import Document
from sitl.team.nodes import RosMessages
from sitl.world.ground_robots import Publication

DATUM = Geodetic(47.3977, 8.5456)
CODEC = RosCodec()
PLACE = LocalFrame(DATUM).to_geodetic(Point(30.0, -20.0))


TEAM = """
robots:
  titan: {kind: aerial_robot, address: 127.0.0.1, base_port: 24000, clients: [io] TITAN}
  io: {kind: rover, address: 127.0.0.1, base_port: 24100, clients: [titan] IO}
kinds:
  aerial_robot:
    topics:
      - {name: /map, type: grid/SemanticMap}
      - {name: /grid, type: nav_msgs/OccupancyGrid}
  rover: {topics: [TOPICS]}
"""


def team_of(*topics, ros=1, datum="", titan=""):
    """Of titan and io, which has topics (name, type)."""
    listed = ", ".join(f"{{name: {name}, type: {kind}}}" for name, kind in topics)
    text = TEAM.replace("TOPICS", listed).replace(" TITAN", titan)
    text = text.replace(" IO", f", ros: {ros}{datum}")
    return Team.from_document(Document.from_text(text, Path("team.yaml")))


def placed(yaw=""):
    return f", datum: [{DATUM.latitude_deg}, {DATUM.longitude_deg}{yaw}]"


def read(team, topic, values):
    kind, ros = team.topic("io", topic).type, team.robot("io").ros
    return readers_of(team)["io", topic](CODEC.encode(kind, values, ros))


def local(kind, **position):
    pose = {"position": position}
    return {"pose": pose if kind == "geometry_msgs/PoseStamped" else {"pose": pose}}


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("kind", [FIX, *LOCAL_POSES])
def test_what_a_simulated_robot_publishes_is_read_as_it_was_meant(kind, ros):
    team = team_of(("/odometry", kind), ("/plan", PATH), ros=ros, datum=placed(", 90"))
    speech, readers = RosMessages(team), readers_of(team)
    pose = PoseMessage(stamp_s=1.7e9, latitude_deg=PLACE[0], longitude_deg=PLACE[1])
    path = PathMessage(stamp_s=1.7e9, points=(DATUM, PLACE))
    assert speech.topics("io") == {"/odometry", "/plan", "/pose", "/path"}
    published = speech.of(Publication("io", "/pose", pose.encode()))
    assert published.topic == "/odometry"
    received = readers["io", published.topic](published.data)
    assert received.stamp_s == 1.7e9
    assert (received.latitude_deg, received.longitude_deg) == pytest.approx(PLACE, abs=1e-9)
    published = speech.of(Publication("io", "/path", path.encode()))
    points = readers["io", published.topic](published.data).points
    assert [*points[0], *points[1]] == pytest.approx([*DATUM, *PLACE], abs=1e-9)


def test_x_is_turned_from_east_by_the_yaw_of_the_datum():
    """A path of metres north is one along x where x is turned by 90 degrees."""
    team = team_of(("/odom", "nav_msgs/Odometry"), datum=placed(", 90"))
    since_boot = {"header": {"stamp": {"sec": 12}}}  # of a clock that shows no time of day
    published = read(team, "/odom", {**local("nav_msgs/Odometry", x=100.0, y=30.0), **since_boot})
    place = LocalFrame(DATUM).to_local(published.latitude_deg, published.longitude_deg)
    assert place == pytest.approx((-30.0, 100.0), abs=1e-6)
    assert published.stamp_s == 0.0


def test_no_fix_is_no_place():
    assert read(team_of(("/fix", FIX)), "/fix", {"status": {"status": -1}}) is None


@pytest.mark.parametrize(
    ("topics", "datum", "pose", "path"),
    [
        ([("/odom", "nav_msgs/Odometry"), ("/fix", FIX)], "", "/fix", None),
        ([("/odom", "nav_msgs/Odometry"), ("/fix", FIX)], placed(), "/odom", None),
        ([("/fix", FIX), ("/pose", "json/Pose"), ("/plan", PATH)], "", "/fix", None),
        ([("/goal_pose", "geometry_msgs/PoseStamped"), ("/plan", PATH)], placed(), None, "/plan"),
        ([("/pose", "my/Pose"), ("/path", "json/Path")], placed(), None, "/path"),
    ],
)
def test_the_first_topic_that_can_be_read_counts(topics, datum, pose, path):
    team = team_of(*topics, datum=datum)
    found = pose_topic(team, "io"), path_topic(team, "io")
    assert tuple(topic and topic.name for topic in found) == (pose, path)
    assert {topic for robot, topic in readers_of(team) if robot == "io"} == {pose, path} - {None}


HOSTILE = [
    (FIX, {"latitude": "nan", "longitude": 1.0}),
    (FIX, {"latitude": 91.0, "longitude": 1.0}),
    ("nav_msgs/Odometry", local("nav_msgs/Odometry", x="inf")),
    ("nav_msgs/Odometry", local("nav_msgs/Odometry", x=1e300, y=1e300)),
    (PATH, {"poses": [{"pose": {"position": {"x": "nan"}}}]}),
    (PATH, {"poses": [{}] * 6000}),
]


@pytest.mark.parametrize(("kind", "values"), HOSTILE)
def test_numbers_that_are_none_and_too_many_are_refused(kind, values):
    with pytest.raises(MessageError):
        read(team_of(("/it", kind), datum=placed()), "/it", values)


@pytest.mark.parametrize("data", [b"", b"\0" * 7, b"\xff" * 100, bytes(ROS_LIMIT_BYTES + 1)])
def test_junk_is_refused(data):
    with pytest.raises(MessageError):
        readers_of(team_of(("/fix", FIX)))["io", "/fix"](data)


@pytest.mark.parametrize("ros", [1, 2])
def test_the_map_as_an_occupancy_grid(ros):
    datum = LocalFrame(DATUM).to_geodetic(Point(100.0, 0.0))
    place = f", ros: {ros}, datum: [{datum.latitude_deg}, {datum.longitude_deg}]"
    grid = SemanticGrid.blank(DATUM, 0.5, Point(10.0, 20.0), Point(12.0, 21.0))
    grid.paint(GridPatch(10.0, 20.0, 0.5, np.array([[1, 3, 2, 0]], dtype=np.uint8)))
    team = team_of(("/fix", FIX), titan=place)
    grid_message = CODEC.decode(OCCUPANCY, occupancy_writer(team, "titan")(grid, 1.7e9 + 0.5), ros)
    stamp = grid_message.header.stamp
    assert (stamp.sec, stamp.nanosec) == (1_700_000_000, 500_000_000)
    info = grid_message.info
    assert (info.width, info.height, info.resolution) == (4, 2, 0.5)
    origin = info.origin
    assert (origin.position.x, origin.position.y) == pytest.approx((-90.0, 20.0), abs=1e-2)
    assert (origin.orientation.z, origin.orientation.w) == pytest.approx((0.0, 1.0), abs=1e-4)
    assert grid_message.data.tolist() == [0, 100, 50, -1, -1, -1, -1, -1]


def test_both_maps_are_published(pennovation):
    mapper, team = Mapper(pennovation), team_of(("/fix", FIX))
    gossip = Gossip(pennovation.frame, team, "titan", VehicleClock(), mapper)
    cells = np.full((3, 3), Terrain.ROAD, dtype=np.uint8)
    mapper.paint(GridPatch(mapper.grid.west_m, mapper.grid.south_m, 1.0, cells).encode())
    gossip.publish_telemetry(Telemetry(50.0, Point(0.0, 0.0), 40.0))
    shown = CODEC.decode(OCCUPANCY, gossip.node.latest("titan", "/grid").data, 1)
    assert np.count_nonzero(shown.data == 0) == 9
    assert SemanticGrid.decode(gossip.node.latest("titan", "/map").data).known_cells == 9
    gossip.close()


def test_ros_without_its_extra_is_refused_before_take_off(monkeypatch):
    monkeypatch.setattr(ros_messages.Types, "has_ros", property(lambda _: False))
    with pytest.raises(
        MissingExtraError, match=r"team\.yaml, with ROS messages for this UAV, needs"
    ):
        readers_of(team_of(("/fix", FIX)))
    assert readers_of(team_of(("/pose", "json/Pose"))).keys() == {("io", "/pose")}
