"""Conversations about commands, on the ground and in the air."""

from __future__ import annotations

import math
from typing import Final

from sitl.conformance.conversation import Conversation, Start
from sitl.conformance.expectations import Event, Hear, InMode, Silence, StaysInMode, Text
from sitl.conformance.flight_steps import Arrives, Climb, Disarmed, Landed, Speed, Stays
from sitl.conformance.steps import Command, Reposition, Say, SetMode, Wait

_NAN = math.nan

ON_GROUND: Final = (
    Conversation(
        "arming-before-it-is-healthy",
        "Armed before its checks pass it answers TEMPORARILY_REJECTED and says why",
        "commands: arm before healthy",
        (
            Hear("HEARTBEAT", {"system_status": 0}, 5.0),
            Command(400, (1,), ("TEMPORARILY_REJECTED",)),
            Event("commander_arm_denied_resolve_failures"),
            Text("Arming denied: Resolve system health failures first"),
        ),
        start=Start.BOOT,
    ),
    Conversation(
        "identity-and-first-words",
        "HEARTBEAT is type 2, autopilot 12; status 0 until it can arm, 3 after; HOME_POSITION "
        "comes in the first seconds",
        "timings; mission_mavsdk4 0.9 s",
        (
            Hear("HEARTBEAT", {"type": 2, "autopilot": 12, "system_status": 0}, 4.0),
            Hear("HOME_POSITION", {}, 6.0),
            Hear("HEARTBEAT", {"system_status": 3}, 12.0),
            Hear("EXTENDED_SYS_STATE", {"landed_state": 1}, 2.0),
        ),
        start=Start.BOOT,
    ),
    Conversation(
        "checks-asked-for",
        "MAV_CMD_RUN_PREARM_CHECKS is ACCEPTED, and the health and arming report comes anew",
        "PX4's source: Commander, HealthAndArmingChecks",
        (
            Wait(4.0),
            Command(401, ()),
            Event("commander_arming_check_summary"),
            Event("commander_health_summary"),
        ),
    ),
    Conversation(
        "arm-twice",
        "Arming an armed vehicle is ACCEPTED; so is disarming a disarmed one",
        "bad 33 s, 40 s",
        (
            Command(400, (0,)),
            Command(400, (1,)),
            Event("commander_armed_by", arguments=b"\x04"),
            InMode("AUTO_LOITER", armed=True, status=4),
            Command(400, (1,)),
            Command(400, (0,)),
            Event("commander_disarmed_by", arguments=b"\x04"),
            InMode("AUTO_LOITER", armed=False, status=3),
        ),
    ),
    Conversation(
        "no-take-off-no-arms",
        "Armed without a take-off it disarms itself after 10 s, and says so",
        "misc 3.8 s: 11.1 s with the heartbeat's second",
        (
            Command(400, (1,)),
            InMode("AUTO_LOITER", armed=True),
            Disarmed(13.0, not_before_s=8.5),
            Event("commander_disarmed_by", arguments=b"\x07"),
            Text("Disarmed by auto preflight disarming"),
        ),
    ),
    Conversation(
        "unknown-commands",
        "A command that it does not know is UNSUPPORTED",
        "bad 20 s",
        (
            Command(31999, (), ("UNSUPPORTED",)),
            Command(9, (), ("UNSUPPORTED",)),
        ),
    ),
    Conversation(
        "mission-item-by-command",
        "PX4 1.17 does not know DO_SET_MISSION_CURRENT as a command",
        "mis 81 s, 82 s",
        (
            Command(224, (1,), ("UNSUPPORTED",)),
            Command(224, (77,), ("UNSUPPORTED",)),
        ),
        until=(1, 17),
    ),
    Conversation(
        "pause-and-continue",
        "DO_PAUSE_CONTINUE is UNSUPPORTED",
        "commands",
        (Command(193, (0,), ("UNSUPPORTED",)), Command(193, (1,), ("UNSUPPORTED",))),
    ),
    Conversation(
        "commands-for-others",
        "A command for another system or component, or for system 0, gets no answer at all; "
        "component 0 is fine",
        "bad 22 s to 26 s",
        (
            Command(512, (148,), (), target=(7, 1)),
            Command(512, (148,), (), target=(0, 0)),
            Command(512, (148,), (), target=(1, 33)),
            Command(512, (148,), target=(1, 0)),
            Hear("AUTOPILOT_VERSION"),
        ),
    ),
    Conversation(
        "message-on-request",
        "REQUEST_MESSAGE of a message that it has not is DENIED",
        "bad 26 s",
        (
            Command(512, (9999,), ("DENIED",)),
            Command(512, (242,)),
            Hear("HOME_POSITION", within_s=1.0),
        ),
    ),
    Conversation(
        "message-interval",
        "SET_MESSAGE_INTERVAL of a known message is ACCEPTED, of an unknown one FAILED",
        "bad 27 s",
        (Command(511, (33, 200000)), Command(511, (9999, 200000), ("FAILED",))),
    ),
    Conversation(
        "failure-injection",
        "INJECT_FAILURE gets no answer",
        "commands",
        (Command(420, (0, 0), ()),),
    ),
    Conversation(
        "no-shutdown-asked",
        "PREFLIGHT_REBOOT_SHUTDOWN with 0 is ACCEPTED and does nothing",
        "bad 36 s",
        (Command(246, (0,)), StaysInMode("AUTO_LOITER", 2.0)),
    ),
    Conversation(
        "termination-on-the-ground",
        "DO_FLIGHTTERMINATION of a disarmed vehicle is DENIED",
        "bad 34 s",
        (Command(185, (1,), ("DENIED",)), Command(185, (0,), ("DENIED",))),
    ),
    Conversation(
        "home-by-command",
        "DO_SET_HOME to the present place is ACCEPTED",
        "bad 31 s",
        (Command(179, (1,)), Hear("HOME_POSITION", {}, 3.0)),
    ),
    Conversation(
        "speed-on-the-ground",
        "DO_CHANGE_SPEED is ACCEPTED even on the ground",
        "bad 32 s",
        (Command(178, (1, 3, -1)),),
    ),
    Conversation(
        "goto-on-the-ground",
        "DO_REPOSITION is ACCEPTED while disarmed, whatever its frame; nothing moves",
        "bad 29 s, 30 s",
        (
            Reposition(20, 0, 15),
            Reposition(20, 0, raw_z_m=15, frame=6),
            InMode("AUTO_LOITER", armed=False),
            Stays(2.0, 1.0),
        ),
    ),
    Conversation(
        "goto-without-mode-change",
        "DO_REPOSITION without the change-mode flag is UNSUPPORTED",
        "commands",
        (Reposition(20, 0, 15, flags=0, answers=("UNSUPPORTED",)),),
    ),
    Conversation(
        "take-off-then-arm",
        "NAV_TAKEOFF of a disarmed vehicle is ACCEPTED and only changes the mode; armed then, it "
        "takes off without another word",
        "bad 3.3 s; disarmed",
        (
            Command(22, (*(_NAN,) * 7,)),
            InMode("AUTO_TAKEOFF", armed=False),
            Command(400, (1,)),
            Text("Using default takeoff altitude: 2.5 m"),
            Event("navigator_takeoff_default_alt"),
            Event("commander_takeoff_detected", 8.0),
            InMode("AUTO_LOITER", 15.0, armed=True),
        ),
    ),
    Conversation(
        "mission-start-without-mission",
        "MISSION_START without a mission is DENIED, and said in words and as an event",
        "bad 15.3 s",
        (
            Command(300, (), ("DENIED",)),
            Event("commander_mission_start_denied_no_mission"),
            Text("Mission start denied! No valid mission"),
        ),
    ),
    Conversation(
        "set-mode-message",
        "The old SET_MODE message gets one answer",
        "mode changes; bad 37 s",
        (
            Say(
                "SET_MODE",
                {"base_mode": 1, "custom_mode": 4 << 16 | 3 << 24},
                targeted=False,
            ),
            Wait(0.1),
        ),
    ),
)

