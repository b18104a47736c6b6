"""The differences among PX4's versions that matter to a flight, as one table.

A flight relies on PX4's messages rather than its version number wherever possible: it handles one
and two acknowledgements of a mode, and a MISSION_CURRENT with and without feasibility. The number
decides which parameters are checked, and what the pre-flight card shows.
"""

import re
from dataclasses import dataclass
from typing import Final

Version = tuple[int, int]
"""Major and minor number: (1, 18)."""

FLOWN: Final[tuple[Version, ...]] = ((1, 15), (1, 16), (1, 17), (1, 18))
"""Versions that were flown, each with a real binary: 1.15.4, 1.16.2, 1.17.0, and a pre-release of
1.18."""

OLDEST: Final = FLOWN[0]
NEWEST: Final = FLOWN[-1]


@dataclass(frozen=True, slots=True)
class VersionFact:
    """A behavior that a flight needs or works around, in some versions of PX4.

    Attributes:
        fact: What PX4 does.
        source: Its source: PX4's release notes, or a source file.
        conversation: The conversation of `sitl conform` that shows it on a PX4 of these versions.
        since: First version with it; None: all flown versions.
        before: First version without it again; None: all since.
        instead: What the flight does with the other versions; empty: the same in all.
    """

    fact: str
    source: str
    conversation: str
    since: Version | None = None
    before: Version | None = None
    instead: str = ""

    def holds_in(self, version: Version) -> bool:
        """Whether this version has it."""
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
"""Decides whether a command in Hold mode can end another mode."""

FACTS: Final = (
    VersionFact(
        "MISSION_CURRENT.mission_state reports whether the mission on board is feasible",
        "mavlink_mission.cpp, update_mission_state",
        "mission-from-the-ground",
        since=(1, 17),
        instead="the arming checks are requested until they report that Mission mode can run",
    ),
    VersionFact(
        "the summary of the arming checks (EVENT) reports whether Mission mode can run",
        "HealthAndArmingChecks/Common.cpp, commander_arming_check_summary",
        "checks-requested",
    ),
    VersionFact(
        "MISSION_CURRENT has checksums of mission, fence and rally points",
        "mavlink_mission.cpp, send_mission_current",
        "same-plan-again",
    ),
    VersionFact(
        "DO_SET_MODE is acknowledged twice, first with ACCEPTED in any case",
        "mavlink_receiver.cpp, handle_message_command_both",
        "every-mode-on-the-ground",
        since=(1, 16),
        before=(1, 18),
        instead="HEARTBEAT and CURRENT_MODE confirm a mode in all versions, not an acknowledgement",
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
        instead="no command is sent while the vehicle is in a mode that another party chose",
    ),
    VersionFact(
        "an upload's items are requested by MISSION_REQUEST until a MISSION_ITEM_INT is received",
        "mavlink_mission.h, _int_mode",
        "mission-upload-and-download",
        before=(1, 17),
        instead="MAVSDK answers MISSION_ACK UNSUPPORTED, and PX4 requests by MISSION_REQUEST_INT",
    ),
    VersionFact(
        "a param that a command or a mission item does not use is ignored",
        "mavlink_command_params.hpp, check_params_for_vehicle",
        "refused-param-that-means-nothing",
        before=(1, 18),
        instead="no such param is sent in any version",
    ),
    VersionFact(
        "a request for an absent parameter is answered by PARAM_ERROR",
        "mavlink_parameters.cpp, send_error",
        "parameter-refusals-are-silent",
        since=(1, 18),
        instead="it is requested up to five times, and listed as not reported",
    ),
    VersionFact(
        "moved sticks take over from an automatic mode by their deflection (COM_RC_OVERRIDE)",
        "release notes of 1.18; ManualControl.cpp",
        "moved-sticks-take-over",
        before=(1, 18),
        instead="the card checks MAN_OVERRIDE_SPD: the speed of a stick takes over",
    ),
    VersionFact(
        "PX4 reports a lost companion after COM_OBC_LOSS_T, not always after 5 s",
        "release notes of 1.18",
        "companion-lost",
        before=(1, 18),
        instead="the card does not check that parameter",
    ),
)
"""Each has a conversation that shows it."""


def version_of(words: str) -> Version | None:
    """Parse "1.17.0"; None if there is no version."""
    match = re.match(r"(\d+)\.(\d+)", words)
    return None if match is None else (int(match[1]), int(match[2]))


def name_of(version: Version) -> str:
    """The version as text: "1.18"."""
    return ".".join(map(str, version))
