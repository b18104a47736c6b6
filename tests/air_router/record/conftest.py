"""A short record with something of everything that is drawn."""

import dataclasses
import math

import pytest

from air_router.controller.model.actions import Announce, FlyToNode, StateChanged
from air_router.controller.model.events import RobotPose
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.requests import ComeHome
from air_router.controller.model.states import Signal, State
from air_router.gossip.mapper import Mapper
from air_router.record.recorder import Recorder
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point
from geo.grid import GridPatch
from mocha_link.links.metrics import Direction, LinkMetrics, SyncStarted
from mocha_link.links.reading import Reading, Unit

UNIX_S = 1.7e9
SIGNAL = Reading(47.0, Unit.DEVICE, "rajant")
LINK = LinkMetrics("io", signal=SIGNAL, newest_age_s=math.inf)


def fly(recorder, mission):
    mapper = Mapper(mission)
    patch = GridPatch(mapper.grid.west_m, mapper.grid.south_m, 1.0, mapper.grid.cells[:2, :3] + 1)
    recorder.begin(FlightSetup(mission, ("io",), name="titan"), arm=True)
    recorder.file(mission.path)
    for second in range(20):
        place = Point(1.0 + second, 2.0)
        telemetry = Telemetry(1.0 + second, place, 40.0, battery=0.75, mode=FlightMode.MISSION)
        recorder.event(telemetry, telemetry.time_s)
    recorder.event(SyncStarted("io", 9.0, Direction.OUT), 20.5)
    recorder.event(RobotPose("io", Point(5.0, 6.0), 8.0, "io"), 21.0)
    recorder.actions((FlyToNode(3, Point(8.0, 2.0)),), 21.0)
    recorder.actions((StateChanged(State.READY, Signal.AIRBORNE, State.INIT, None),), 22.0)
    recorder.event(ComeHome(), 22.1 + 0.2)
    recorder.actions((Announce("coming home"),), 23.0)
    held = {"io": {("titan", "/map"): 8.5}}
    recorder.links(lambda: {"io": LINK}, lambda: held, 24.0)
    recorder.links(lambda: {"io": dataclasses.replace(LINK, newest_age_s=3.0)}, lambda: held, 25.0)
    assert mapper.paint(patch.encode())
    recorder.patch(patch.encode(), 25.0)
    mapper.publish(25.0)
    recorder.map(mapper, 25.0)
    recorder.note("Report", 26.0, {"outcome": "done", "distance_m": math.nan})


DRAWN = {
    "/mission": "foxglove.GeoJSON",
    "/scene": "foxglove.SceneUpdate",
    "/scene/robots": "foxglove.SceneUpdate",
    "/leg": "foxglove.GeoJSON",
    "/vehicle/location": "foxglove.LocationFix",
    "/vehicle/pose": "foxglove.PoseInFrame",
    "/robots/io/location": "foxglove.LocationFix",
    "/log": "foxglove.Log",
    "/map": "foxglove.Grid",
}
"""What is drawn for Foxglove of a short flight: topics, and their schemas."""


@pytest.fixture(scope="module")
def record(tmp_path_factory, pennovation):
    folder = tmp_path_factory.mktemp("record")
    with Recorder(folder, "mission.yaml", unix_s=lambda: UNIX_S, name="ti/tan") as recorder:
        fly(recorder, pennovation)
    return recorder.path


@pytest.fixture
def shown(pennovation):
    """Flies the same before a viewer, without a record."""

    def show(viewer):
        with Recorder(None, "mission.yaml", unix_s=lambda: UNIX_S, viewer=viewer) as recorder:
            fly(recorder, pennovation)

    return show
