"""Conversations about Offboard mode."""

from __future__ import annotations

import math
from typing import Final

from sitl.conformance.conversation import Conversation, Start
from sitl.conformance.expectations import Event, InMode, StaysInMode, Text
from sitl.conformance.flight_steps import (
    LOCAL_VELOCITY,
    NOTHING,
    Arrives,
    GlobalSetpoints,
    Landed,
    Setpoints,
    Speed,
)
from sitl.conformance.steps import (
    Command,
    Mark,
    Reposition,
    SetMode,
    Step,
    Stop,
    Wait,
)

_ENTER: tuple[Step, ...] = (
    Setpoints(0, 0, 15),
    Wait(0.5),
    SetMode("OFFBOARD"),
    InMode("OFFBOARD", status=4, intended="OFFBOARD"),
)


def _lost(action: int, name: str, mode: str, at: str) -> Conversation:
    return Conversation(
        f"setpoints-lost-{name}",
        f"With COM_OBL_RC_ACT {action} the loss of setpoints changes to {mode}; when they come "
        "again it is in Offboard by itself",
        at,
        (
            *_ENTER,
            Stop(),
            Mark(),
            Text("Failsafe activated", 4.0),
            Event("commander_failsafe_enter_generic"),
            InMode(mode, 3.0, status=5, intended="OFFBOARD"),
            Wait(2.0),
            Setpoints(0, 0, 15),
            InMode("OFFBOARD", 4.0, status=4),
        ),
        Start.AIR,
        {"COM_OBL_RC_ACT": action, "COM_OF_LOSS_T": 1.0},
    )


def _bad(name: str, fact: str, at: str, setpoints: Setpoints, event: str) -> Conversation:
    return Conversation(
        name,
        fact,
        at,
        (*_ENTER, setpoints, Mark(), Event(event), InMode("AUTO_RTL", 4.0, status=5)),
        Start.AIR,
        {"COM_OF_LOSS_T": 1.0},
    )


