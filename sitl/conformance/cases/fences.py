"""Conversations about the geofence."""

from __future__ import annotations

from typing import Final

from sitl.conformance.conversation import Conversation, Start
from sitl.conformance.expectations import Event, Hear, InMode, StaysInMode, Text
from sitl.conformance.flight_steps import Arrives, Furthest, Setpoints, Stays
from sitl.conformance.plan_steps import Download, Item, Mission, Upload, box, polygon, waypoint
from sitl.conformance.steps import Command, Reposition, SetMode, Wait

_AHEAD = box(50, 0, 10.0)  # 40 to 60 m north of home
_PAIR = (*box(60, 0, 10.0), *box(60, 60, 10.0))
_FAR_CIRCLE = Item(5004, -200, 0, 0.0, frame=5, params=(5.0, 0, 0, 0))
_ACROSS = (waypoint(-10), waypoint(80, 0, 15))

CONVERSATIONS: Final = (
    Conversation(
        "fence-upload",
        "A fence is stored like a mission and comes back",
        "fence 5.8 s",
        (
            Upload(_AHEAD, 1),
            Wait(0.6),
            Download(tuple({"command": 5002, "param1": 4.0} for _ in _AHEAD), 1),
        ),
    ),
    Conversation(
        "fence-of-circle-and-polygon",
        "Circles and polygons go together; frame 3 is taken as well",
        "fence 13 s",
        (
            Upload((*_AHEAD, Item(5004, -50, 0, 0.0, frame=0, params=(10.0, 0, 0, 0))), 1),
            Upload(box(50, 0, 10.0, frame=3), 1),
        ),
    ),
    Conversation(
        "polygons-behind-a-circle",
        "Behind a circle every vertex of a polygon begins a polygon of its own: what lies between "
        "two of them counts as inside; with the circle last it does not",
        "measured; read in the source",
        (
            Upload((Item(22, z_m=15.0), waypoint(60, 30), waypoint(0, 20))),
            Upload((_FAR_CIRCLE, *_PAIR), 1),
            Text("Geofence violation for waypoint 2"),
            Mission({"mission_state": 1}),
            Upload((*_PAIR, _FAR_CIRCLE), 1),
            Mission({"mission_state": 2}),
        ),
    ),
    Conversation(
        "polygon-of-two",
        "A polygon of two vertices is answered ERROR at the first item; inconsistent counts are "
        "ACCEPTED",
        "fence 12 s",
        (
            Upload(polygon((40, 0), (60, 0)), 1, "ERROR", refused_at=0),
            Upload(box(50, 0, 10.0, params=(3.0, 0.0, 0.0, 0.0)), 1),
        ),
    ),
    Conversation(
        "waypoint-in-a-zone",
        "A mission with a waypoint inside an exclusion is ACCEPTED; then a text, an EVENT, state 1",
        "fence 8 s",
        (
            Upload(_AHEAD, 1),
            Wait(1.0),
            Upload((Item(22, z_m=15.0), waypoint(50), waypoint(0, 20))),
            Text("Geofence violation for waypoint 2"),
            Event("navigator_mis_geofence_violation"),
            Mission({"total": 3, "mission_state": 1}),
        ),
    ),
    Conversation(
        "leg-across-a-zone",
        "A leg across an exclusion is not looked at: the mission counts as ready",
        "fence 10 s",
        (
            Upload(_AHEAD, 1),
            Wait(1.0),
            Upload((Item(22, z_m=15.0), *_ACROSS)),
            Mission({"total": 3, "mission_state": 2}),
        ),
    ),
    Conversation(
        "waypoint-outside-an-inclusion",
        "A fence that is loaded after the mission judges it again",
        "fence 235 s",
        (
            Upload((Item(22, z_m=15.0), waypoint(50))),
            Mission({"total": 2, "mission_state": 2}),
            Upload(box(0, 0, 30.0, inclusion=True), 1),
            Text("Geofence violation for waypoint 2"),
            Event("navigator_mis_geofence_violation"),
            Mission({"total": 2, "mission_state": 1}),
        ),
    ),
    Conversation(
        "fence-around-home",
        "An exclusion that holds home is invalid and left out: it arms",
        "fence 230 s",
        (
            Upload(box(0, 0, 30.0), 1),
            Text("Geofence invalid, doesn't contain Home position"),
            Event("navigator_geofence_invalid_against_home"),
            Wait(1.0),
            Command(400, (1,)),
        ),
    ),
    Conversation(
        "fence-around-the-flying-vehicle",
        "In flight an exclusion around the vehicle is invalid as well; it flies about in it",
        "fence 195 s",
        (
            Upload(box(0, 0, 30.0), 1),
            Text("Geofence invalid, doesn't contain Home position"),
            Event("navigator_geofence_invalid_against_home"),
            Event("navigator_geofence_invalid_against_cur_pos"),
            Reposition(20, 20, 15),
            Arrives(20, 20, 15, near_m=3.0),
            InMode("AUTO_LOITER", status=4),
        ),
        Start.AIR,
    ),
    Conversation(
        "goto-into-a-zone",
        "A goto into an exclusion is ACCEPTED, then refused in words; the vehicle stays",
        "fence 32 s",
        (
            Upload(_AHEAD, 1),
            Wait(1.5),
            Reposition(50, 0, 15),
            Text("Reposition is outside geofence"),
            Event("navigator_reposition_outside_geofence"),
            Stays(6.0, 2.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "fence-not-yet-in-force",
        "A fence is in force only some tenths of a second after its MISSION_ACK: a goto into it "
        "right after is flown",
        "misc 91 s to 171 s",
        (Upload(_AHEAD, 1), Reposition(50, 0, 15), Arrives(12, 0, None, within_s=10.0)),
        Start.AIR,
    ),
    Conversation(
        "goto-across-a-zone",
        "A goto across an exclusion is flown; on entry the failsafe holds, overshoots by some "
        "metres and comes back to the edge",
        "fence 53 s: 7.6 m",
        (
            Upload(_AHEAD, 1),
            Wait(1.5),
            Reposition(80, 0, 15),
            Text("Geofence: approaching or outside geofence", 25.0),
            Event("commander_failsafe_enter_generic"),
            Text("Failsafe activated"),
            InMode("AUTO_LOITER", status=5),
            Furthest(8.0, 43.0, 51.0),
            Wait(6.0),
            Arrives(40.5, 0, None, near_m=3.0, within_s=5.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "mission-across-a-zone",
        "A mission across an exclusion: Hold, while CURRENT_MODE keeps Mission as what was wanted",
        "fence 92 s to 124 s",
        (
            Upload(_AHEAD, 1),
            Wait(1.5),
            Upload(_ACROSS),
            Mission({"mission_state": 2}),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION"),
            Text("Geofence: approaching or outside geofence", 40.0),
            InMode("AUTO_LOITER", status=5, intended="AUTO_MISSION"),
            Mission({"seq": 1, "mission_state": 4, "mission_mode": 2}),
        ),
        Start.AIR,
    ),
    Conversation(
        "mission-goes-on-after-a-breach",
        "Commanded on, it flies straight through the zone without a second reaction",
        "for a controller 4",
        (
            Upload(_AHEAD, 1),
            Wait(1.5),
            Upload(_ACROSS),
            Mission({"mission_state": 2}),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_LOITER", 45.0, status=5),
            Wait(8.0),
            SetMode("AUTO_MISSION"),
            Event("failsafe_rc_override"),
            InMode("AUTO_MISSION", status=4),
            Arrives(75, 0, None, near_m=4.0, within_s=40.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "goto-out-of-a-breach",
        "A goto out of the zone ends the failsafe",
        "fence 79 s",
        (
            Upload(_AHEAD, 1),
            Wait(1.5),
            Reposition(80, 0, 15),
            InMode("AUTO_LOITER", 25.0, status=5),
            Wait(10.0),
            Reposition(0, 0, 15),
            Event("failsafe_rc_override"),
            InMode("AUTO_LOITER", status=4),
            Arrives(0, 0, None, near_m=3.0, within_s=25.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "offboard-into-a-zone",
        "Offboard into a zone: Hold, with a long overshoot; asked again, Offboard flies on inside",
        "fence 140 s to 168 s",
        (
            Upload(_AHEAD, 1),
            Wait(1.5),
            Setpoints(50),
            Wait(0.5),
            SetMode("OFFBOARD"),
            InMode("OFFBOARD"),
            InMode("AUTO_LOITER", 25.0, status=5, intended="OFFBOARD"),
            Furthest(6.0, 45.0, 70.0),
            SetMode("OFFBOARD"),
            InMode("OFFBOARD", status=4),
            StaysInMode("OFFBOARD", 4.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "fence-return",
        "With GF_ACTION 3 a breach returns, after no delay",
        "measured",
        (
            Upload(_AHEAD, 1),
            Wait(1.5),
            Reposition(80, 0, 15),
            Text("Failsafe activated", 25.0),
            InMode("AUTO_RTL", 8.0, status=5),
        ),
        Start.AIR,
        {"GF_ACTION": 3},
    ),
    Conversation(
        "fence-warning",
        "With GF_ACTION 1 a breach is only said",
        "measured",
        (
            Upload(_AHEAD, 1),
            Wait(1.5),
            Reposition(80, 0, 15),
            Text("Geofence: approaching or outside geofence", 25.0),
            Arrives(80, 0, None, near_m=3.0, within_s=20.0),
            InMode("AUTO_LOITER", status=4),
        ),
        Start.AIR,
        {"GF_ACTION": 1},
    ),
    Conversation(
        "furthest-from-home",
        "GF_MAX_HOR_DIST holds like a fence does: a goto beyond it is refused in words",
        "measured",
        (
            Reposition(60, 0, 15),
            Text("Reposition is outside geofence"),
            Stays(4.0, 2.0),
            Reposition(20, 0, 15),
            Arrives(20, 0, None, near_m=3.0),
        ),
        Start.AIR,
        {"GF_MAX_HOR_DIST": 30.0},
    ),
    Conversation(
        "two-inclusions",
        "Several inclusions have to be kept all at once: a waypoint in one of two is a violation",
        "for a controller 6",
        (
            Upload((*box(0, 0, 30.0, inclusion=True), *box(20, 0, 30.0, inclusion=True)), 1),
            Wait(1.0),
            Upload((waypoint(10), waypoint(20), waypoint(40))),
            Text("Geofence violation for waypoint 3"),
            Hear("MISSION_CURRENT", {"mission_state": 1}, 3.0),
        ),
    ),
)
