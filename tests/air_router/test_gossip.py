import asyncio
from pathlib import Path

import numpy as np
import pytest

from air_router.clock import VehicleClock
from air_router.events import RobotPath, RobotPose
from air_router.gossip import FARTHEST_M, Gossip
from air_router.mapper import Mapper
from air_router.messages import PathMessage, PoseMessage
from air_router.vehicle import Telemetry
from geo.frame import Point
from geo.grid import GridPatch, SemanticGrid, Terrain
from mocha_link import Message, Team
from mocha_link.header import Header
from mocha_link.team import Priority
from mocha_link.telemetry import watch
from sitl.free_ports import derive_team

TEAM = Path(__file__).parents[2] / "missions" / "pennovation" / "team.yaml"


@pytest.fixture
def gossip(pennovation):
    made = Gossip(pennovation.frame, Team.load(TEAM), "titan", VehicleClock(), Mapper(pennovation))
    yield made
    made.close()


def heard(topic, data):
    return Message("io", topic, Header(2, 0, 10, 0), Priority.HIGH, data, 10.0, 10.0)


def pose(frame, place):
    latitude_deg, longitude_deg = frame.to_geodetic(place)
    return PoseMessage(stamp_s=9.0, latitude_deg=latitude_deg, longitude_deg=longitude_deg)


def test_a_pose_and_the_end_of_a_path_are_news(gossip, pennovation):
    place = Point(30.0, -20.0)
    message = pose(pennovation.frame, place)
    news = gossip._news(heard("/pose", message.encode()), "europa")
    assert isinstance(news, RobotPose)
    assert (news.robot, news.peer, news.stamp_s) == ("io", "europa", 9.0)
    assert news.position == pytest.approx(place, abs=1e-3)
    points = ((39.0, -75.0), (message.latitude_deg, message.longitude_deg))
    path = PathMessage(stamp_s=9.0, points=points)
    news = gossip._news(heard("/path", path.encode()), "io")
    assert isinstance(news, RobotPath)
    assert news.destination == pytest.approx(place, abs=1e-3)


@pytest.mark.parametrize(
    "data",
    [b"", b"{}", b"\xff\x00", b'{"stamp_s": 1, "latitude_deg": 95, "longitude_deg": 0}'],
)
def test_junk_is_no_news(gossip, data):
    assert gossip._news(heard("/pose", data), "io") is None
    assert gossip._news(heard("/path", data), "io") is None


def test_a_place_beyond_every_mission_is_not_sought(gossip, pennovation):
    far = pose(pennovation.frame, Point(0.0, FARTHEST_M + 10.0))
    assert gossip._news(heard("/pose", far.encode()), "io") is None
    antipode = b'{"stamp_s": 1, "latitude_deg": -39.9, "longitude_deg": 104.8}'
    assert gossip._news(heard("/pose", antipode), "io") is None


def test_other_programs_can_watch_the_links_and_the_map_is_published(pennovation, tmp_path):
    team = derive_team(Team.load(TEAM), tmp_path)
    mapper = Mapper(pennovation)
    made = Gossip(
        pennovation.frame, team, "titan", VehicleClock(), mapper, metrics="tcp://127.0.0.1:*"
    )

    async def fly():
        events = []
        made.start(events.append)
        try:
            watching = asyncio.to_thread(lambda: next(watch(made.metrics_endpoint)))
            kind, snapshot = await watching
            cells = np.full((3, 3), Terrain.ROAD, dtype=np.uint8)
            corner = (mapper.grid.west_m, mapper.grid.south_m)
            assert mapper.paint(GridPatch(*corner, 1.0, cells).encode())
            made.tell(Telemetry(50.0, Point(0.0, 0.0), 40.0))
            held = made.node.latest("titan", "/map")
            return kind, snapshot, SemanticGrid.decode(held.data).known_cells, events
        finally:
            made.close()

    kind, snapshot, cells, _ = asyncio.run(fly())
    assert kind == "links"
    assert set(snapshot["links"]) == {"callisto", "europa", "io"}
    assert cells == 9
