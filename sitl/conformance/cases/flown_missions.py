"""Conversations about flying missions."""

from __future__ import annotations

from typing import Final

from sitl.conformance.conversation import Conversation, Start
from sitl.conformance.expectations import Event, Hear, InMode, StaysInMode, Text
from sitl.conformance.flight_steps import Arrives, Stays
from sitl.conformance.plan_steps import (
    ClearAll,
    Item,
    Mission,
    SetCurrent,
    Upload,
    waypoint,
)
from sitl.conformance.steps import Command, Mark, SetMode, Wait

_PAIR = (Item(22, z_m=15.0), waypoint(20))
_NODES = tuple(
    waypoint(north, east, autocontinue=False) for north, east in ((20, 0), (20, 20), (0, 20))
)

CONVERSATIONS: Final = (
    Conversation(
        "mission-from-the-ground",
        "Mission mode, then armed: it says what it executes, climbs where it is, and flies",
        "misc 16 s",
        (
            Upload(_PAIR),
            Mission({"mission_state": 2}),
            SetMode("AUTO_MISSION"),
            Command(400, (1,)),
            Event("mission_execute"),
            Event("mission_climb_before_start"),
            Mission({"seq": 0, "mission_state": 3, "mission_mode": 1}),
            Event("commander_takeoff_detected", 8.0),
            Hear("MISSION_ITEM_REACHED", {"seq": 0}, 25.0),
            Mission({"seq": 1}),
            Hear("MISSION_ITEM_REACHED", {"seq": 1}, 20.0),
        ),
    ),
    Conversation(
        "mission-end",
        "A mission that ends in the air: a text, state 5, Hold",
        "misc 49 s",
        (
            Upload((waypoint(15), waypoint(15, 10))),
            Mission({"mission_state": 2}),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION"),
            Mark(),
            Text("Mission finished, loitering", 30.0),
            Event("mission_finished_loiter"),
            Mission({"seq": 1, "mission_state": 5, "mission_mode": 2}),
            InMode("AUTO_LOITER"),
        ),
        Start.AIR,
    ),
    Conversation(
        "node-without-autocontinue",
        "At an item without autocontinue it reports MISSION_ITEM_REACHED, again and again, and "
        "stays in Mission until it is sent on",
        "for a controller 1",
        (
            Upload(_NODES),
            Mission({"mission_state": 2}),
            SetMode("AUTO_MISSION"),
            Mark(),
            Hear("MISSION_ITEM_REACHED", {"seq": 0}, 20.0, times=4),
            Arrives(20, 0, 15, near_m=2.5),
            Wait(3.0),
            Stays(5.0, 1.5),
            InMode("AUTO_MISSION"),
            Mission({"seq": 0, "mission_state": 3}),
        ),
        Start.AIR,
    ),
    Conversation(
        "jump-to-a-node",
        "MISSION_SET_CURRENT flies straight to the item, also in the middle of a leg",
        "for a controller 2",
        (
            Upload(_NODES),
            Mission({"mission_state": 2}),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION"),
            SetCurrent(2),
            Mission({"seq": 2}, 1.0),
            Arrives(0, 20, 15, near_m=2.5),
            SetCurrent(0),
            Mission({"seq": 0}, 1.0),
            Wait(2.5),
            SetCurrent(1),
            Arrives(20, 20, 15, near_m=2.5),
            Hear("MISSION_ITEM_REACHED", {"seq": 1}),
        ),
        Start.AIR,
    ),
    Conversation(
        "jump-in-hold",
        "In Hold MISSION_SET_CURRENT changes the index and does not move; Mission mode then flies "
        "on",
        "for a controller 2",
        (
            Upload(_NODES),
            Mission({"mission_state": 2}),
            SetCurrent(1),
            Mission({"seq": 1}),
            Stays(4.0, 1.5),
            SetMode("AUTO_MISSION"),
            Arrives(20, 20, 15, near_m=2.5),
            Mission({"seq": 1}),
        ),
        Start.AIR,
    ),
    Conversation(
        "jump-out-of-range-in-flight",
        "MISSION_SET_CURRENT out of range changes nothing but a text",
        "for a controller 2; mis 79 s",
        (
            Upload(_NODES),
            Mission({"mission_state": 2}),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION"),
            SetCurrent(77),
            Text("WPM: WP CURR CMD: Not in list"),
            Mission({"seq": 0, "mission_state": 3}),
        ),
        Start.AIR,
    ),
    Conversation(
        "upload-in-flight-keeps-the-index",
        "An upload in Mission keeps the index that is flown, if the new plan has it",
        "misc 39 s",
        (
            Upload((waypoint(60), waypoint(60, 20), waypoint(0, 20))),
            Mission({"mission_state": 2}),
            SetCurrent(1),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION"),
            Upload((waypoint(50), waypoint(50, 30))),
            Mission({"seq": 1, "total": 2, "mission_state": 3}),
            Arrives(50, 30, 15, near_m=3.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "upload-in-flight-ends-at-the-last",
        "An upload in Mission that has no such item any more goes on with its last item",
        "measured",
        (
            Upload((waypoint(60), waypoint(60, 20), waypoint(0, 20))),
            Mission({"mission_state": 2}),
            SetCurrent(2),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION"),
            Upload((waypoint(50), waypoint(50, 30))),
            Mission({"seq": 1, "total": 2, "mission_state": 3}),
        ),
        Start.AIR,
    ),
    Conversation(
        "clear-in-flight",
        "Cleared in Mission it holds and says that there is no valid mission",
        "mission protocol",
        (
            Upload(_NODES),
            Mission({"mission_state": 2}),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION"),
            ClearAll(),
            Text("No valid mission available, loitering"),
            InMode("AUTO_LOITER"),
            Mission({"total": 65535, "mission_state": 1}),
        ),
        Start.AIR,
    ),
    Conversation(
        "mission-mode-twice",
        "Mission, Hold, Mission: it goes on with the item that it had",
        "for a controller 2",
        (
            Upload(_NODES),
            Mission({"mission_state": 2}),
            SetCurrent(1),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION"),
            Wait(2.0),
            SetMode("AUTO_LOITER"),
            InMode("AUTO_LOITER"),
            Mission({"seq": 1, "mission_mode": 2}),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION"),
            Mission({"seq": 1, "mission_state": 3, "mission_mode": 1}),
            Arrives(20, 20, 15, near_m=2.5),
            StaysInMode("AUTO_MISSION", 3.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "mission-returns",
        "An item RETURN_TO_LAUNCH changes the mode to Return",
        "mission_mavsdk4",
        (
            Upload((waypoint(12), Item(20, frame=2, params=(0.0,) * 4, raw=(0, 0), z_m=0.0))),
            Mission({"mission_state": 2}),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION"),
            InMode("AUTO_RTL", 25.0),
        ),
        Start.AIR,
    ),
)