CONVERSATIONS: Final = (
    Conversation(
        "offboard-from-the-ground",
        "Setpoints, Offboard, armed: it takes off and flies there",
        "off 3.7 s",
        (
            Setpoints(0, 0, 10),
            Wait(1.0),
            SetMode("OFFBOARD"),
            InMode("OFFBOARD", armed=False, status=3),
            Command(400, (1,)),
            InMode("OFFBOARD", armed=True, status=4),
            Event("commander_takeoff_detected", 8.0),
            Arrives(0, 0, 10, near_m=2.0, within_s=20.0),
        ),
    ),
    Conversation(
        "offboard-position",
        "Local positions are flown to",
        "off 61 s",
        (*_ENTER, Setpoints(10, 8, 12), Arrives(10, 8, 12, near_m=2.0, within_s=15.0)),
        Start.AIR,
    ),
    Conversation(
        "offboard-velocity",
        "Local velocities are flown",
        "off 73 s",
        (
            *_ENTER,
            Setpoints(2, 0, 0, mask=LOCAL_VELOCITY),
            Wait(3.0),
            Speed(4.0, 1.6, 2.4),
            InMode("OFFBOARD"),
        ),
        Start.AIR,
    ),
    Conversation(
        "offboard-body-velocity",
        "Velocities in frame 8 are forward and right of the nose",
        "off 76 s",
        (
            *_ENTER,
            Setpoints(2, 0, 0, mask=LOCAL_VELOCITY, frame=8),
            Wait(3.0),
            Speed(3.0, 1.6, 2.4),
            InMode("OFFBOARD"),
        ),
        Start.AIR,
    ),
    Conversation(
        "offboard-two-hertz",
        "Two setpoints a second are enough, one is not",
        "off 28 s to 41 s",
        (
            *_ENTER,
            Setpoints(0, 0, 15, rate_hz=2.0),
            StaysInMode("OFFBOARD", 6.0),
            Setpoints(0, 0, 15, rate_hz=0.8),
            Mark(),
            Text("Failsafe activated", 8.0),
        ),
        Start.AIR,
        {"COM_OF_LOSS_T": 1.0},
    ),
    Conversation(
        "one-setpoint-is-enough-to-enter",
        "A single setpoint right before the request is enough for Offboard",
        "Offboard",
        (
            Setpoints(0, 0, 15, rate_hz=0.01),
            Wait(0.1),
            SetMode("OFFBOARD"),
        ),
        Start.AIR,
        {"COM_OF_LOSS_T": 2.0},
    ),
    _lost(0, "return", "AUTO_RTL", "off 46 s; loss 165 s"),
    _lost(3, "return-3", "AUTO_RTL", "loss 178 s"),
    _lost(4, "land", "AUTO_LAND", "loss 190 s"),
    _lost(5, "hold", "AUTO_LOITER", "loss 202 s"),
    Conversation(
        "setpoints-lost-terminate",
        "With COM_OBL_RC_ACT 6 the loss of setpoints stops the motors, for good",
        "loss 214 s to 231 s",
        (
            *_ENTER,
            Stop(),
            Mark(),
            Text("Failsafe activated", 4.0),
            Wait(2.0),
            Setpoints(0, 0, 15),
            Wait(2.0),
            SetMode("OFFBOARD", "TEMPORARILY_REJECTED"),
        ),
        Start.AIR,
        {"COM_OBL_RC_ACT": 6, "COM_OF_LOSS_T": 1.0},
    ),
    _bad(
        "offboard-offset-frame",
        "Frame 7 is refused, with a text and an event each time, and counts as loss",
        "off 79 s",
        Setpoints(1, 0, 15, frame=7),
        "mavlink_rcv_sp_target_unsup_coord",
    ),
    _bad(
        "offboard-unknown-frame",
        "Frame 4 is refused and counts as loss",
        "off 99 s",
        Setpoints(1, 0, 15, frame=4),
        "mavlink_rcv_sp_target_unsup_coord",
    ),
    _bad(
        "offboard-nothing-set",
        "A setpoint with everything ignored is invalid and counts as loss",
        "off 109 s",
        Setpoints(0, 0, 15, mask=NOTHING),
        "mavlink_rcv_sp_target_invalid",
    ),
    Conversation(
        "offboard-nan",
        "A position that is no number is taken without complaint; it stays in Offboard",
        "off 114 s",
        (*_ENTER, Setpoints(math.nan, 0, 15), Wait(0.5), StaysInMode("OFFBOARD", 3.0)),
        Start.AIR,
    ),
    Conversation(
        "offboard-global-relative",
        "Global positions above home (frame 6) are flown to",
        "off 122 s",
        (*_ENTER, GlobalSetpoints(10, 10, 12), Arrives(10, 10, 12, near_m=2.5, within_s=15.0)),
        Start.AIR,
    ),
    Conversation(
        "offboard-global-amsl",
        "Global positions above mean sea level (frame 5) are flown to",
        "off 130 s",
        (
            *_ENTER,
            GlobalSetpoints(10, 10, 12, frame=5),
            Arrives(10, 10, 12, near_m=2.5, within_s=15.0),
        ),
        Start.AIR,
    ),
    Conversation(
        "goto-leaves-offboard",
        "DO_REPOSITION leaves Offboard, setpoints or not",
        "off 154 s",
        (
            *_ENTER,
            Reposition(5, 0, 15),
            InMode("AUTO_LOITER", status=4, intended="AUTO_LOITER"),
            SetMode("OFFBOARD"),
            InMode("OFFBOARD"),
        ),
        Start.AIR,
    ),
    Conversation(
        "land-out-of-offboard",
        "Landed out of Offboard while setpoints go on it is in Offboard again when disarmed",
        "off 158 s to 179 s",
        (
            *_ENTER,
            SetMode("AUTO_LAND"),
            InMode("AUTO_LAND"),
            Landed(60.0),
            InMode("OFFBOARD", 6.0, armed=False, status=3),
        ),
        Start.AIR,
    ),
)
