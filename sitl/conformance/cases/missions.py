"""Conversations about transferring missions: upload, download, clear."""

from __future__ import annotations

import math
from typing import Final

from sitl.conformance.conversation import Conversation
from sitl.conformance.expectations import Event, Hear, Silence, Text
from sitl.conformance.plan_steps import (
    ClearAll,
    Download,
    Item,
    Mission,
    Requests,
    SetCurrent,
    Upload,
    waypoint,
)
from sitl.conformance.steps import Say, Wait

_GOOD = (Item(22, z_m=15.0), waypoint(20), waypoint(20, 20), waypoint(0, 20))
_PAIR = (Item(22, z_m=15.0), waypoint(20))
_LEFT = {"total": 4, "mission_state": 2}


def _judged(name: str, fact: str, at: str, item: Item, state: int = 2) -> Conversation:
    items = (_GOOD[0], item)
    steps = (Upload(items), Mission({"total": 2, "mission_state": state}))
    return Conversation(f"stored-{name}", fact, at, steps)


def _refused(name: str, fact: str, at: str, item: Item, result: str) -> Conversation:
    return Conversation(
        f"refused-{name}",
        fact,
        at,
        (
            Upload(_GOOD),
            Mission(_LEFT),
            Upload((_GOOD[0], item), result=result),
            Event("mavlink_mission_mis_item_invalid"),
            Text("IGN MISSION_ITEM: Invalid item"),
            Mission(_LEFT),
        ),
    )


