"""Conversations about flight modes."""

from __future__ import annotations

from typing import Final

from sitl.conformance.conversation import Conversation, Start
from sitl.conformance.expectations import Event, Hear, InMode, Silence, StaysInMode, Text
from sitl.conformance.flight_steps import Arrives, Climb, Disarmed, Landed, Stays, Sticks
from sitl.conformance.plan_steps import Mission, Upload, waypoint
from sitl.conformance.steps import Command, Mark, Reposition, SetMode, Stop, Wait

CONVERSATIONS: Final = (
    Conversation(
        "every-mode-on-the-ground",
        "Disarmed, nearly every mode is ACCEPTED: Return, Land, Offboard without setpoints, "
        "Mission without a mission",
        "bad 6 s to 14 s",
        (
            SetMode("AUTO_RTL"),
            InMode("AUTO_RTL", armed=False, status=0),
            SetMode("AUTO_LAND"),
            InMode("AUTO_LAND", armed=False, status=0),
            SetMode("OFFBOARD"),
            InMode("OFFBOARD", armed=False, status=0, intended="OFFBOARD"),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION", armed=False),
            SetMode("AUTO_LOITER"),
            InMode("AUTO_LOITER", armed=False, status=3),
        ),
    ),
    Conversation(
        "bogus-modes",
        "A main mode that does not exist is ACCEPTED and nothing happens; an AUTO submode that "
        "does not exist is rejected",
        "bad 16 s to 18 s",
        (
            SetMode((99, 0)),
            SetMode((4, 77), "TEMPORARILY_REJECTED"),
            Event("commander_unsupported_auto_mode"),
            Text("Unsupported auto mode"),
            SetMode((4, 3), base_mode=0),
            StaysInMode("AUTO_LOITER", 2.0),
        ),
    ),
    Conversation(
        "mission-mode-without-mission-in-the-air",
        "In the air Mission without a mission is ACCEPTED first and TEMPORARILY_REJECTED then",
        "mode changes",
        (
            SetMode("AUTO_MISSION", "TEMPORARILY_REJECTED"),
            Event("commander_modeswitch_not_avail"),
            Text("Switching to Mission is currently not available"),
            StaysInMode("AUTO_LOITER", 2.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "offboard-without-setpoints-in-the-air",
        "In the air Offboard without setpoints is ACCEPTED first and TEMPORARILY_REJECTED then",
        "mode changes",
        (
            SetMode("OFFBOARD", "TEMPORARILY_REJECTED"),
            Event("commander_modeswitch_not_avail"),
            Text("Switching to Offboard is currently not available"),
            StaysInMode("AUTO_LOITER", 2.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "position-without-sticks-in-the-air",
        "In the air Position without a stick input is rejected",
        "mode changes",
        (
            SetMode("POSCTL", "TEMPORARILY_REJECTED"),
            Text("Switching to Position is currently not available"),
            StaysInMode("AUTO_LOITER", 2.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "mode-shows-late",
        "HEARTBEAT shows a mode with the next second, CURRENT_MODE with it or later",
        "mode changes; bad 7.7 s",
        (
            SetMode("AUTO_LAND"),
            Hear("HEARTBEAT", {"custom_mode": 4 << 16 | 6 << 24}, 1.6),
            Hear("CURRENT_MODE", {"custom_mode": 4 << 16 | 6 << 24}, 2.6),
        ),
    ),
    Conversation(
        "hold-stops-in-flight",
        "Hold out of a mission stops a little ahead and stays",
        "misc 88 s; measured",
        (
            Upload((waypoint(80), waypoint(80, 20))),
            Mission({"mission_state": 2}),
            SetMode("AUTO_MISSION"),
            Arrives(20, None, None, near_m=3.0),
            SetMode("AUTO_LOITER"),
            InMode("AUTO_LOITER"),
            Wait(6.0),
            Stays(5.0, 1.5),
        ),
        Start.AIR,
    ),
    Conversation(
        "return-from-afar",
        "Return climbs to 30 m above home first, then flies home",
        "timings; loss 70 s",
        (
            Reposition(40, 0, 15),
            Arrives(40, 0, None),
            SetMode("AUTO_RTL"),
            Event("vrtl_return_at"),
            InMode("AUTO_RTL"),
            Arrives(40, None, 30, near_m=4.0, within_s=20.0),
            Arrives(0, 0, 30, near_m=4.0, within_s=40.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "return-from-near",
        "Within 10 m of home Return does not climb to 30 m; it lands and disarms",
        "timings; off 49 s",
        (
            SetMode("AUTO_RTL"),
            Event("vrtl_return_at"),
            Event("rtl_land_at_destination", 15.0),
            Climb(3.0, -3.0, 0.3),
            Landed(60.0),
            Disarmed(5.0),
            InMode("AUTO_LOITER", armed=False),
        ),
        Start.AIR,
    ),
    Conversation(
        "no-arming-in-return-or-land",
        "In Return and Land it does not arm",
        "bad 6.7 s: status 0",
        (
            SetMode("AUTO_RTL"),
            InMode("AUTO_RTL", status=0),
            Command(400, (1,), ("TEMPORARILY_REJECTED",)),
            SetMode("AUTO_LAND"),
            InMode("AUTO_LAND", status=0),
            Command(400, (1,), ("TEMPORARILY_REJECTED",)),
        ),
    ),
    Conversation(
        "takeoff-by-mode",
        "Takeoff as a mode climbs 2.5 m and goes over into Hold",
        "bad 42 s to 50 s",
        (
            Command(400, (1,)),
            SetMode("AUTO_TAKEOFF"),
            Text("Using default takeoff altitude: 2.5 m"),
            Hear("EXTENDED_SYS_STATE", {"landed_state": 3}, 8.0),
            InMode("AUTO_LOITER", 15.0, armed=True),
            Hear("EXTENDED_SYS_STATE", {"landed_state": 2}, 2.0),
            Arrives(0, 0, 2.4, near_m=1.5),
        ),
    ),
    Conversation(
        "climb-speed",
        "A take-off climbs with 1.5 m/s",
        "timings",
        (
            Command(400, (1,)),
            Command(22, (*(float("nan"),) * 7,)),
            Wait(0.1),
            Silence("COMMAND_ACK", 0.5, {"result": 4}),
            Arrives(None, None, 1.0, near_m=0.3, within_s=10.0),
            Climb(4.0, 1.1, 1.75),
        ),
        parameters={"MIS_TAKEOFF_ALT": 12.0},
    ),
    Conversation(
        "position-mode-with-sticks",
        "With MANUAL_CONTROL coming in, Position is flown: sticks centred it stays, pitched it "
        "goes forward",
        "stick modes, measured",
        (
            Sticks(),
            Wait(1.0),
            SetMode("POSCTL"),
            InMode("POSCTL", armed=True, status=4),
            Wait(2.0),
            Stays(4.0, 1.5),
            Sticks(pitch=500),
            Arrives(10, None, None, near_m=4.0, within_s=20.0),
            Sticks(),
            Wait(4.0),
            Stays(4.0, 1.5),
        ),
        Start.AIR,
    ),
    Conversation(
        "altitude-mode-with-sticks",
        "With MANUAL_CONTROL coming in, Altitude is flown: throttle up climbs",
        "stick modes, measured",
        (
            Sticks(),
            Wait(1.0),
            SetMode("ALTCTL"),
            InMode("ALTCTL", armed=True, status=4),
            Wait(2.0),
            Sticks(throttle=800),
            Wait(1.5),
            Climb(3.0, 0.8, 3.2),
        ),
        Start.AIR,
    ),
    Conversation(
        "moved-sticks-take-over",
        "Moving the sticks in Hold takes the vehicle over into Position",
        "stick modes, measured",
        (
            Sticks(),
            Wait(2.0),
            Mark(),
            Sticks(pitch=900),
            InMode("POSCTL", 3.0, intended="POSCTL"),
        ),
        Start.AIR,
    ),
    Conversation(
        "lost-sticks",
        "When MANUAL_CONTROL stops in Position the vehicle returns by itself",
        "stick modes, measured: NAV_RCL_ACT 2",
        (
            Sticks(),
            Wait(1.0),
            SetMode("POSCTL"),
            InMode("POSCTL"),
            Stop(),
            InMode("AUTO_LOITER", 4.0, status=5, intended="POSCTL"),
            InMode("AUTO_RTL", 8.0, status=5, intended="POSCTL"),
        ),
        Start.AIR,
        {"COM_RC_LOSS_T": 0.5},
    ),
)
