"""What differs among PX4's versions, as far as a flight rests on it: one table.

A flight goes by what a PX4 says and not by its number wherever it can: with one acknowledgement of
a mode and with two, with a MISSION_CURRENT that says whether the mission can be flown and without.
The number decides which parameters are checked, and what the pre-flight card says.
"""

import re
from dataclasses import dataclass
from typing import Final

Version = tuple[int, int]
"""Major and minor number: (1, 18)."""

FLOWN: Final[tuple[Version, ...]] = ((1, 15), (1, 16), (1, 17), (1, 18))
"""Versions that were flown, each as a real binary: 1.15.4, 1.16.2, 1.17.0, and 1.18 before its
release."""

OLDEST: Final = FLOWN[0]
NEWEST: Final = FLOWN[-1]


@dataclass(frozen=True, slots=True)
class VersionFact:
    """Something that a flight rests on, or has a way around, in some versions of PX4.

    Attributes:
        fact: What PX4 does.
        source: Where that is written: PX4's release notes, or a file of its source.
        conversation: One of `sitl conform` that shows it on a PX4 of any of these versions.
        since: First version in which it is so; None: in all that were flown.
        before: First version in which it is so no more; None: in all since.
        instead: What the flight does in the other versions; empty: it does the same in all.
    """

    fact: str
    source: str
    conversation: str
    since: Version | None = None
    before: Version | None = None
    instead: str = ""

    def holds_in(self, version: Version) -> bool:
        """Whether it is so in this version."""
        return (self.since is None or self.since <= version) and (
            self.before is None or version < self.before
        )


REPOSITION_CHANGES_MODE: Final = VersionFact(
    "DO_REPOSITION without the flag that changes the mode is UNSUPPORTED",
    "Commander.cpp, VEHICLE_CMD_DO_REPOSITION",
    "goto-without-mode-change",
    before=(1, 18),
    instead="a vehicle in Hold is sent it without the flag: PX4 refuses it once a pilot has "
    "chosen another mode",
)
"""What decides whether an order in Hold mode can end another mode."""

FACTS: Final = (
    VersionFact(
        "MISSION_CURRENT.mission_state says whether the mission on board can be flown",
        "mavlink_mission.cpp, update_mission_state",
        "mission-from-the-ground",
        since=(1, 17),
        instead="its arming checks are run until they say that Mission mode can run",
    ),
    VersionFact(
        "the summary of the arming checks (EVENT) says whether Mission mode can run",
        "HealthAndArmingChecks/Common.cpp, commander_arming_check_summary",
        "checks-asked-for",
    ),
    VersionFact(
        "MISSION_CURRENT has checksums of mission, fence and rally points",
        "mavlink_mission.cpp, send_mission_current",
        "same-plan-again",
    ),
    VersionFact(
        "DO_SET_MODE is acknowledged twice, ACCEPTED first whatever becomes of it",
        "mavlink_receiver.cpp, handle_message_command_both",
        "every-mode-on-the-ground",
        since=(1, 16),
        before=(1, 18),
        instead="HEARTBEAT and CURRENT_MODE are believed in all versions, no acknowledgement is",
    ),
    REPOSITION_CHANGES_MODE,
    VersionFact(
        "DO_REPOSITION without a place stops a vehicle that flies to one",
        "navigator_main.cpp, VEHICLE_CMD_DO_REPOSITION",
        "hold-does-not-end-a-goto",
    ),
    VersionFact(
        "no mode command ends a termination by command; in 1.15 it starts the motors again",
        "UserModeIntention.cpp, change",
        "termination-in-the-air",
        since=(1, 16),
        instead="no command leaves out of a mode that another party chose",
    ),
    VersionFact(
        "the items of an upload are requested by MISSION_REQUEST until a MISSION_ITEM_INT came",
        "mavlink_mission.h, _int_mode",
        "mission-upload-and-download",
        before=(1, 17),
        instead="MAVSDK answers MISSION_ACK UNSUPPORTED, and PX4 requests by MISSION_REQUEST_INT",
    ),
    VersionFact(
        "a param that means nothing to a command or to a mission item is passed over",
        "mavlink_command_params.hpp, check_params_for_vehicle",
        "refused-param-that-means-nothing",
        before=(1, 18),
        instead="no such param is sent in any version",
    ),
    VersionFact(
        "a parameter that it does not have is answered by PARAM_ERROR",
        "mavlink_parameters.cpp, send_error",
        "parameter-refusals-are-silent",
        since=(1, 18),
        instead="it is requested up to five times, and named as not told",
    ),
    VersionFact(
        "moved sticks take an automatic mode over by their deflection (COM_RC_OVERRIDE)",
        "release notes of 1.18; ManualControl.cpp",
        "moved-sticks-take-over",
        before=(1, 18),
        instead="the card looks at MAN_OVERRIDE_SPD: the speed of a stick takes over",
    ),
    VersionFact(
        "it reports a lost companion after COM_OBC_LOSS_T, not after 5 s in any case",
        "release notes of 1.18",
        "companion-lost",
        before=(1, 18),
        instead="the card does not look at that parameter",
    ),
)
"""Each has a conversation that shows it."""


def version_of(words: str) -> Version | None:
    """From "1.17.0"; None where no version is announced."""
    match = re.match(r"(\d+)\.(\d+)", words)
    return None if match is None else (int(match[1]), int(match[2]))


def name_of(version: Version) -> str:
    """As people write it: "1.18"."""
    return ".".join(map(str, version))
