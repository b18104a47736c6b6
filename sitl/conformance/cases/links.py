"""Conversations about links: rates, texts, parameters, who is heard."""

from __future__ import annotations

from typing import Final

from sitl.conformance.conversation import Conversation, Start
from sitl.conformance.expectations import Event, Hear, InMode, Silence, Text
from sitl.conformance.line import Link
from sitl.conformance.parameter_steps import (
    REAL32,
    ListParameters,
    Rates,
    ReadParameter,
    SetParameter,
)
from sitl.conformance.steps import (
    Beats,
    Command,
    Mark,
    Reposition,
    Say,
    SetMode,
    Wait,
)

_BOTH = frozenset(Link)
_COMPANION = (18, 0, 191)

CONVERSATIONS: Final = (
    Conversation(
        "api-rates",
        "The API link's rates, client or not",
        "observed rates",
        (
            Rates(
                {
                    "HEARTBEAT": (0.8, 1.2),
                    "GLOBAL_POSITION_INT": (42, 55),
                    "LOCAL_POSITION_NED": (25, 34),
                    "ATTITUDE_QUATERNION": (42, 55),
                    "SYS_STATUS": (4, 6),
                    "BATTERY_STATUS": (0.3, 0.7),
                    "GPS_RAW_INT": (4, 10),
                    "EXTENDED_SYS_STATE": (4, 6),
                    "HOME_POSITION": (0.3, 0.7),
                    "CURRENT_MODE": (0.3, 0.7),
                    "MISSION_CURRENT": (0.7, 1.3),
                    "VFR_HUD": (8, 12),
                    "ALTITUDE": (8, 12),
                    "SYSTEM_TIME": (0.7, 1.3),
                    "TIMESYNC": (8, 12),
                    "ODOMETRY": (25, 34),
                    "HIGHRES_IMU": (40, 55),
                    "SERVO_OUTPUT_RAW": (8, 12),
                }
            ),
        ),
    ),
    Conversation(
        "ground-station-rates",
        "The ground station link's rates",
        "observed rates",
        (
            Rates(
                {
                    "HEARTBEAT": (0.8, 1.2),
                    "GLOBAL_POSITION_INT": (42, 55),
                    "LOCAL_POSITION_NED": (42, 55),
                    "SYS_STATUS": (0.7, 1.3),
                    "BATTERY_STATUS": (0.3, 0.7),
                    "GPS_RAW_INT": (0.7, 6),
                    "EXTENDED_SYS_STATE": (0.7, 1.3),
                    "VFR_HUD": (3, 5),
                    "ALTITUDE": (0.7, 1.3),
                },
                link=Link.GROUND,
            ),
        ),
        links=_BOTH,
    ),
    Conversation(
        "setpoint-rates-in-the-air",
        "In the air POSITION_TARGET_LOCAL_NED comes ten times a second on the API link",
        "observed rates",
        (
            Rates(
                {"POSITION_TARGET_LOCAL_NED": (8, 12), "POSITION_TARGET_GLOBAL_INT": (8, 12)}, 5.0
            ),
        ),
        Start.AIR,
    ),
    Conversation(
        "texts-need-a-ground-station",
        "A companion gets no STATUSTEXT, but every EVENT",
        "text; for a controller 7",
        (
            Beats(_COMPANION),
            Wait(4.0),
            Command(400, (1,)),
            Event("commander_armed_by"),
            Silence("STATUSTEXT", 2.0),
            Command(400, (0,)),
        ),
    ),
    Conversation(
        "texts-to-the-other-link",
        "A ground station on the other link gets the text at the same time",
        "text",
        (
            Beats(_COMPANION),
            Wait(4.0),
            Command(400, (1,)),
            Text("Armed by external command", link=Link.GROUND),
            Silence("STATUSTEXT", 1.0),
            Command(400, (0,)),
        ),
        links=_BOTH,
    ),
    Conversation(
        "old-news-are-dropped",
        "A text is kept for 5 s for a ground station that comes, not longer",
        "text",
        (
            Beats(None),
            Wait(4.0),
            Command(400, (1,)),
            Mark(),
            Wait(7.0),
            Beats((6, 255, 190)),
            Silence("STATUSTEXT", 3.0, {"text": "Armed by external command\t"}),
            Command(400, (0,)),
        ),
    ),
    Conversation(
        "long-texts-come-in-pieces",
        "A text of more than 50 characters comes in pieces with one id",
        "text; loss 75 s",
        (
            Reposition(30, 0, 15),
            Wait(8.0),
            SetMode("AUTO_RTL"),
            Hear("STATUSTEXT", {"chunk_seq": 1}, 3.0),
            Text("RTL: start return at"),
        ),
        Start.AIR,
    ),
    Conversation(
        "companion-words-are-passed-on",
        "A STATUSTEXT of component 191 comes out on the ground station's link",
        "for a controller 8",
        (
            Beats(_COMPANION),
            Wait(2.0),
            Say(
                "STATUSTEXT",
                {"severity": 5, "text": b"air_router: SEARCH titan"},
                targeted=False,
            ),
            Hear("STATUSTEXT", {"text": "air_router: SEARCH titan"}, 2.0, Link.GROUND),
        ),
        links=_BOTH,
    ),
    Conversation(
        "companion-lost",
        "A companion that falls silent is said to be lost after COM_OBC_LOSS_T; nothing else "
        "happens",
        "for a controller 9",
        (
            Beats(_COMPANION),
            Wait(3.0),
            Mark(),
            Beats(None),
            Event("commander_mission_comp_lost", 10.0),
            InMode("AUTO_LOITER", status=4),
            Beats(_COMPANION),
            Event("commander_onboard_ctrl_regained", 4.0),
        ),
        Start.AIR,
        {"COM_OBC_LOSS_T": 5.0},
    ),
    Conversation(
        "parameter-list",
        "All parameters that are in use (887 here) come within a second; the first is _HASH_CHECK",
        "parameters; measured",
        (
            ListParameters(
                880,
                2.5,
                (
                    *(
                        "GF_ACTION",
                        "NAV_ACC_RAD",
                        "NAV_DLL_ACT",
                        "COM_OBC_LOSS_T",
                        "RTL_RETURN_ALT",
                    ),
                    *("MPC_XY_CRUISE", "MPC_XY_VEL_MAX", "COM_LOW_BAT_ACT", "MIS_TAKEOFF_ALT"),
                    *("COM_OF_LOSS_T", "COM_OBL_RC_ACT", "BAT_LOW_THR", "SYS_AUTOSTART"),
                ),
            ),
        ),
    ),
    Conversation(
        "parameter-refusals-are-silent",
        "An unknown name or a wrong type gets no answer at all",
        "parameters; bad 38.7 s",
        (
            SetParameter("NO_SUCH_PARAM", 1, 0),
            SetParameter("NAV_DLL_ACT", 2.0, 0, as_type=REAL32),
            ReadParameter("NO_SUCH_PARAM", None),
            ReadParameter("NAV_DLL_ACT", 0),
        ),
    ),
    Conversation(
        "parameter-without-range",
        "A value out of range is stored; a change is answered twice, no change once",
        "parameters; bad 39.5 s",
        (
            SetParameter("GF_ACTION", 99, 2),
            ReadParameter("GF_ACTION", 99),
            SetParameter("GF_ACTION", 2, 2),
            SetParameter("GF_ACTION", 2, 1),
            SetParameter("NAV_ACC_RAD", 3.5, 2),
            ReadParameter("NAV_ACC_RAD", 3.5),
        ),
    ),
    Conversation(
        "parameter-defaults",
        "The defaults that a controller reckons with",
        "parameters that had to be set: none",
        (
            ReadParameter("GF_ACTION", 2),
            ReadParameter("NAV_DLL_ACT", 0),
            ReadParameter("COM_LOW_BAT_ACT", 3),
            ReadParameter("COM_RC_IN_MODE", 1),
            ReadParameter("MPC_XY_CRUISE", 5.0),
            ReadParameter("RTL_RETURN_ALT", 30.0),
            ReadParameter("MIS_TAKEOFF_ALT", 2.5),
            ReadParameter("NAV_ACC_RAD", 2.0),
        ),
    ),
    Conversation(
        "ping-and-time",
        "PING is answered, TIMESYNC too",
        "protocol",
        (
            Say("PING", {"time_usec": 12345, "seq": 7, "target_system": 0, "target_component": 0}),
            Hear("PING", {"time_usec": 12345, "seq": 7}, 2.0),
        ),
    ),
)