CONVERSATIONS: Final = (
    Conversation(
        "mission-upload-and-download",
        "An upload asks for every item with MISSION_REQUEST_INT and ends with ACCEPTED; "
        "MISSION_CURRENT then says that it can be flown (state 2)",
        "mis 3.8 s",
        (
            Upload(_GOOD),
            Hear("MISSION_ACK", {"type": 0}),
            Mission({"seq": 0, "total": 4, "mission_state": 2, "mission_mode": 2}),
            Download(tuple({"command": item.command, "frame": 6} for item in _GOOD)),
        ),
    ),
    Conversation(
        "download-as-floats",
        "MISSION_REQUEST is answered with MISSION_ITEM, in degrees and the old frames",
        "mission protocol",
        (
            Upload(_PAIR),
            Download(({"command": 22, "frame": 3}, {"frame": 3}), as_float=True),
        ),
    ),
    Conversation(
        "frames-come-back-as-int",
        "Frames 0 and 5 come back as 5, frames 3 and 6 as 6",
        "mission protocol",
        (
            Upload((Item(16, 10, z_m=500.0, frame=0), Item(16, 20, z_m=500.0, frame=5))),
            Download(({"frame": 5}, {"frame": 5})),
            Upload((waypoint(10, frame=3), waypoint(20, frame=6))),
            Download(({"frame": 6}, {"frame": 6})),
        ),
    ),
    Conversation(
        "stored-means-no-more-than-stored",
        "A mission that cannot be flown is ACCEPTED; only an EVENT and mission_state 1 tell",
        "mis 25 s",
        (
            Upload((waypoint(10), Item(22, z_m=15.0))),
            Event("navigator_mis_takeoff_not_first"),
            Mission({"total": 2, "mission_state": 1}),
        ),
    ),
    Conversation(
        "landing-first",
        "A mission that begins with a landing is ACCEPTED and not flown",
        "mis 26.5 s",
        (
            Upload((Item(21, 0, 0, 0.0),)),
            Event("navigator_mis_starts_w_landing"),
            Mission({"total": 1, "mission_state": 1}),
        ),
    ),
    _judged(
        "latitude-200",
        "Latitude 200 is ACCEPTED and counts as ready",
        "mis 14.5 s",
        waypoint(0, latitude_deg=200.0),
    ),
    _judged(
        "null-island",
        "0, 0 is ACCEPTED and counts as ready",
        "mis 16 s",
        waypoint(0, raw=(0, 0)),
    ),
    _judged(
        "altitude-nan",
        "An altitude that is no number is ACCEPTED and counts as ready",
        "mis 17.5 s",
        waypoint(20, 0, math.nan),
    ),
    _judged(
        "below-ground",
        "50 m below home is ACCEPTED and counts as ready",
        "mis 19 s",
        waypoint(20, 0, -50.0),
    ),
    _judged(
        "100-km-away",
        "100 km away is ACCEPTED and counts as ready",
        "mis 22 s",
        waypoint(100000.0),
    ),
    _judged(
        "jump-to-nowhere",
        "A DO_JUMP to an item that is not there is ACCEPTED and counts as ready",
        "mis 29.5 s",
        Item(177, frame=2, params=(99.0, 1.0, 0.0, 0.0), raw=(0, 0), z_m=0.0),
    ),
    Conversation(
        "mission-without-take-off",
        "A mission without a take-off is ACCEPTED and counts as ready",
        "mis 23.5 s",
        (Upload((waypoint(10), waypoint(20))), Mission({"total": 2, "mission_state": 2})),
    ),
    _refused(
        "terrain-frame",
        "Frame 10 is answered UNSUPPORTED_FRAME; the mission before stays",
        "mis 11.5 s",
        waypoint(20, frame=10),
        "UNSUPPORTED_FRAME",
    ),
    _refused(
        "local-frame",
        "Frame 1 is answered UNSUPPORTED_FRAME; the mission before stays",
        "mission protocol",
        waypoint(20, frame=1),
        "UNSUPPORTED_FRAME",
    ),
    _refused(
        "frame-2-on-a-waypoint",
        "Frame 2 on a waypoint is answered UNSUPPORTED",
        "mission protocol",
        waypoint(20, frame=2),
        "UNSUPPORTED",
    ),
    _refused(
        "unknown-item",
        "An item with a command that it does not know is answered UNSUPPORTED",
        "mis 13 s",
        Item(9999, 20),
        "UNSUPPORTED",
    ),
    _refused(
        "spline",
        "Spline waypoints are answered UNSUPPORTED",
        "mis 35.6 s",
        Item(82, 20),
        "UNSUPPORTED",
    ),
    Conversation(
        "too-long",
        "A count above its space, or a type that does not exist, is answered NO_SPACE",
        "mis 67 s, 69 s",
        (
            Say("MISSION_COUNT", {"count": 20000}),
            Hear("MISSION_ACK", {"type": 4, "mission_type": 0}),
            Say("MISSION_COUNT", {"count": 1, "mission_type": 7}),
            Hear("MISSION_ACK", {"type": 4, "mission_type": 7}),
        ),
    ),
    Conversation(
        "count-zero",
        "A count of 0 empties the plan and is ACCEPTED",
        "mis 40 s",
        (
            Upload(_GOOD),
            Mission(_LEFT),
            Upload(()),
            Mission({"total": 65535, "mission_state": 1}),
        ),
    ),
    Conversation(
        "upload-left-alone",
        "Left alone in an upload it repeats its request every 0.26 s for 5 s, then says so and "
        "sends no MISSION_ACK; the plan before stays",
        "mis 43 s",
        (
            Upload(_GOOD),
            Mission(_LEFT),
            Say("MISSION_COUNT", {"count": 3}),
            Requests(0, 4.6, 14, 22),
            Text("Operation timeout", 2.0),
            Event("mavlink_mission_op_timeout"),
            Silence("MISSION_ACK", 1.0),
            Mission(_LEFT),
        ),
    ),
    Conversation(
        "wrong-sequence",
        "An item with the wrong number is passed over; the right one is asked for again",
        "mis 51 s",
        (
            Say("MISSION_COUNT", {"count": 3}),
            Hear("MISSION_REQUEST_INT", {"seq": 0}),
            Say("MISSION_ITEM_INT", {"seq": 2, "frame": 6, "command": 16}),
            Requests(0, 1.2, 3, 8),
            Silence("MISSION_REQUEST_INT", 0.5, {"seq": 1}),
        ),
    ),
    Conversation(
        "item-as-float",
        "A MISSION_ITEM is taken; it goes on asking with MISSION_REQUEST",
        "mis 58 s",
        (
            Say("MISSION_COUNT", {"count": 3}),
            Hear("MISSION_REQUEST_INT", {"seq": 0}),
            Say("MISSION_ITEM", {"seq": 0, "frame": 3, "command": 22, "z": 10.0}),
            Requests(1, 1.2, 3, 8, name="MISSION_REQUEST"),
        ),
    ),
    Conversation(
        "download-without-thanks",
        "A download left without its last MISSION_ACK blocks uploads for 5 s: MISSION_ACK ERROR "
        "and a text; then they work again",
        "mis 5.5 s to 11.5 s",
        (
            Upload(_GOOD),
            Mission(_LEFT),
            Download(tuple({"command": item.command} for item in _GOOD), finished=False),
            Say("MISSION_COUNT", {"count": 2}),
            Hear("MISSION_ACK", {"type": 1}),
            Text("WPM: IGN MISSION_COUNT: Busy"),
            Event("mavlink_mission_ignore_mis_count"),
            Wait(5.5),
            Upload(_PAIR),
            Mission({"total": 2, "mission_state": 2}),
        ),
    ),
    Conversation(
        "requests-without-list",
        "Items that are asked for without MISSION_REQUEST_LIST are passed over in silence",
        "mis 71 s to 77 s",
        (
            Upload(_GOOD),
            Wait(1.0),
            Say("MISSION_REQUEST_INT", {"seq": 1}),
            Silence("MISSION_ITEM_INT", 1.0),
            Silence("MISSION_ACK", 0.5),
        ),
    ),
    Conversation(
        "unasked-item",
        "The last item once more, after the upload, is answered ACCEPTED",
        "mis 65 s",
        (
            Upload(_PAIR),
            Wait(0.5),
            Say("MISSION_ITEM_INT", {"seq": 1, "frame": 6, "command": 16}),
            Hear("MISSION_ACK", {"type": 0}),
        ),
    ),
    Conversation(
        "set-current-on-the-ground",
        "MISSION_SET_CURRENT has no answer; MISSION_CURRENT shows it. Out of range: a text only",
        "mis 77 s to 81 s",
        (
            Upload(_GOOD),
            Mission(_LEFT),
            SetCurrent(2),
            Silence("COMMAND_ACK", 0.2),
            Mission({"seq": 2, "total": 4, "mission_state": 2}),
            SetCurrent(77),
            Text("WPM: WP CURR CMD: Not in list"),
            Event("mavlink_mission_seq_out_of_bounds"),
            Mission({"seq": 2}),
        ),
    ),
    Conversation(
        "set-current-while-busy",
        "MISSION_SET_CURRENT while a download is under way is dropped, with a text only",
        "read in the source; measured",
        (
            Upload(_GOOD),
            Mission(_LEFT),
            Say("MISSION_REQUEST_LIST", {"mission_type": 0}),
            Hear("MISSION_COUNT", {"count": 4}),
            SetCurrent(2),
            Text("WPM: IGN WP CURR CMD: Busy"),
            Mission({"seq": 0}),
        ),
    ),
    Conversation(
        "clear",
        "MISSION_CLEAR_ALL is answered ACCEPTED; the count of an empty plan is 0, for a fence too",
        "mis 83 s to 89 s",
        (
            Upload(_GOOD),
            Mission(_LEFT),
            ClearAll(),
            Mission({"seq": 0, "total": 65535, "mission_state": 1}),
            Download(()),
            Download((), 1),
        ),
    ),
    Conversation(
        "same-plan-again",
        "MISSION_ACK carries the plan's id, which MISSION_CURRENT shows; another plan has another",
        "for a controller 10; mission_mavsdk4 7 s",
        (
            Upload(_GOOD),
            Mission(_LEFT),
            Upload(_PAIR),
            Mission({"total": 2, "fence_id": 0}),
        ),
    ),
    Conversation(
        "rally-points",
        "Rally points are taken and come back",
        "mission protocol",
        (
            Upload((Item(5100, 10, 0, 20.0, params=(0.0,) * 4),), 2),
            Download(({"command": 5100},), 2),
        ),
    ),
)
