"""A flight as it is recorded: every kind of thing happens in it once."""

from air_router.controller.model.actions import (
    Announce,
    CommandAck,
    Finish,
    FlyToNode,
    MissionWaits,
    Refusal,
    Seeking,
    StateChanged,
)
from air_router.controller.model.events import (
    AirspaceChanged,
    CommandFailed,
    PlanRenewed,
    RobotPose,
)
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.requests import ComeHome, GoTo, HoldNow, SeekNow
from air_router.controller.model.states import Signal, State
from air_router.record.log import Note, RecordEntry
from air_router.report.flight_history import history_of
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.airspace.zone import Circle, Zone
from geo.frame import Point
from mocha_link.links.metrics import (
    ContactBegan,
    ContactEnded,
    Direction,
    MessageStored,
    RssiChanged,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.links.reading import Reading, Unit
from mocha_link.store.wire import Header

UNIX_S = 1_700_000_000.0
MAP_S = UNIX_S + 31.0


def along(t):
    """A flight to the west at 5 m/s, in the air from 10 to 70 s."""
    place = Point(-2.0 * max(0.0, min(t, 70.0) - 10.0), 0.0)
    return Telemetry(
        t, place, 40.0, armed=5 <= t < 72, in_air=10 <= t < 70, mode=FlightMode.MISSION,
        battery=1.0 - t / 200,
    )  # fmt: skip


def stored(t, robot, age_s, peer=None, topic="/pose"):
    stamp_ms = round((UNIX_S + t - age_s) * 1000)
    header = Header.at(1, 0, stamp_ms)
    return t, MessageStored(peer or robot, UNIX_S + t, robot, topic, header, 100)


def things(robot="io"):
    """What happens in it, in order."""
    events = [(float(t), along(float(t))) for t in range(81)]
    events += [
        (10.0, StateChanged(State.READY, Signal.AIRBORNE, State.INIT, None)),
        (20.0, RssiChanged(robot, UNIX_S + 20, -70.5)),
        (20.0, ContactBegan(robot, UNIX_S + 20, None)),
        (21.0, RssiChanged(robot, UNIX_S + 21, None, Reading(47.0, Unit.DEVICE, "rajant"))),
        (21.0, SyncStarted(robot, UNIX_S + 21, Direction.IN)),
        stored(22.0, robot, 1.0),
        (23.0, SyncEnded(robot, UNIX_S + 23, Direction.IN, 3, 4000, 0.1)),
        (24.0, SyncStarted(robot, UNIX_S + 24, Direction.OUT)),
        (25.0, SyncEnded(robot, UNIX_S + 25, Direction.OUT, 1, 90_000, 0.1)),
        (26.0, SyncStarted(robot, UNIX_S + 26, Direction.OUT)),
        (27.0, ContactEnded(robot, UNIX_S + 27, 7.0, "too weak")),
        (28.0, RobotPose(robot, Point(-10.0, 30.0), UNIX_S + 21, robot)),
        (30.0, StateChanged(State.INIT, Signal.TIMER, State.SEARCH, None)),
        (30.0, Announce(f"SEARCH {robot}: where its path ends")),
        (30.0, Seeking(robot)),
        (32.0, SeekNow(robot=robot, request_id="a", by="kim")),
        (32.0, CommandAck("a", "kim", accepted=True, why="seeking")),
        (33.0, GoTo(points=(Point(1.0, 2.0),), request_id="b", by="a base")),
        (33.0, CommandAck("b", "a base", accepted=False, why="in a zone", code=Refusal.NO_WAY)),
        (34.0, GoTo(points=(Point(3.0, 4.0),), request_id="1", by="a base", waits=True)),
        (35.0, HoldNow(request_id="1", by="kim")),
        (35.0, CommandAck("1", "kim", accepted=True, why="it stops")),
        (36.0, CommandAck("1", "a base", accepted=True, why="it flies")),
        (36.0, MissionWaits("INPUT_MISSING", "GPS has no fix", 36.0)),
        (38.5, MissionWaits("ZONE_UPDATE", "zones are being changed", 38.5)),
        (39.0, MissionWaits(None)),
        (79.0, MissionWaits("INPUT_MISSING", "GPS has no fix", 78.0)),
        (40.0, CommandFailed(FlyToNode(3, Point(0.0, 0.0)), "it was canceled")),
        stored(42.0, robot, 15.0, peer="europa"),
        stored(21.0, "titan", 0.0, topic="/map"),
        stored(31.0, "titan", 0.0, topic="/map"),
        stored(41.0, "titan", 0.0, topic="/map"),
        (50.0, SyncTimedOut(robot, UNIX_S + 50, Direction.OUT, "silence")),
        (14.0, AirspaceChanged((), (Zone("new", Circle(Point(-90.0, 9.0), 5.0)),))),
        (14.0, PlanRenewed()),
        (55.0, ComeHome()),
        (60.0, StateChanged(State.SEARCH, Signal.COME_HOME, State.HOME, robot)),
        (70.0, Finish(landed_by_us=True, why="landed")),
    ]
    return sorted(events, key=lambda pair: pair[0])


class Recorded(list):
    """Entries as a record gives them; `ending`: what is wrong with its end."""

    ending = None


def recorded(entries, ending=None):
    log = Recorded(entries)
    log.ending = ending
    return history_of(log)


def entries(mission, robot="io"):
    yield RecordEntry(0.0, "about", {"format": "1", "python": "3.11"})
    yield RecordEntry(0.0, "setup", FlightSetup(mission, (robot, "phantom"), name="titan"))
    yield RecordEntry(0.0, "note", Note("Vehicle", {"autopilot": "PX4", "version": "1.17.0"}))
    yield RecordEntry(0.0, "note", Note("Clock", {"unix_s": UNIX_S}))
    for t, value in things(robot):
        kind = (
            "action" if type(value).__module__ == "air_router.controller.model.actions" else "event"
        )
        yield RecordEntry(t, kind, value)
        if isinstance(value, Telemetry) and t > 12:
            if t % 10 == 0:
                yield RecordEntry(t, "note", Note("MapPublished", {"known_cells": int(100 * t)}))
            yield RecordEntry(t, "note", Note("Map", {"known_cells": int(100 * t)}))
    # It reports that it has the second version, which another robot handed to it.
    yield RecordEntry(
        81.0, "note", Note("Held", {"peer": robot, "held": [["titan", "/map", MAP_S]]})
    )
    yield RecordEntry(81.0, "note", Note("Map", {"known_cells": 8000}))
    yield RecordEntry(
        80.0, "note", Note("Report", {"outcome": "done", "robots": {robot: {"found": 1}}})
    )
