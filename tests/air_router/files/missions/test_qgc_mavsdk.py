"""MAVSDK, which reads plans by strict rules of its own, reads those that we write."""

import socket
import threading
from pathlib import Path

import pytest
from mavsdk.component_type import ComponentType
from mavsdk.logging import log_subscribe
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.mission_raw.mission_raw import MissionRaw
from pymavlink.dialects.v20 import common

from air_router.files.json_document import json_text
from air_router.files.missions.qgc_write import ConversionWarnings, plan_of
from air_router.mission.loading import read_placed
from air_router.sim.ports import free_port

DATA = Path(__file__).parents[3] / "data"
MISSIONS = Path(__file__).parents[4] / "missions"
SOURCES = [
    DATA / "pennovation.plan",
    DATA / "files" / "survey.plan",
    DATA / "files" / "town.yaml",
    MISSIONS / "pennovation" / "mission.yaml",
    MISSIONS / "urban" / "mission.yaml",
]


@pytest.fixture(scope="module")
def importer():
    """The importing plugin; it wants an autopilot that sends heartbeats."""
    log_subscribe(lambda *_: True)  # keeps MAVSDK's log off stdout
    port = free_port()
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    over = threading.Event()

    def send_heartbeats():
        link = common.MAVLink(None, srcSystem=1, srcComponent=1)
        beat = link.heartbeat_encode(common.MAV_TYPE_QUADROTOR, common.MAV_AUTOPILOT_PX4, 0, 0, 4)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not over.wait(0.1):
                sender.sendto(beat.pack(link), ("127.0.0.1", port))

    beating = threading.Thread(target=send_heartbeats)
    beating.start()
    try:
        plugin = MissionRaw(mavsdk.first_autopilot(30))
        yield plugin
        plugin.destroy()
    finally:
        over.set()
        beating.join()
        mavsdk.destroy()


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: f"{path.parent.stem}_{path.stem}")
def test_mavsdk_reads_what_is_written(importer, source):
    placed, _ = read_placed(source)
    found = importer.import_qgroundcontrol_mission_from_string(
        json_text(plan_of(placed, ConversionWarnings()))
    )
    waypoints = [item for item in found.mission_items if item.command == 16]
    assert len(waypoints) == len(placed.waypoints)
    for item, spot in zip(waypoints, placed.waypoints, strict=True):
        place = placed.frame.to_local(item.x / 1e7, item.y / 1e7)
        assert place == pytest.approx(spot.position, abs=0.02)
        assert item.z == pytest.approx(spot.altitude_m or placed.form.altitude_m)
    assert [item.command for item in found.mission_items if item.command != 16] == [178, 22, 20]
    starts = [item.command for item in found.geofence_items]
    circles = sum(not has_ring(area) for area in placed.fences + placed.zones)
    assert sum(command in (5003, 5004) for command in starts) == circles
    assert len(found.rally_items) == len(placed.rally_points)


def has_ring(area):
    return hasattr(area.shape, "ring")
