"""Conversations about what it does by itself: lost links, an empty battery."""

from __future__ import annotations

from typing import Final

from sitl.conformance.conversation import Conversation, Start
from sitl.conformance.expectations import Event, InMode, StaysInMode, Text
from sitl.conformance.flight_steps import Arrives, Landed
from sitl.conformance.line import Link
from sitl.conformance.parameter_steps import SetParameter
from sitl.conformance.plan_steps import Mission, Upload, waypoint
from sitl.conformance.steps import (
    Beats,
    Command,
    Mark,
    Reposition,
    SetMode,
    Step,
    Wait,
)

_GROUND_STATION = (6, 255, 190)
_ALONE: tuple[Step, ...] = (Mark(), Beats(None), Beats(None, Link.GROUND))
_BATTERY = {"SIM_BAT_MIN_PCT": 0.0, "COM_FAIL_ACT_T": 5.0}
_LINK = {"COM_DL_LOSS_T": 10, "COM_FAIL_ACT_T": 5.0}

CONVERSATIONS: Final = (
    Conversation(
        "ground-station-lost",
        "With NAV_DLL_ACT 0 a lost ground station is only an EVENT, 12 s after its last heartbeat",
        "loss 22 s to 48 s",
        (
            *_ALONE,
            Event("commander_gcs_lost", 14.0),
            StaysInMode("AUTO_LOITER", 8.0),
            Mark(),
            Beats(_GROUND_STATION),
            Event("commander_dl_regained", 3.0),
        ),
        Start.AIR,
        _LINK,
    ),
    Conversation(
        "ground-station-lost-returns",
        "With NAV_DLL_ACT 2: 12 s after the last heartbeat Hold for 5 s, then Return; heartbeats "
        "do not end it, a mode command does",
        "loss 52 s to 83 s",
        (
            *_ALONE,
            Event("commander_gcs_lost", 14.0),
            Event("commander_failsafe_enter_hold"),
            InMode("AUTO_LOITER", status=5),
            InMode("AUTO_RTL", 8.0, status=5, intended="AUTO_LOITER"),
            Beats(_GROUND_STATION),
            Wait(2.0),
            StaysInMode("AUTO_RTL", 3.0),
            SetMode("AUTO_LOITER"),
            InMode("AUTO_LOITER", status=4),
        ),
        Start.AIR,
        _LINK | {"NAV_DLL_ACT": 2},
    ),
    Conversation(
        "ground-station-lost-in-a-mission",
        "A mission that a lost link interrupted goes on at its index when it is commanded again",
        "link loss",
        (
            Upload((waypoint(60, autocontinue=False), waypoint(60, 30, autocontinue=False))),
            Mission({"mission_state": 2}),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION"),
            *_ALONE,
            InMode("AUTO_RTL", 24.0, status=5, intended="AUTO_MISSION"),
            Beats(_GROUND_STATION),
            Wait(1.0),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION", status=4),
            Mission({"seq": 0, "mission_state": 3}),
        ),
        Start.AIR,
        _LINK | {"NAV_DLL_ACT": 2},
    ),
    Conversation(
        "no-arming-without-ground-station",
        "With NAV_DLL_ACT 2 it does not arm without a ground station's heartbeat",
        "loss 134 s to 152 s",
        (
            Beats(None, Link.GROUND),
            Beats(None),
            Wait(14.0),
            Command(400, (1,), ("TEMPORARILY_REJECTED",)),
            Event("commander_arm_denied_resolve_failures"),
            Beats(_GROUND_STATION),
            Wait(4.0),
            Command(400, (1,)),
        ),
        parameters=_LINK | {"NAV_DLL_ACT": 2},
    ),
    Conversation(
        "battery-low",
        "At 15 % there is only a warning",
        "battery",
        (
            Text("Low battery", 40.0),
            StaysInMode("AUTO_LOITER", 1.0),
        ),
        Start.AIR,
        _BATTERY | {"SIM_BAT_DRAIN": 42.0},
    ),
    Conversation(
        "battery-critical",
        "At 7 % it holds for 5 s and returns",
        "battery",
        (
            Reposition(25, 0, 15),
            Text("Critical battery", 60.0),
            InMode("AUTO_LOITER", status=5),
            InMode("AUTO_RTL", 8.0, status=5),
        ),
        Start.AIR,
        _BATTERY | {"SIM_BAT_DRAIN": 400.0, "BAT_LOW_THR": 0.93, "BAT_CRIT_THR": 0.9},
    ),
    Conversation(
        "battery-emergency",
        "At 5 % it lands where it is",
        "battery",
        (
            Reposition(25, 0, 15),
            Text("Emergency battery level", 60.0),
            InMode("AUTO_LAND", 8.0, status=5),
            Arrives(25, 0, None, near_m=12.0),
        ),
        Start.AIR,
        _BATTERY
        | {
            "SIM_BAT_DRAIN": 400.0,
            "BAT_LOW_THR": 0.92,
            "BAT_CRIT_THR": 0.905,
            "BAT_EMERGEN_THR": 0.9,
        },
    ),
    Conversation(
        "battery-does-not-forbid-arming",
        "It arms with an empty battery, COM_ARM_BAT_MIN being -1",
        "battery; loss 426 s",
        (Command(400, (1,)),),
        parameters={"BAT_LOW_THR": 1.2},
    ),
    Conversation(
        "position-lost",
        "Five seconds without satellites no mode that needs a position can be flown: it descends "
        "where it drifts, shown as Land; with satellites again it goes on by itself",
        "measured",
        (
            Upload((waypoint(120, autocontinue=False), waypoint(120, 30))),
            Mission({"mission_state": 2}),
            SetMode("AUTO_MISSION"),
            InMode("AUTO_MISSION"),
            Wait(4.0),
            SetParameter("SIM_GPS_USED", 0),
            StaysInMode("AUTO_MISSION", 2.0),
            Mark(),
            InMode("AUTO_LAND", 8.0, status=5, intended="AUTO_MISSION"),
            Event("commander_failsafe_enter_autopilot_disengaged"),
            Text("Failsafe activated"),
            SetMode("AUTO_RTL", "TEMPORARILY_REJECTED"),
            Event("check_estimator_gnss_fusion_stopped", 8.0),
            SetParameter("SIM_GPS_USED", 10),
            Mark(),
            InMode("AUTO_MISSION", 6.0, status=4),
            Event("check_estimator_gnss_fusion_started"),
        ),
        Start.AIR,
    ),
    Conversation(
        "position-lost-while-landing",
        "A landing goes on without satellites, as the failsafe's after five seconds; it stays in "
        "Land, lands and disarms",
        "measured",
        (
            SetMode("AUTO_LAND"),
            InMode("AUTO_LAND"),
            SetParameter("SIM_GPS_USED", 0),
            Mark(),
            InMode("AUTO_LAND", 8.0, status=5),
            StaysInMode("AUTO_LAND", 2.0),
            Landed(60.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "return-can-be-taken-over",
        "A failsafe ends with a mode command; the same cause does nothing more",
        "link loss; for a controller 4",
        (
            Reposition(30, 0, 15),
            Text("Critical battery", 60.0),
            InMode("AUTO_RTL", 12.0, status=5),
            SetMode("AUTO_LOITER"),
            Event("failsafe_rc_override"),
            StaysInMode("AUTO_LOITER", 6.0),
            SetMode("AUTO_LAND"),
            Landed(60.0),
        ),
        Start.AIR,
        _BATTERY | {"SIM_BAT_DRAIN": 400.0, "BAT_LOW_THR": 0.93, "BAT_CRIT_THR": 0.9},
    ),
)