IN_AIR: Final = (
    Conversation(
        "disarm-in-the-air",
        "Disarming in the air is TEMPORARILY_REJECTED, and it flies on",
        "bad 46.3 s",
        (
            Command(400, (0,), ("TEMPORARILY_REJECTED",)),
            Event("commander_disarm_denied_not_landed"),
            Text("Disarming denied: not landed"),
            StaysInMode("AUTO_LOITER", 3.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "goto",
        "DO_REPOSITION flies to a place in Hold and stays there",
        "fence 79 s",
        (
            Reposition(30, 10, 15),
            Arrives(30, 10, None),
            Wait(4.0),
            Stays(5.0, 1.5),
            InMode("AUTO_LOITER"),
        ),
        Start.AIR,
    ),
    Conversation(
        "hold-does-not-end-a-goto",
        "A goto is flown in Hold: Hold asked for while it flies is ACCEPTED and changes nothing",
        "measured",
        (
            Reposition(60, 0, 15),
            Arrives(15, None, None, near_m=3.0),
            SetMode("AUTO_LOITER"),
            Wait(2.0),
            Speed(3.0, 3.0, 6.0),
            Arrives(60, 0, None, near_m=3.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "goto-nowhere-ends-a-goto",
        "DO_REPOSITION without a place, while a goto is flown, brakes and stays",
        "measured",
        (
            Reposition(60, 0, 15),
            Arrives(15, None, None, near_m=3.0),
            Reposition(None),
            Wait(5.0),
            Stays(4.0, 1.5),
        ),
        Start.AIR,
    ),
    Conversation(
        "goto-nowhere-ends-a-goto-that-has-not-begun",
        "DO_REPOSITION without a place stops a vehicle that stands still and was just sent away",
        "measured",
        (
            Reposition(60, 0, 15),
            Reposition(None),
            Wait(6.0),
            Stays(4.0, 1.5),
            Arrives(0, 0, None, near_m=5.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "goto-height-alone-goes-on",
        "DO_REPOSITION with an altitude and no place, while a goto is flown, flies on to its place",
        "measured",
        (
            Reposition(40, 0, 15),
            Arrives(15, None, None, near_m=3.0),
            Reposition(None, 0, 20),
            Arrives(40, 0, 20, near_m=3.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "goto-keeps-height-and-place",
        "DO_REPOSITION with a NaN altitude keeps the height, without a place keeps the place",
        "commands",
        (
            Reposition(15, 0, _NAN),
            Arrives(15, 0, 15, near_m=3.0),
            Reposition(None, 0, 20),
            Arrives(15, 0, 20, near_m=3.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "goto-is-above-sea-level",
        "DO_REPOSITION's altitude is above mean sea level even in the frame above home: 20 in "
        "frame 6 descends",
        "commands",
        (
            Reposition(0, 0, raw_z_m=20, frame=6),
            Wait(1.0),
            Climb(3.0, -3.0, -0.5),
        ),
        Start.AIR,
    ),
    Conversation(
        "goto-without-range-check",
        "A latitude of 200 degrees is ACCEPTED and flown to",
        "commands",
        (Reposition(0, 0, 15, latitude_deg=200.0), StaysInMode("AUTO_LOITER", 1.0)),
        Start.AIR,
    ),
    Conversation(
        "landing",
        "NAV_LAND lands where it is; 2 s after the touch-down it disarms and is in Hold again",
        "bad 53 s",
        (
            Command(21, (*(_NAN,) * 7,)),
            Event("commander_landing_current_pos"),
            InMode("AUTO_LAND", armed=True),
            Hear("MISSION_CURRENT", {"mission_mode": 1}, 2.5),
            Landed(60.0),
            Event("commander_landing_detected"),
            Disarmed(4.5, not_before_s=0.5),
            Event("commander_disarmed_by", arguments=b"\x06"),
            InMode("AUTO_LOITER", armed=False, status=3),
        ),
        Start.AIR,
    ),
    Conversation(
        "landing-speed",
        "The last metres of a landing are flown with 0.7 m/s",
        "timings",
        (
            Command(21, (*(_NAN,) * 7,)),
            Arrives(None, None, 4.6, near_m=0.3, within_s=40.0),
            Climb(4.5, -0.9, -0.5),
        ),
        Start.AIR,
    ),
    Conversation(
        "cameras-are-stopped-on-landing",
        "It sends COMMAND_LONG itself, 1001 and 1000 (gimbal), several times, when it begins to "
        "land",
        "bad 53.6 s, misc 176.4 s",
        (
            SetMode("AUTO_LAND"),
            Hear("COMMAND_LONG", {"command": 1001, "target_component": 0}, 3.0, times=3),
            Hear("COMMAND_LONG", {"command": 1000, "target_component": 0}, 3.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "orbit",
        "DO_ORBIT is ACCEPTED and shows as a submode of Position",
        "commands",
        (
            Command(34, (15, 3, 0, _NAN, _NAN, _NAN, _NAN)),
            Hear("HEARTBEAT", {"custom_mode": 3 << 16 | 1 << 24}, 2.5),
        ),
        Start.AIR,
    ),
    Conversation(
        "termination-in-the-air",
        "DO_FLIGHTTERMINATION in the air stops the motors for good; no mode can be had any more",
        "loss 215 s",
        (
            Command(185, (1,)),
            Hear("HEARTBEAT", {"system_status": 8}, 3.0),
            SetMode("AUTO_LOITER", "TEMPORARILY_REJECTED"),
            Text("Switching to Hold is currently not available"),
        ),
        Start.AIR,
    ),
    Conversation(
        "first-answer-is-no-news",
        "A command that is understood is answered once, within 15 ms or so",
        "timings",
        (Command(512, (148,), within_s=0.5), Silence("COMMAND_ACK", 1.0, {"command": 511})),
        Start.AIR,
    ),
)

CONVERSATIONS: Final = ON_GROUND + IN_AIR
